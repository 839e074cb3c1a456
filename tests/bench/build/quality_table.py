"""What a builder's choices are worth: leaf size, builder, splits, N and page size, tree cost and speed in one table.

    quality_table.py --raymill RAYMILL --trees TREES --work DIR [--scenes house.glb,forest:2M,city:2M] [--rays 30k]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it; the rays are bounce rays. First trees as
raymill-tree-quality builds them, over the whole scene and without pages: SAH cost, and nodes, leaves and triangles a ray,
which are counted and so the same on any machine. Then stores by N and page size: bytes a triangle, SAH cost, what a ray
visits, and user seconds of `raymill trace` with every page in memory, one worker, the compact layout; stores take turns
and the least of --repeat runs counts. All stores must give the same hits. Files in --work are named by what they hold and
used again. Prints tables, then one line of JSON for each row.
"""

import argparse
import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

WIDTHS = [4, 8]
PAGES = ["16K", "64K", "256K"]


class Quality:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def store(self, scene, width=8, page="64K"):
        """The store's path and the report of its build."""
        path = self.folder / f"{scene.stem}-{width}-{page}.mill"
        report = path.with_suffix(".json")
        if not report.exists():
            done = support.run(self.options.raymill, "build", scene, "-o", path, "--width", width, "--page-size", page,
                               "--json", "--progress", "none")
            report.write_text(json.dumps(json.loads(done.stdout) | {"user_seconds": done.user_seconds}))
        return path, json.loads(report.read_text())

    def rays(self, scene):
        path = self.folder / f"{scene.stem}-bounce-{self.options.rays}.npy"
        if not path.exists():
            store, _ = self.store(scene)
            support.run(self.options.raymill, "rays", store, "--kind", "bounce", "--count", self.options.rays, "-o", path)
        return path

    def trees(self, scene):
        table = support.Table(tree=16, N=3, references=10, nodes=7, SAH=7, nodes_ray=9, leaves_ray=10, triangles_ray=13,
                              seconds=8)
        command = [self.options.trees, self.store(scene)[0], self.rays(scene), "--widths", ",".join(map(str, WIDTHS))]
        command += ["--trees", self.options.choices] if self.options.choices else []
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
        if done.returncode == 1:
            self.problems.append(f"{scene.stem}: hits differ between trees")
        elif done.returncode != 0:
            raise support.Failure(f"{self.options.trees.name}: {done.stderr}")
        for line in map(json.loads, done.stdout.splitlines()):
            self.lines.append({"scene": scene.stem} | line)
            table.row(line["tree"], line["width"], f"{line['references_per_triangle']:.3f}",
                      f"{line['wide_nodes_per_triangle']:.3f}", f"{line['sah_cost']:.2f}",
                      f"{line['nodes_per_ray']:.2f}", f"{line['leaves_per_ray']:.2f}",
                      f"{line['triangles_per_ray']:.2f}", f"{line['build_seconds']:.2f}")

    def trace(self, store, scene):
        """The run's figures, with its user seconds and the hash of its hits."""
        hits = self.folder / "hits.npy"
        done = support.run(self.options.raymill, "trace", store, self.rays(scene), "-o", hits, "--layout", "compact",
                           "--threads", 1, "--memory", "8G", "--json", "--progress", "none")
        return json.loads(done.stdout) | {"user_seconds": done.user_seconds, "hash": support.sha256(hits)}

    def stores(self, scene):
        built = {(width, page): self.store(scene, width, page) for width in WIDTHS for page in PAGES}
        runs = {choice: [] for choice in built}
        for _ in range(self.options.repeat):
            for choice, (store, _) in built.items():
                runs[choice].append(self.trace(store, scene))
        if len({run["hash"] for its in runs.values() for run in its}) != 1:
            self.problems.append(f"{scene.stem}: stores give different hits")
        table = support.Table(N=3, page=5, pages=7, B_tri=6, SAH=7, nodes_ray=9, pages_ray=9, triangles_ray=13, seconds=8,
                              build=7)
        for (width, page), its in runs.items():
            report, run = built[width, page][1], its[0]
            line = {"scene": scene.stem, "width": width, "page": page, "pages": report["pages"],
                    "bytes_per_triangle": report["store_bytes"] / report["triangles"], "sah_cost": report["sah_cost"],
                    "nodes_per_ray": run["nodes_visited"] / run["rays"],
                    "pages_per_ray": run["pages_entered"] / run["rays"],
                    "triangles_per_ray": run["triangles_tested"] / run["rays"],
                    "user_seconds": min(one["user_seconds"] for one in its),
                    "build_user_seconds": report["user_seconds"]}
            self.lines.append(line)
            table.row(width, page, line["pages"], f"{line['bytes_per_triangle']:.2f}", f"{line['sah_cost']:.2f}",
                      f"{line['nodes_per_ray']:.2f}", f"{line['pages_per_ray']:.2f}", f"{line['triangles_per_ray']:.2f}",
                      f"{line['user_seconds']:.2f}", f"{line['build_user_seconds']:.1f}")

    def run(self):
        for name in self.options.scenes.split(","):
            scene = support.scene(self.options.raymill, self.folder, name)
            print(f"{scene.stem}, {self.options.rays} bounce rays")
            self.trees(scene)
            self.stores(scene)


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program)
    options.add_argument("--trees", required=True, type=support.program, help="raymill-tree-quality")
    options.add_argument("--work", type=support.folder,
                         help="folder for scenes, stores and rays; default: one that is removed")
    options.add_argument("--scenes", default="terrain:2M,forest:2M,city:2M", help="separated by commas (%(default)s)")
    options.add_argument("--rays", default="30k", help="of each scene (%(default)s)")
    options.add_argument("--choices", help="trees, as raymill-tree-quality takes them; default: its own")
    options.add_argument("--repeat", default=3, type=int, help="(%(default)s)")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.scenes, options.rays, options.repeat = "city:20k", "2k", 1
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(Quality, parse(), "quality table"))
