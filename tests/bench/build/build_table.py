"""What a build out of core costs: peak memory, temporary bytes, triangles a second, bytes a triangle, for each codec.

    build_table.py --raymill RAYMILL [--one-run ONE_RUN] --work DIR [--triangles 300M] [--memory 1G] [--codecs LIST]

Each codec builds the same generated scene under --memory. A codec's name may carry positions: draco@lattice:16b. The run
fails where the process was larger than --memory by the kernel's count, where a file is left beside the store, or where the
store is of another size than was said. With --one-run the SAH cost of a scene of --sah-triangles is set beside that of one
build over everything in memory; more than 5 % above it is a failure.
Prints a table, then one line of JSON for each run.
"""

import argparse
import json
import pathlib
import shlex
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

MOST_ABOVE_ONE_RUN = 1.05
UNITS = {"K": 10, "M": 20, "G": 30, "T": 40}


def size(text):
    """Bytes, as raymill takes them: 1G."""
    return int(text[:-1]) << UNITS[text[-1]] if text[-1] in UNITS else int(text)


class Bench:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def scene(self, triangles):
        """The generated scene of so many triangles, in a folder of its own."""
        path = self.folder / f"{self.options.kind}-{triangles}" / "scene.gltf"
        if self.options.scene and triangles == self.options.triangles:
            return self.options.scene
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            support.run(self.options.raymill, "generate", self.options.kind, "--triangles", triangles, "-o", path)
        return path

    def build(self, scene, codec, memory):
        """Builds and checks what can be checked; returns the report, with the kernel's peak and the seconds."""
        name, _, positions = codec.partition("@")
        out = self.folder / "out"
        out.mkdir(exist_ok=True)
        store = out / f"{name}.mill"
        before = {store, *out.iterdir()}  # with --keep the stores of other codecs and runs
        done = support.Run([self.options.raymill, "build", scene, "-o", store, "--codec", name, "--positions",
                            positions or "float32", "--memory", memory, "--json", "--progress", "none",
                            *shlex.split(self.options.build)]).need()
        told = json.loads(done.stdout)
        told.update(codec=codec, memory_bytes=size(memory), wall_seconds=done.seconds, kernel_peak_bytes=done.rss_bytes)
        peak = max(told["peak_rss_bytes"], done.rss_bytes)
        if peak > told["memory_bytes"]:
            self.problems.append(f"{codec}: a peak of {support.mib(peak)} MiB under --memory {memory}")
        if store.stat().st_size != told["store_bytes"]:
            self.problems.append(f"{codec}: the store has {store.stat().st_size} bytes, not {told['store_bytes']}")
        left = sorted(path.name for path in out.iterdir() if path not in before)
        if left:
            self.problems.append(f"{codec}: left beside the store: {', '.join(left)}")
        if not self.options.keep:
            store.unlink()
        self.lines.append(told)
        return told

    def codecs(self):
        options = self.options
        scene = self.scene(options.triangles)
        print(f"{options.kind}, {options.triangles} triangles, --memory {options.memory}")
        table = support.Table(codec=18, Mtri_s=7, seconds=8, imported=8, parted=7, built=7, peak=8, temporary=10,
                              store=9, B_tri=6, runs=5)
        for codec in options.codecs.split(","):
            told = self.build(scene, codec, options.memory)
            seconds, triangles = told["seconds"], told["triangles"]
            table.row(codec, f"{triangles / told['wall_seconds'] / 1e6:.2f}", f"{told['wall_seconds']:.1f}",
                      f"{seconds['import']:.1f}", f"{seconds['partition']:.1f}", f"{seconds['build']:.1f}",
                      support.mib(max(told["peak_rss_bytes"], told["kernel_peak_bytes"])),
                      support.mib(told["temporary_bytes"]), support.mib(told["store_bytes"]),
                      f"{told['store_bytes'] / triangles:.2f}", told["runs"])

    def sah(self):
        options = self.options
        scene = self.scene(options.sah_triangles)
        cut = self.build(scene, "raw", options.memory)
        whole = support.run_json(options.one_run, scene)
        ratio = cut["sah_cost"] / whole["sah_cost"]
        self.lines.append({"codec": "raw", "one_run": whole, "sah_ratio": ratio})
        print(f"SAH cost, {options.sah_triangles} triangles: {cut['sah_cost']:.4f} in {cut['runs']} runs, "
              f"{whole['sah_cost']:.4f} in {whole['runs']}: {(ratio - 1) * 100:+.2f} %")
        if ratio > MOST_ABOVE_ONE_RUN:
            self.problems.append(f"SAH cost is {(ratio - 1) * 100:.1f} % above that of one run")

    def run(self):
        self.codecs()
        if self.options.one_run:
            self.sah()


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program, help="the program: B/bin/raymill")
    options.add_argument("--one-run", type=support.program,
                         help="B/tests/bench/build/raymill-one-run; without it no SAH cost is compared")
    options.add_argument("--work", type=support.folder, help="folder for scenes, which stay; default: one that is removed")
    options.add_argument("--scene", type=lambda path: pathlib.Path(path).resolve(),
                         help="a glTF file in place of the generated one; --triangles then only names it")
    options.add_argument("--kind", default="mixed", help="of the generated scenes (%(default)s)")
    options.add_argument("--triangles", default="300M", help="of the scene that is built (%(default)s)")
    options.add_argument("--memory", default="1G", help="of each build (%(default)s)")
    options.add_argument("--codecs", default="zstd,lz4,raw,draco@lattice:20b", help="(%(default)s)")
    options.add_argument("--sah-triangles", default="20M", help="of the scene whose SAH cost is compared (%(default)s)")
    options.add_argument("--build", default="", help="more options of raymill build, e.g. '--threads 1'")
    options.add_argument("--keep", action="store_true", help="keep the stores, in --work/out")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.triangles, options.memory, options.sah_triangles = "300K", "100M", "500K"
    return options


def main():
    return support.run_bench(Bench, parse(), "build table")


if __name__ == "__main__":
    sys.exit(main())
