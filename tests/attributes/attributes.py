"""Attributes of hits through the program, held against what numpy makes of the scene files by itself, in float64.

    attributes.py --raymill build/release/bin/raymill [--short]

For scenes of the collection (left out where they are missing) and one that is made: normals, texture coordinates and
colours at each hit, and that the hit lies where the file's own triangle is; the same bytes from all the memory and from
5 %, from every ISA and width, from the schedule that suspends everywhere, and through a server; beside alpha masks;
that sparse accessors and EXT_meshopt_compression give the same; that stores without attributes stay as they are; and
files that are damaged or do not fit.
"""

import pathlib
import sys

import numpy as np

TESTS = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "trial"), str(TESTS / "masks")]
import gltf_encodings  # noqa: E402
from bad_attributes import try_bad_encodings, try_bad_files  # noqa: E402
from gltf_triangles import Document, local_matrix, placed_nodes  # noqa: E402
from made_scene import Scene, sheet  # noqa: E402
from made_scene import make_scene as make_masks  # noqa: E402
from support import Checks, Server, parser, run, scenes_folder, work_folder  # noqa: E402

NAMES = {"shading_normal": ("normal", "NORMAL"), "uv0": ("uv0", "TEXCOORD_0"), "uv1": ("uv1", "TEXCOORD_1"),
         "color0": ("color0", "COLOR_0")}
# path, whether numpy alone can read it, rays of the short form
SCENES = {"teapots": ("teapots_galore/TeapotsGalore.gltf", True, 3000),
          "dragon": ("dragon_attenuation/DragonAttenuation.glb", True, 0),
          "engine": ("two_cylinder_engine/2CylinderEngine.glb", True, 0),
          "helicopter": ("pmndrs_helicopter/model.gltf", False, 0)}


def placements(document, node, world):
    """Matrices of the node's mesh: its own, or one for each of EXT_mesh_gpu_instancing."""
    extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if extension is None:
        return [world]
    rows = {name: document.accessor(index) for name, index in extension["attributes"].items()
            if name in ("TRANSLATION", "ROTATION", "SCALE")}
    return [world @ local_matrix({name.lower(): row[i] for name, row in rows.items()})
            for i in range(len(next(iter(rows.values()))))]


class Geometry:
    """A geometry as the file has it: corners and attributes by primitive id, in float64."""

    def __init__(self, document, primitive, world):
        self.world = world
        attributes = primitive["attributes"]
        count = document.json["accessors"][attributes["POSITION"]]["count"]
        corners = (document.accessor(primitive["indices"])[:, 0].astype(np.int64) if "indices" in primitive
                   else np.arange(count))
        mode = primitive.get("mode", 4)
        if mode == 5:
            corners = np.array([[corners[i], corners[i + 2], corners[i + 1]] if i % 2 else corners[i:i + 3]
                                for i in range(len(corners) - 2)])
        elif mode == 6:
            corners = np.array([[corners[i + 1], corners[i + 2], corners[0]] for i in range(len(corners) - 2)])
        self.corners = corners[:len(corners) // 3 * 3].reshape(-1, 3) if mode == 4 else corners
        self.values = {name: document.accessor(attributes[name]).astype(np.float64)
                       for name in ("POSITION", "NORMAL", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0") if name in attributes}
        if self.values.get("COLOR_0", np.zeros((1, 4))).shape[1] == 3:
            self.values["COLOR_0"] = np.pad(self.values["COLOR_0"], ((0, 0), (0, 1)), constant_values=1)

    def at(self, name, primitives, u, v):
        a, b, c = (self.values[name][self.corners[primitives, k]] for k in range(3))
        return (1 - u - v)[:, None] * a + u[:, None] * b + v[:, None] * c

    def point(self, primitives, u, v):
        return self.at("POSITION", primitives, u, v) @ self.world[:3, :3].T + self.world[:3, 3]

    def normal(self, primitives, u, v):
        """(towards the normal, its length)"""
        normal = self.at("NORMAL", primitives, u, v)
        normal = normal @ np.linalg.inv(self.world[:3, :3])
        return normal, np.linalg.norm(normal, axis=1)[:, None]


def geometries(path, folder):
    document, out = Document(path, folder), []
    for node, world in placed_nodes(document):
        if "mesh" not in node:
            continue
        for placed in placements(document, node, world):
            out += [Geometry(document, primitive, placed)
                    for primitive in document.json["meshes"][node["mesh"]]["primitives"]]
    return out


def make_rays(info, count, seed):
    """Towards the scene from around it and from within."""
    random = np.random.default_rng(seed)
    low, high = (np.array(info["bounds"][key], dtype=np.float64) for key in ("min", "max"))
    size = np.linalg.norm(high - low)
    aims = low + random.random((count, 3)) * (high - low)
    way = random.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    rays = np.zeros((count, 6), np.float32)
    rays[:, :3] = aims + way * np.where(random.random(count) < 0.7, size, 0)[:, None]
    rays[:, 3:] = -way * (0.5 + random.random(count))[:, None]
    rays[0, 3:] = 0  # invalid
    return rays


def make_scene(folder):
    """Sheets of every kind of attribute, placed mirrored, stretched and many times, some without."""
    random = np.random.default_rng(11)
    scene = Scene(folder, "made")
    scene.json["extensionsUsed"] = ["KHR_mesh_quantization"]
    scene.material(mode="OPAQUE")
    for i in range(9):
        positions, indices, uv = sheet(random, [3, 17, 30][i % 3])
        normals = random.normal(size=positions.shape)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        colors = random.random((len(uv), 4))
        given = {"NORMAL": [(normals.astype(np.float32), "VEC3", 5126),
                            (np.round(normals * 127).astype(np.int8), "VEC3", 5120, True),
                            (np.round(normals * 32767).astype(np.int16), "VEC3", 5122, True)][i % 3],
                 "TEXCOORD_0": [(uv.astype(np.float32), "VEC2", 5126),
                                (np.round(uv * 65535).astype(np.uint16), "VEC2", 5123, True),
                                (np.round(uv * 255).astype(np.uint8), "VEC2", 5121, True)][i % 3],
                 # KHR_mesh_quantization: signed ones reach below -1, which counts as -1.
                 "TEXCOORD_1": [(np.round(uv * 900 - 50).astype(np.int16), "VEC2", 5122),
                                (np.round(uv * 255 - 128).astype(np.int8), "VEC2", 5120, True),
                                (np.round(uv * 65535).astype(np.uint16), "VEC2", 5123),
                                (np.round(uv * 65535 - 32768).astype(np.int16), "VEC2", 5122, True),
                                (np.round(uv * 200).astype(np.uint8), "VEC2", 5121)][i % 5],
                 "COLOR_0": [(colors.astype(np.float32), "VEC4", 5126),
                             (colors[:, :3].astype(np.float32), "VEC3", 5126),
                             (np.round(colors * 65535).astype(np.uint16), "VEC4", 5123, True)][i % 3]}
        for name in [(), ("NORMAL",), ("TEXCOORD_0", "COLOR_0"), tuple(given)][[0, 0, 1, 0, 2, 0, 0, 3, 0][i]]:
            del given[name]
        mesh = scene.mesh(positions, indices, 0, **given)
        quarter = random.normal(size=4)
        for k in range([1, 1, 40][i % 3]):
            scene.node(mesh, translation=(random.random(3) * 4).tolist(),
                       rotation=(quarter / np.linalg.norm(quarter)).tolist(),
                       scale=[-1 if k % 2 else 1, 1 + 0.2 * (k % 5), 0.5])
    # The same sheet without indices, and as a strip and a fan.
    positions, indices, uv = sheet(random, 9)
    flat = indices.reshape(-1)
    scene.mesh(positions[flat], np.arange(len(flat)), 0,
               NORMAL=(random.normal(size=(len(flat), 3)).astype(np.float32), "VEC3", 5126))
    del scene.json["meshes"][-1]["primitives"][0]["indices"]
    scene.node(len(scene.json["meshes"]) - 1, translation=[2, 2, 5])
    for mode in (5, 6):
        mesh = scene.mesh(positions, np.arange(len(positions)), 0, TEXCOORD_0=(uv.astype(np.float32), "VEC2", 5126))
        scene.json["meshes"][mesh]["primitives"][0]["mode"] = mode
        scene.node(mesh, translation=[mode, 0, 6])
    return scene.write()


class Trial(Checks):
    def scene(self, name, path, count, readable=True, rules=()):
        """`rules`: what else builds are asked for."""
        asked = ["normal", "uv0", "uv1", "color0"] if name in ("made", "masked", "helicopter") else ["normal", "uv0"]
        if name == "engine":
            asked = ["normal"]
        fields = [field for field, (attribute, _) in NAMES.items() if attribute in asked]
        store, report, info = self.build(path, f"{name}.mill", "--attributes", ",".join(asked), *rules)
        plain, _, plain_info = self.build(path, "plain.mill", *rules)
        rays = self.folder / f"{name}-rays.npy"
        np.save(rays, make_rays(info, count, 5))
        words = ["--fields", ",".join(["t", "uv", "ids", "instance_id", "normal", *fields])]
        hits, stats = self.trace(store, rays, *words)
        before, _ = self.trace(plain, rays, "--fields", "t,uv,ids,instance_id,normal")
        same = all((hits[key].tobytes() == before[key].tobytes()) for key in before.dtype.names)
        self.check(f"{name}: what else a hit holds is the same", same)
        cost = next(cost for cost in info["costs"] if cost["feature"] == "attributes")
        print(f"  {name}: {info['triangles']} triangles, {report['attribute_entries']} of them with attributes in "
              f"{cost['pages']} pages, {cost['store_bytes']} B on disk, {cost['decoded_bytes']} decoded (the store "
              f"without: {plain_info['store_bytes']} and {plain_info['decoded_bytes']}); {count} rays, "
              f"{stats['hits']} hits, {stats['rays_per_second'] / 1e6:.2f} M rays/s", flush=True)
        self.check(f"{name}: attributes of every hit that has some are read", stats["attributes_read"] <= stats["hits"])
        missed = ~np.isfinite(hits["t"])
        for field in fields:
            self.check(f"{name}: {field} of misses is NaN", np.isnan(hits[field][missed]).all())
        if readable:
            self.compare(name, path, np.load(rays), hits, fields)
        else:
            self.plausible(name, hits)
        self.everywhere(name, path, asked, store, info, rays, hits, words, rules)
        return rays, hits, words

    def compare(self, name, path, rays, hits, fields):
        of_file = geometries(path, self.folder)
        worst = dict.fromkeys(["place", *fields], 0.0)
        counts, lacking = dict.fromkeys(fields, 0), dict.fromkeys(fields, True)
        size = np.abs(rays[:, :3]).max()
        order = np.argsort(hits["geometry_id"], kind="stable")
        order = order[np.isfinite(hits["t"][order])]
        for which in np.split(order, np.flatnonzero(np.diff(hits["geometry_id"][order])) + 1):
            geometry = of_file[hits["geometry_id"][which[0]]]
            some = hits[which]
            args = (some["primitive_id"], some["u"].astype(np.float64), some["v"].astype(np.float64))
            reached = rays[which, :3] + some["t"][:, None].astype(np.float64) * rays[which, 3:]
            worst["place"] = max(worst["place"], np.abs(reached - geometry.point(*args)).max() / size)
            for field in fields:
                attribute = NAMES[field][1]
                if attribute not in geometry.values:
                    lacking[field] &= bool(np.isnan(some[field]).all())
                    continue
                counts[field] += len(which)
                if attribute == "NORMAL":
                    # A normal of corners that all but cancel is as good as what is left of them.
                    should, length = geometry.normal(*args)
                    error = np.abs(some[field] - should / length) * np.minimum(length, 1)
                else:
                    should = geometry.at(attribute, *args)
                    error = np.abs(some[field] - should) / max(np.abs(should).max(), 1e-6)
                worst[field] = max(worst[field], np.nan_to_num(error, nan=9).max())
        print(f"  {name}: largest error " + ", ".join(f"{key} {value:.2g}" for key, value in worst.items()) +
              f"; hits with each: {counts}", flush=True)
        self.check(f"{name}: hits lie on the file's triangles", worst["place"] < 1e-4)
        for field in fields:
            self.check(f"{name}: {field} is NaN where a geometry has none", lacking[field])
            # Half an ulp of the result, an ulp of columns for normals; ulps of u and v are those of the hit.
            self.check(f"{name}: {field} is the file's", worst[field] < 5e-7 and (counts[field] > 0 or field == "uv1"))

    def plausible(self, name, hits):
        """Where numpy cannot read the file: lengths, and sides."""
        hit = np.isfinite(hits["t"]) & np.isfinite(hits["shading_normal"]).all(axis=1)
        length = np.linalg.norm(hits["shading_normal"][hit].astype(np.float64), axis=1)
        along = (hits["shading_normal"][hit] * hits["normal"][hit]).sum(axis=1)
        print(f"  {name}: {hit.sum()} shading normals, {(along > 0.7).mean():.4f} of them within 45 degrees of the "
              "triangle's", flush=True)
        self.check(f"{name}: normals have length one", hit.sum() > 0 and np.abs(length - 1).max() < 2e-7)
        self.check(f"{name}: normals are near the triangles'", (along > 0.7).mean() > 0.9)

    def everywhere(self, name, path, asked, store, info, rays, hits, words, rules):
        """The same bytes however they come."""
        ways = {"two threads": ["--threads", "2"], "scalar": ["--isa", "scalar"], "sorted": ["--sort-rays", "always"]}
        if not self.options.short or name in ("made", "masked"):
            ways["5 % of memory"] = ["--memory", info["least_memory_bytes"] + info["decoded_bytes"] // 20]
        for way, more in ways.items():
            again, stats = self.trace(store, rays, *words, *more)
            self.check(f"{name}, {way}: the same bytes ({stats['pages_read']} pages read, {stats['rays_parked']} times "
                       f"a ray waited)", again.tobytes() == hits.tobytes())
        few = self.folder / "few.npy"
        some = 300 if self.options.short else 5000
        np.save(few, np.load(rays)[:some])
        again, _ = self.trace(store, few, *words, "--adversarial")
        self.check(f"{name}, suspended everywhere: the same bytes", again.tobytes() == hits[:some].tobytes())
        if self.options.short and name not in ("made", "masked"):
            return
        with Server(self.options.raymill, self.folder, self.folder, "--memory", "300M") as server:
            again, _ = self.trace(store.name, rays, *words, "--server", server.address)
        self.check(f"{name}, through a server: the same bytes", again.tobytes() == hits.tobytes())
        other, *_ = self.build(path, "other.mill", "--attributes", ",".join(reversed(asked)), "--width", "4",
                               "--page-size", "16K", "--codec", "lz4", *rules)
        again, _ = self.trace(other, rays, *words)
        self.check(f"{name}, 4 wide, small pages, lz4: the same bytes", again.tobytes() == hits.tobytes())
        little, _, _ = self.build(path, "little.mill", "--attributes", ",".join(asked), "--threads", "1", "--memory",
                                  "120M", *rules)
        self.check(f"{name}: the same store whatever the memory and the threads",
                   little.read_bytes() == store.read_bytes())
        if name == "teapots":  # seven million triangles
            return
        flat, _, _ = self.build(path, "flat.mill", "--attributes", ",".join(asked), "--instances", "never", "--codec",
                                "raw", *rules)
        again, _ = self.trace(flat, rays, *words)
        same = (again["primitive_id"] == hits["primitive_id"]) & (again["geometry_id"] == hits["geometry_id"])
        with np.errstate(invalid="ignore"):
            near = np.abs(again["t"] - hits["t"]) <= 1e-5 * np.abs(hits["t"])
        both = same & near & np.isfinite(hits["t"])
        for field in [field for field, (attribute, _) in NAMES.items() if attribute in asked]:
            error = np.abs(again[field][both] - hits[field][both])
            scale = np.nanmax(np.abs(hits[field][both]), initial=1)
            self.check(f"{name}: flattened {field} is the instanced one but for u and v",
                       both.sum() > 0 and np.nanmedian(error) < 1e-4 * scale)

    def encoded(self, scene, rays, hits, words):
        """The same numbers from sparse accessors, and from compressed ones."""
        asked = ["--attributes", "normal,uv0,uv1,color0"]

        def hits_of(path):
            store, report, _ = self.build(path, "encoded.mill", *asked)
            return self.trace(store, rays, *words)[0], report["import"]["counts"]

        again, _ = hits_of(gltf_encodings.sparse(scene))
        self.check("sparse accessors: the same bytes", again.tobytes() == hits.tobytes())
        packed, plain = gltf_encodings.meshopt(scene)
        (again, counts), (decoded, _) = hits_of(packed), hits_of(plain)
        self.check(f"EXT_meshopt_compression: views are decoded {counts}", counts["meshopt_views"]["count"] > 10)
        self.check("EXT_meshopt_compression: the same bytes as decoded by the library",
                   again.tobytes() == decoded.tobytes())
        # The octahedral filter moves normals alone.
        others = [field for field in hits.dtype.names if field != "shading_normal"]
        self.check("EXT_meshopt_compression: all but normals as they were",
                   all(again[field].tobytes() == hits[field].tobytes() for field in others))
        along = (again["shading_normal"] * hits["shading_normal"]).sum(axis=1)
        self.check("EXT_meshopt_compression: normals near to what they were",
                   np.nanmin(along[np.isfinite(along)]) > 0.9 and (along < 0.99999).any())


def main():
    options = parser(__doc__).parse_args()
    with work_folder(options) as folder:
        trial = Trial(options, folder)
        made, count = make_scene(trial.folder), 4000 if options.short else 200_000
        trial.encoded(made, *trial.scene("made", made, count))
        trial.scene("masked", make_masks(trial.folder, 1, 8 if options.short else 24), count,
                    rules=["--blend-as-mask", "0.4", "--cull-back-faces"])
        scenes = scenes_folder()
        for name, (path, readable, short_rays) in SCENES.items() if scenes else ():
            if not options.short or short_rays:
                trial.scene(name, scenes / path, short_rays if options.short else 400_000, readable)
        try_bad_files(trial, make_scene(trial.folder))
        try_bad_encodings(trial, make_scene(trial.folder))
    return trial.ended("attributes")


if __name__ == "__main__":
    sys.exit(main())
