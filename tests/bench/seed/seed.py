"""The algorithms of Afra & Szirmay-Kalos 2014 beside each other, one ray at a time, in core.

    seed.py --raymill RAYMILL --bench BENCH --work DIR [--scenes house.glb,terrain:2M,city:10M] [--rays 500k]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it. Bounce rays are the paper's diffuse path tracing,
primary rays its coherent case. Files in --work are named by what they hold and used again. Prints the tables of
raymill-seed (main.cc) for each scene and kind of rays, then the overhead of going without a stack, over all of them.
"""

import argparse
import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

KINDS = ["bounce", "primary"]


class Seed:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def store(self, scene):
        path = self.folder / f"{scene.stem}.mill"
        if not path.exists():
            support.run(self.options.raymill, "build", scene, "-o", path)
        return path

    def rays(self, store, kind):
        path = self.folder / f"{store.stem}-{kind}-{self.options.rays}.npy"
        if not path.exists():
            support.run(self.options.raymill, "rays", store, "--kind", kind, "--count", self.options.rays, "-o", path)
        return path

    def measure(self, store, kind):
        """Prints the tables of one file of rays; its line is kept."""
        words = [self.options.bench, store, self.rays(store, kind), "--repeat", self.options.repeat]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise support.Failure(f"{self.options.bench.name}: {done.stderr}")
        *tables, line = done.stdout.splitlines()
        print("\n".join(tables), flush=True)
        self.lines.append(json.loads(line) | {"kind": kind})
        if done.returncode == 1:
            self.problems.append(f"{self.lines[-1]['name']}: {done.stderr.strip()}")

    def run(self):
        for name in self.options.scenes.split(","):
            store = self.store(support.scene(self.options.raymill, self.folder, name))
            for kind in KINDS:
                self.measure(store, kind)
        self.print_overheads()

    def print_overheads(self):
        print("overhead over the stack of the same width, %")
        table = support.Table(algorithm=22, N=3, rays=8, least=7, most=7)
        for kind in KINDS:
            rows = [row for line in self.lines if line["kind"] == kind for row in line["algorithms"]]
            names = dict.fromkeys((row["name"], row["width"]) for row in rows if row["name"] != "stack")
            for name, width in names:
                its = [row["overhead_percent"] for row in rows if (row["name"], row["width"]) == (name, width)]
                table.row(name, width, kind, f"{min(its):.1f}", f"{max(its):.1f}")


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program)
    options.add_argument("--bench", required=True, type=support.program, help="raymill-seed")
    options.add_argument("--work", type=support.folder,
                         help="folder for scenes, stores and rays; default: one that is removed")
    options.add_argument("--scenes", default="terrain:2M,city:10M", help="separated by commas (%(default)s)")
    options.add_argument("--rays", default="500k", help="of each kind (%(default)s)")
    options.add_argument("--repeat", default=5, type=int, help="(%(default)s)")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.scenes, options.rays, options.repeat = "terrain:20k", "5k", 1
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(Seed, parse(), "seed"))
