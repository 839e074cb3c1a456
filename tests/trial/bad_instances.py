"""Placements that are flat, broken, tiny or huge: a sentence, or the hits of the flattened scene, whatever the rule.

    bad_instances.py --raymill RAYMILL [--short]

Nodes and EXT_mesh_gpu_instancing place a sheet by matrices, translations, rotations and scales of every odd kind. Each
scene is built with --instances always, auto and never. What is refused ends with 42 and one sentence that names the
node. Of what is not, every store has the same ids; its hits are the flattened scene's bit for bit where a placement was
flattened, and within the bound of traversal/README.md where it was not, in every mode.
"""

import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "masks"))

import numpy as np  # noqa: E402
import support  # noqa: E402
from made_scene import Scene, sheet  # noqa: E402

INPUT = 42
RULES = ("always", "auto", "never")
NONE = 0xFFFFFFFF
NAN, INF = float("nan"), float("inf")
TURNED = [0.5, 0.1, -0.7, 0.5]  # a rotation, not of length one
BYTE, UNSIGNED_BYTE, SHORT, FLOAT = 5120, 5121, 5122, 5126


def columns(x, y, z, offset=(0, 0, 0)):
    """A node's matrix."""
    return {"matrix": [*x, 0, *y, 0, *z, 0, *offset, 1]}


# name, what the node says, how: "placed" as an instance, "flat" triangles that were flattened, "gone" dropped triangles
NODES = [
    ("as it is", {}, "placed"),
    ("scaled to a plane", {"scale": [1, 1, 0]}, "flat"),
    ("scaled to a plane, turned", {"scale": [2, 1, 0], "rotation": TURNED}, "flat"),
    ("scaled to a line", {"scale": [1, 0, 0]}, "gone"),
    ("scaled to a point", {"scale": [0, 0, 0]}, "gone"),
    ("matrix of rank 2", columns((1, 0, 0), (0, 1, 0), (1, 1, 0)), "flat"),
    ("matrix of rank 2 but for rounding", columns((0.1, 0.2, 0.7), (0.3, -0.1, 0.2), (0.4, 0.1, 0.9)), "flat"),
    ("matrix of zeros", columns((0, 0, 0), (0, 0, 0), (0, 0, 0)), "gone"),
    ("all but singular", columns((1, 0, 0), (0, 1, 0), (0, 1, 2**-21)), "flat"),
    ("nearly singular", columns((1, 0, 0), (0, 1, 0), (0, 1, 2**-6)), "placed"),
    ("mirrored on all axes", {"scale": [-1, -2, -0.5]}, "placed"),
    ("squeezed a million times", {"scale": [1, 1, 1e-6]}, "placed"),
    ("rotation of zeros", {"rotation": [0, 0, 0, 0]}, "placed"),
    ("rotation of length 1e-170", {"rotation": [1e-170 * x for x in TURNED]}, "placed"),
    ("rotation of length 1e-310", {"rotation": [0, 0, 1e-310, 1e-310]}, "placed"),
    ("rotation of length 1e200", {"rotation": [1e200 * x for x in TURNED]}, "placed"),
    ("translation beyond float32", {"translation": [1e39, 0, 0]}, "gone"),
    ("scale beyond float32", {"scale": [1e300, 1e300, 1e300]}, "gone"),
    ("matrix that overflows its parent", columns((1e308, 0, 0), (0, 1e308, 0), (0, 0, 1e308)), "gone"),
]
# translation, rotation, scale of a placement by the extension, and how it ends
COPIES = [
    ("as it is", (0, 0, 0), (0, 0, 0, 1), (1, 1, 1), "placed"),
    ("translation of NaN", (NAN, 0, 0), (0, 0, 0, 1), (1, 1, 1), "gone"),
    ("translation of infinity", (0, INF, 0), (0, 0, 0, 1), (1, 1, 1), "gone"),
    ("rotation of zeros", (0, 3, 0), (0, 0, 0, 0), (1, 1, 1), "placed"),
    ("rotation of NaN", (0, 6, 0), (0, NAN, 0, 1), (1, 1, 1), "gone"),
    ("rotation of infinity", (0, 6, 0), (0, 0, INF, 1), (1, 1, 1), "gone"),
    ("rotation of length 1e-30", (0, 9, 0), (5e-31, 0, 0, 1e-30), (1, 1, 1), "placed"),
    ("scale of zero", (0, 12, 0), (0, 0, 0, 1), (0, 0, 0), "gone"),
    ("scale to a plane", (0, 15, 0), (0.5, 0.5, 0, 1), (1, 1, 0), "flat"),
    ("scale of NaN", (0, 18, 0), (0, 0, 0, 1), (1, NAN, 1), "gone"),
    ("scale of infinity", (0, 18, 0), (0, 0, 0, 1), (INF, 1, 1), "gone"),
    ("scale mirrored", (0, 21, 0), (0, 0, 0, 1), (1, -1, 1), "placed"),
]
# Scenes of one such sheet each, and how large it is: stretches that float32 rays cannot follow are flattened.
SIZES = [("1e-30", (1e-30,) * 3, "flat"), ("1e-9", (1e-9,) * 3, "placed"), ("1e12", (1e12,) * 3, "placed"),
         ("5e17", (5e17,) * 3, "placed"), ("1e30", (1e30,) * 3, "flat"), ("1, 1, 1e-12", (1, 1, 1e-12), "placed"),
         ("1, 1, 1e-30", (1, 1, 1e-30), "flat"), ("1, 1, 1e-39", (1, 1, 1e-39), "flat"),
         ("1e-39, 1, 1", (1e-39, 1, 1), "flat")]


def refusals():
    """(name, what the sentence says, change of the scene whose node 1 is placed by the extension)"""
    def attribute(name, rows, kind, component, normalized=False):
        def change(scene):
            scene.json["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"][name] = scene.accessor(
                rows, kind, component, normalized)
        return change

    def extension(value):
        return lambda scene: scene.json["nodes"][1]["extensions"].update(EXT_mesh_gpu_instancing=value)

    def node(**fields):
        return lambda scene: scene.json["nodes"][1].update(fields)

    def many(scene):
        attribute("SCALE", np.ones((3, 3), np.float32), "VEC3", FLOAT)(scene)
        for index in scene.json["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].values():
            scene.json["accessors"][index] = {"componentType": FLOAT, "count": 2**32 - 1, "type": "VEC3"}

    def cut(scene):
        attribute("TRANSLATION", np.zeros((3, 3), np.float32), "VEC3", FLOAT)(scene)
        scene.json["accessors"][-1]["count"] = 4

    threes = np.zeros((3, 3), np.float32)
    return [
        ("wrong count", "nodes[1]", attribute("SCALE", np.ones((2, 3), np.float32), "VEC3", FLOAT)),
        ("rotation of another count", "4 elements", attribute("ROTATION", np.ones((4, 4), np.float32), "VEC4", FLOAT)),
        ("translation of shorts", "component type",
         attribute("TRANSLATION", np.zeros((3, 3), np.int16), "VEC3", SHORT)),
        ("scale of bytes", "nodes[1]", attribute("SCALE", np.ones((3, 3), np.int8), "VEC3", BYTE, True)),
        ("rotation of unsigned bytes", "component type",
         attribute("ROTATION", np.ones((3, 4), np.uint8), "VEC4", UNSIGNED_BYTE, True)),
        ("rotation of shorts that are not normalised", "component type",
         attribute("ROTATION", np.ones((3, 4), np.int16), "VEC4", SHORT)),
        ("rotation of three numbers", "VEC4", attribute("ROTATION", threes, "VEC3", FLOAT)),
        ("accessor that is not there", "TRANSLATION", extension({"attributes": {"TRANSLATION": 999}})),
        ("accessor of a negative number", "TRANSLATION", extension({"attributes": {"TRANSLATION": -1}})),
        ("accessor past its view", "accessors", cut),
        ("no attributes", "attributes", extension({})),
        ("no attribute", "none of TRANSLATION, ROTATION and SCALE", extension({"attributes": {}})),
        ("an attribute of one's own alone", "none of TRANSLATION, ROTATION and SCALE",
         extension({"attributes": {"_ID": 0}})),
        ("attributes that are a list", "attributes", extension({"attributes": [0, 1, 2]})),
        ("more placements than ids", "nodes[1]", many),
        ("matrix of 15 numbers", "nodes[1].matrix", node(matrix=[1] * 15)),
        ("matrix that is projective", "nodes[1].matrix",
         node(matrix=[1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])),
        ("matrix of NaN", "JSON", node(matrix=[NAN] * 16)),
        ("matrix of null", "nodes[1].matrix[0]", node(matrix=[None] * 16)),
        ("rotation of three numbers in the node", "nodes[1].rotation", node(rotation=[0, 0, 1])),
        ("scale of words", "nodes[1].scale[0]", node(scale=["1", "1", "1"])),
        ("scale beyond float64", "beyond float64", node(scale=["BEYOND", 1, 1])),
    ]


class Trial(support.Checks):
    def __init__(self, options, folder):
        super().__init__(options, folder)
        self.checks = 0
        self.sheet = sheet(np.random.default_rng(3), 6 if options.short else 20)

    def check(self, what, holds):
        """Of hundreds only those that fail are told."""
        self.checks += 1
        if not holds:
            super().check(what, holds)

    def scene(self, name):
        scene = Scene(self.folder, name)
        scene.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
        scene.material(mode="OPAQUE")
        scene.mesh(self.sheet[0], self.sheet[1], 0)
        return scene

    def write(self, scene):
        for accessor in scene.json["accessors"][2:]:  # NaN is no JSON
            accessor.pop("min", None)
            accessor.pop("max", None)
        path = scene.write()
        path.write_text(path.read_text().replace('"BEYOND"', "1e999"))
        return path

    def extension(self, scene, rows, **node):
        made = {name: scene.accessor(np.array(row, np.float32), kind, FLOAT)
                for name, row, kind in zip(("TRANSLATION", "ROTATION", "SCALE"), rows, ("VEC3", "VEC4", "VEC3"))}
        scene.node(0, extensions={"EXT_mesh_gpu_instancing": {"attributes": made}}, **node)

    def refused(self):
        for name, needs, change in refusals():
            scene = self.scene("refused")
            scene.node(0)
            scene.node(0, extensions={"EXT_mesh_gpu_instancing": {"attributes": {
                "TRANSLATION": scene.accessor(np.zeros((3, 3), np.float32), "VEC3", FLOAT)}}})
            change(scene)
            self.refuse(name, needs, self.write(scene))
        for how in (columns((0, 0, 0), (0, 0, 0), (0, 0, 0)), {"scale": [1e300] * 3}, {"scale": [1, 0, 0]}):
            scene = self.scene("nothing")
            scene.node(0, **how)
            scene.node(0, **how)
            self.refuse(f"nothing left by {how}", "no triangle", self.write(scene))

    def refuse(self, name, needs, path):
        out = self.folder / "refused.mill"
        for rule in RULES:
            done = support.Run([self.options.raymill, "build", path, "-o", out, "--instances", rule], timeout=60)
            said = done.stderr.strip()
            if rule == RULES[0]:
                print(f"{name}: {said.replace(str(self.folder) + '/', '')}", flush=True)
            self.check(f"{name}, {rule}: ends with {done.rc}: {said}", done.rc == INPUT and needs in said and
                       done.stderr.count("\n") == 1 and said.startswith("raymill: ") and
                       not list(self.folder.glob("refused.mill*")))

    def build(self, path, rule):
        return super().build(path, f"{path.stem}-{rule}.mill", "--instances", rule)

    def trace(self, store, rays, *words):
        return super().trace(store, rays, "--fields", "t,uv,ids,instance_id,normal", *words)[0]

    def aim(self, info, geometry_boxes):
        """Rays towards the middle of every triangle of every geometry, from three sides, as far away as it is large."""
        positions, indices, _ = self.sheet
        centres = positions[indices].mean(axis=1)
        random, rows = np.random.default_rng(5), []
        for world in geometry_boxes:
            with np.errstate(all="ignore"):
                points = centres @ world[:3, :3].T + world[:3, 3]
                largest = np.abs(points).max()
            if not largest < 2.0**110:
                continue
            reach = max(np.ptp(points, axis=0).max(), 2.0**-100)
            for _ in range(3):
                ways = random.normal(size=(len(points), 3))
                ways /= np.linalg.norm(ways, axis=1)[:, None]
                orgs = (points + ways * reach).astype(np.float32).astype(np.float64)
                rows.append(np.concatenate([orgs, (points - orgs) / np.float64(reach)], axis=1))
        rays = self.folder / "rays.npy"
        np.save(rays, np.concatenate(rows).astype(np.float32))
        return rays

    def same(self, name, path, worlds, ends):
        """Stores of all rules answer alike; `ends` of each geometry."""
        stores = {rule: self.build(path, rule) for rule in RULES}
        flat_store, _, flat_info = stores["never"]
        placed = [i for i, end in enumerate(ends) if end == "placed"]
        rays = self.aim(flat_info, worlds)
        truth = self.trace(flat_store, rays)
        self.check(f"{name}: geometries that are gone have no hits",
                   not np.isin(truth["geometry_id"], [i for i, end in enumerate(ends) if end == "gone"]).any())
        seen = set(truth["geometry_id"][np.isfinite(truth["t"])].tolist())
        self.check(f"{name}: the others have some: {seen}", seen == {i for i, end in enumerate(ends) if end != "gone"})
        for rule in RULES[:2]:
            store, _, info = stores[rule]
            self.check(f"{name}, {rule}: {info['instances']} instances of {len(placed)}",
                       info["instances"] in ({len(placed)} if rule == "always" else {0, len(placed)}))
            self.check(f"{name}, {rule}: other geometries", len(info["geometries"]) == len(flat_info["geometries"]))
            hits = self.trace(store, rays)
            self.compare(f"{name}, {rule}", np.load(rays).astype(np.float64), hits, truth, info)
            again = self.trace(store, rays, "--memory", info["least_memory_bytes"], "--isa", "scalar")
            self.check(f"{name}, {rule}: other bytes in the least memory", again.tobytes() == hits.tobytes())
            # In float32 alone products of lengths are to stay below 2^127 in the flattened scene too.
            for mode in ("fast", "exact") if np.abs(flat_info["bounds"]["max"]).max() < 1e13 else ("exact",):
                both = [self.trace(one, rays, "--mode", mode) for one in (store, flat_store)]
                self.compare(f"{name}, {rule}, {mode}", np.load(rays).astype(np.float64), *both, info)

    def compare(self, name, rays, hits, truth, info):
        hit = np.isfinite(hits["t"]) & np.isfinite(truth["t"])
        other = (np.isfinite(hits["t"]) != np.isfinite(truth["t"])) | (
            hit & ((hits["geometry_id"] != truth["geometry_id"]) | (hits["primitive_id"] != truth["primitive_id"])))
        flattened = hit & ~other & (hits["instance_id"] == NONE)
        bits = [field for field in hits.dtype.names if field != "instance_id"]
        self.check(f"{name}: hits on what is flattened in both are not the same",
                   all(hits[field][flattened].tobytes() == truth[field][flattened].tobytes() for field in bits))
        placed = hit & ~other & ~flattened
        # traversal/README.md: planes at most 4 units apart, t counts along dir.
        largest = max(abs(x) for key in ("min", "max") for x in info["bounds"][key])
        way = np.abs(np.where(placed, truth["t"], 0)[:, None].astype(np.float64) * rays[:, 3:]).max(axis=1)
        unit = 2.0**-24 * (largest + np.abs(rays[:, :3]).max(axis=1) + way)
        with np.errstate(invalid="ignore"):
            apart = np.abs((hits["t"].astype(np.float64) - truth["t"]) *
                           (rays[:, 3:] * truth["normal"]).sum(axis=1)) / unit
        most = apart[placed].max(initial=0)
        print(f"{name}: {len(hits)} rays, {int(hit.sum())} hits, {int(placed.sum())} on instances, planes at most "
              f"{most:.2g} units apart, {int(other.sum())} hit something else", flush=True)
        self.check(f"{name}: planes are {most:.2g} units apart", most <= 4)
        self.check(f"{name}: {int(other.sum())} rays hit something else", other.sum() <= len(hits) // 200)

    def accepted(self):
        scene, worlds = self.scene("nodes"), []
        for i, (_, how, _) in enumerate(NODES):
            scene.node(0, **how)
            scale = 1e200 if "parent" in NODES[i][0] else 1
            place = [3.0 * i, 0, 0]
            scene.json["nodes"].append({"children": [i], "translation": place, "scale": [scale] * 3})
        # Geometry ids follow the nodes' array: first all that are placed, then their parents.
        nodes = scene.json["nodes"]
        order = nodes[0::2] + nodes[1::2]
        scene.json["nodes"] = order
        for i in range(len(NODES)):
            parent = np.eye(4)
            parent[:3, :3] *= order[len(NODES) + i]["scale"][0]
            parent[:3, 3] = order[len(NODES) + i]["translation"]
            with np.errstate(all="ignore"):
                worlds.append(parent @ matrix_of(order[i]))
        scene.json["scenes"] = [{"nodes": list(range(len(NODES), 2 * len(NODES)))}]
        self.same("nodes", self.write(scene), worlds, [end for _, _, end in NODES])
        scene = self.scene("copies")
        rows = [[copy[k] for copy in COPIES] for k in (1, 2, 3)]
        self.extension(scene, rows, translation=[5, 0, 0])
        worlds = [matrix_of({"translation": [5 + t[0], t[1], t[2]], "rotation": r, "scale": s})
                  for _, t, r, s, _ in COPIES]
        self.same("copies", self.write(scene), worlds, [copy[4] for copy in COPIES])
        for name, scale, end in SIZES:
            scene = self.scene("size")
            scene.node(0, scale=list(scale))
            scene.node(0, scale=[2 * x for x in scale], translation=[3 * scale[0], 3 * scale[1], 0])
            worlds = [matrix_of(node) for node in scene.json["nodes"]]
            self.same(f"scale {name}", self.write(scene), worlds, [end, end])


def matrix_of(node):
    """A node's matrix by numpy alone; a rotation is of length one first, and one of zeros turns nothing."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    quaternion = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    with np.errstate(all="ignore"):
        if quaternion.any():
            quaternion = quaternion / np.abs(quaternion).max()
            x, y, z, w = quaternion / np.linalg.norm(quaternion)
            matrix[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                              [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                              [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def main():
    options = support.parser(__doc__).parse_args()
    with support.work_folder(options) as folder:
        trial = Trial(options, folder)
        try:
            trial.refused()
            trial.accepted()
        except support.Failure as failure:
            trial.failures.append(str(failure))
    return trial.ended(f"bad instances, {trial.checks} checks")


if __name__ == "__main__":
    sys.exit(main())
