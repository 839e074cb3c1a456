"""Every ray of every scene against Embree in robust mode and against exact arithmetic.

    correctness.py --raymill RAYMILL --oracle RAYMILL-ORACLE [--rays N] [--scene NAME]... [--list FILE] [--short]

Builds each store, makes primary, ambient-occlusion and diffuse-bounce rays, traces them and asks the oracle. Fails when
an answer is wrong, or a t is more than 4 ulp from its exact value. --list writes each ray that differs from Embree.

agree: the same triangle as Embree's, or both a miss. equal_t: another triangle at the same float32 t. for_us, against:
others, decided by exact arithmetic. cannot_tell: others, so close that float64 cannot decide. hit_or_miss: of all rays,
those where one says hit and the other miss.
"""

import json
import pathlib
import sys

import support

KINDS = ["primary", "ao", "bounce"]
SMALL_TRIANGLES = 10_000
# name, files, options of the build; all in world space, as the oracle has them (tests/unit/traversal/instances_test.cc
# holds instances against objects of their own)
SCENES = [
    ("house", ["house/victorian_house.glb"], []),
    ("house_lattice", ["house/victorian_house.glb"], ["--positions", "lattice:18b"]),
    ("house_draco", ["house/victorian_house_draco.glb"], []),
    ("spaceship", ["spaceship/spaceship.glb"], []),
    ("two_cylinder_engine", ["two_cylinder_engine/2CylinderEngine.glb"], []),
    ("torque_forest", ["torque_forest/torque_forest.glb"], []),
    ("pmndrs_helicopter", ["pmndrs_helicopter/model.gltf"], []),
]
# Each file is a scene; rows are sums over those that hold a triangle that can be hit.
SMALL_FOLDERS = ["edge_validator", "edge_draco", "edge_tinygltf", "edge_assetgenerator"]
SHORT_SCENES = {"spaceship", "two_cylinder_engine", "pmndrs_helicopter"}


class Trial:
    def __init__(self, options, folder):
        self.options = options
        self.folder = pathlib.Path(folder)
        self.problems = []
        self.lists = []
        self.table = support.Table(scene=28, kind=8, rays=8, hits=8, agree=8, equal_t=7, for_us=6, cannot_tell=11,
                                   against=7, hit_or_miss=11, max_ulp=7)

    def row(self, name, kind, told):
        against = told["decided_against"] + told["both_wrong"] + told["bad_row"]
        self.table.row(name, kind, told["rays"], told["hits"], told["agrees"], told["same_t"], told["decided_for"],
                       told["float64_cannot_tell"], against, told["hit_or_miss_differs"],
                       f"{told['max_ulp']:.3f}")
        if not told["passed"]:
            self.problems.append(f"{name} {kind}: {against} decided against us, {told['over_four_ulp']} over 4 ulp")
        self.lists += [{"scene": name, "kind": kind, **entry} for entry in told["list"]]

    def judge(self, store, files, kind, count, positions):
        rays, hits = self.folder / "rays.npy", self.folder / "hits.npy"
        raymill = self.options.raymill
        made = support.Run([raymill, "rays", store, "--kind", kind, "--count", count, "-o", rays])
        if made.rc == 2 and "sees nothing" in made.stderr:
            return None
        made.need()
        query = ["--query", "any"] if kind == "any" else []
        support.run(raymill, "trace", store, rays, "-o", hits, *query)
        done = support.Run([self.options.oracle, *files, "--rays", rays, "--hits", hits, "--json", *positions])
        if done.rc not in (0, 1):
            done.need()
        return json.loads(done.stdout)

    def scene(self, name, files, build_options):
        store = self.folder / "scene.mill"
        built = support.run_json(self.options.raymill, "build", *files, "-o", store, "--memory", "8G", "--json",
                                 "--instances", "never", *build_options)
        count = min(self.options.rays, 100_000) if built["triangles"] < SMALL_TRIANGLES else self.options.rays
        for kind in KINDS:
            told = self.judge(store, files, kind, count, build_options)
            if told is None:
                self.problems.append(f"{name} {kind}: the camera sees nothing")
            else:
                self.row(name, kind, told)

    def small_files(self, name, folder):
        """All files of a folder that hold triangles, as one row for each kind."""
        refused, empty, built = [], [], []
        total = {}
        for file in sorted([*folder.rglob("*.gltf"), *folder.rglob("*.glb")]):
            store = self.folder / "scene.mill"
            done = support.Run([self.options.raymill, "build", file, "-o", store, "--instances", "never"])
            if done.rc != 0:
                done.need(42)
                (empty if "no triangle" in done.stderr else refused).append(file)
                continue
            built.append(file)
            for kind in KINDS:
                told = self.judge(store, [file], kind, min(self.options.rays, 100_000), [])
                if told is None:  # an edge-on triangle: rays all over its bounds instead
                    kind = f"({kind})"
                    told = self.judge(store, [file], "random", min(self.options.rays, 100_000), [])
                for entry in told["list"]:
                    entry["file"] = str(file.relative_to(folder))
                sum_up(total.setdefault(kind, {}), told)
        for kind, told in total.items():
            self.row(f"{name} ({told['files']} files)", kind, told)
        print(f"{name}: {len(built)} files built, {len(empty)} hold no triangle, {len(refused)} refused")


def sum_up(total, told):
    total["files"] = total.get("files", 0) + 1
    for key, value in told.items():
        if key in ("max_ulp", "max_barycentric_error"):
            total[key] = max(total.get(key, 0), value)
        elif key == "passed":
            total[key] = total.get(key, True) and value
        elif key != "worst_ray":
            total[key] = total.get(key, type(value)()) + value


def main():
    options = support.parser(__doc__)
    options.add_argument("--oracle", required=True, type=support.program)
    options.add_argument("--rays", type=int, default=1_000_000)
    options.add_argument("--scene", action="append", help="only this one; may be given again")
    options.add_argument("--list", type=pathlib.Path, help="write the rays that differ from Embree, as JSON")
    options = options.parse_args()
    scenes = support.scenes_folder()
    if scenes is None:
        print("left out: the scenes are not here (RAYMILL_SCENES)")
        return 0
    wanted = set(options.scene) if options.scene else SHORT_SCENES if options.short else None
    if options.short:
        options.rays = min(options.rays, 20_000)
    with support.work_folder(options) as folder:
        trial = Trial(options, folder)
        for name, files, build_options in SCENES:
            if wanted is None or name in wanted:
                trial.scene(name, [scenes / file for file in files], build_options)
        for name in SMALL_FOLDERS:
            if wanted is None or name in wanted:
                trial.small_files(name, scenes / name)
    if options.list:
        options.list.write_text(json.dumps(trial.lists, indent=1))
    return support.ended(trial.problems, "correctness")


if __name__ == "__main__":
    sys.exit(main())
