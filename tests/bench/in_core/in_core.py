"""Rays per second with every page in memory, beside Embree on the same rays in the same process.

    in_core.py --raymill RAYMILL --bench BENCH --work DIR [--scenes house.glb,terrain:2M,city:10M] [--rays 500k]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it. Primary and bounce rays, the latter in order and
shuffled, ask for the closest hit; shadow and ambient occlusion rays, the latter in order and shuffled, for any. Primary
and shadow rays are called coherent, and Embree's packets and streams are told so. Files in --work are named by what
they hold and used again. Prints a table of million rays a second (raymill-in-core, main.cc), then geometric means of
ratios: how often our best is the peer's rate. With --single only Embree's single rays stand beside ours. With --modes
what watertight and exact cost: the time of each layout's kernel against mode fast, within a repetition; no Embree.
--runs FILE.jsonl adds the lines to those of earlier runs, with the time and the commit; runs_plot.py draws them.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

COHERENT = ["primary", "shadow"]
KINDS = {"closest": ["primary", "bounce", "bounce-shuffled"], "any": ["shadow", "ao", "ao-shuffled"]}
TRACERS = ["expanded", "sort+expanded", "compact", "sort+compact", "engine", "embree1", "sort+embree1", "embree8", "embree16", "sort+embree16",
           "embree-stream"]
OURS = ["expanded", "sort+expanded", "compact", "sort+compact"]
SINGLE, SORTED, PACKETS = ["embree1"], ["sort+embree1"], ["embree16", "embree-stream"]
MODES = [f"{layout}/{mode}" for layout in ("expanded", "compact") for mode in ("watertight", "exact")]
# What is set beside our best: name, whose kinds, which peers.
MEANS = [("incoherent closest / embree1", ["bounce-shuffled"], SINGLE),
         ("incoherent closest / sort+embree1", ["bounce-shuffled"], SORTED),
         ("closest in order / embree1", ["bounce"], SINGLE),
         ("coherent closest / best of packets and streams", ["primary"], PACKETS),
         ("any shuffled / embree1", ["ao-shuffled"], SINGLE),
         ("any coherent / best of packets and streams", ["shadow"], PACKETS)]


def ratios(lines, kinds, peers):
    """Of our best to the peers' best, for each line of such rays."""
    return [InCore.best(line, OURS) / InCore.best(line, peers) for line in lines
            if line["kind"] in kinds and any(peer in line["tracers"] for peer in peers)]


def geometric_mean(numbers):
    return math.exp(sum(map(math.log, numbers)) / len(numbers))


class InCore:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def rays(self, store, kind):
        path = self.folder / f"{store.stem}-{kind}-{self.options.rays}.npy"
        if not path.exists():
            shuffle = ["--shuffle"] if kind.endswith("-shuffled") else []
            support.run(self.options.raymill, "rays", store, "--kind", kind.split("-")[0], "--count", self.options.rays,
                        *shuffle, "-o", path)
        return path

    def measure(self, scene, store, query, kind):
        """The line of one file of rays."""
        options = self.options
        words = [options.bench, scene, store, self.rays(store, kind), "--query", query, "--mode", options.mode,
                 "--repeat", str(options.repeat)]
        words += ["--modes", "--no-embree"] if options.modes else ["--engine", "--sort"]
        words += ["--all-calls"] if not options.single and not options.modes else []
        words += ["--coherent"] if kind in COHERENT else []
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise support.Failure(f"{options.bench.name}: {done.stderr}")
        line = json.loads(done.stdout)
        line["kind"] = kind
        if done.returncode == 1:
            different = {name: its["different"] for name, its in line["tracers"].items() if its["different"]}
            self.problems.append(f"{line['name']}: hits differ from ours: {different}")
        return line

    def run(self):
        table = support.Table(scene=14, rays=16, **{name: max(6, len(name)) for name in TRACERS})
        for name in self.options.scenes.split(","):
            scene = support.scene(self.options.raymill, self.folder, name)
            store = self.folder / f"{scene.stem}.mill"
            if not store.exists():
                support.run(self.options.raymill, "build", scene, "-o", store)
            for query, kinds in KINDS.items():
                for kind in kinds:
                    line = self.measure(scene, store, query, kind)
                    self.lines.append(line)
                    table.row(scene.stem[:14], kind, *(self.rate(line, tracer) for tracer in TRACERS))
        for name, kinds, peers in MEANS:
            self.mean(name, ratios(self.lines, kinds, peers))
        for tracer in MODES:
            self.mean(f"time of {tracer} / fast", [line["tracers"][tracer]["kernel_ratio"]["median"]
                                                   for line in self.lines if tracer in line["tracers"]])

    @staticmethod
    def mean(name, numbers):
        if numbers:
            print(f"{name}: {geometric_mean(numbers):.2f} ({min(numbers):.2f} to {max(numbers):.2f})")

    @staticmethod
    def rate(line, tracer):
        its = line["tracers"].get(tracer)
        return f"{its['mrays_per_second']['median']:.2f}" if its else "-"

    @staticmethod
    def best(line, tracers):
        return max(line["tracers"][name]["mrays_per_second"]["median"] for name in tracers if name in line["tracers"])


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program)
    options.add_argument("--bench", required=True, type=support.program, help="raymill-in-core")
    options.add_argument("--work", type=support.folder, help="folder for scenes, stores and rays; default: one that is removed")
    options.add_argument("--scenes", default="terrain:2M,city:10M,forest:10M", help="separated by commas (%(default)s)")
    options.add_argument("--rays", default="500k", help="of each kind (%(default)s)")
    options.add_argument("--mode", default="watertight", help="watertight, fast or exact (%(default)s)")
    options.add_argument("--repeat", default=5, type=int, help="(%(default)s)")
    options.add_argument("--single", action="store_true", help="leave out Embree's packets and streams")
    options.add_argument("--modes", action="store_true", help="what the modes cost, fast first, without Embree")
    options.add_argument("--runs", type=pathlib.Path, help="file of earlier runs' lines, to which this run's are added")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.scenes, options.rays, options.repeat = "terrain:20k,city:20k", "20k", 1
    options.mode = "fast" if options.modes else options.mode
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(InCore, parse(), "in core"))
