"""Scenes, stores, budgets and rays by lot: the same hits as in core, and the process within its memory.

    stress.py --raymill RAYMILL [--minutes M] [--seed S] [--keep-going] [--short]

Each seed chooses a generated scene (kind, 10 k to 1 M triangles), how it is built (width, page size, codec, positions),
a batch of rays (kind, count, order), a query, and a few ways to trace it: threads, memory from the least that the store
needs to all of it, how pages are read, instruction set, and whatever policies the program offers; where the rays are few,
half of the runs have the adversarial schedule, which suspends each ray at every node and evicts a page after each batch.
The first trace is in core, of one thread; the others must give the same bytes. Peaks (--stats and wait4) must lie within --memory; as root
some runs are in a memory cgroup of that size too. Any other end than 0, and a run that takes too long, is a failure.

A failure prints the command that repeats its seed and keeps its files. Ends with "N seeds run, F failures".
"""

import json
import pathlib
import random
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "trial"))

import support  # noqa: E402
from memory_cgroup import MemoryCgroup  # noqa: E402

KINDS = ["terrain", "city", "forest", "mixed", "woods"]
CODECS = ["raw", "lz4", "zstd", "draco"]
PAGES = ["16K", "32K", "64K", "128K", "256K", "1M"]
RAY_KINDS = ["primary", "ao", "bounce", "random", "shadow"]
FIELDS = ["t", "t,uv,primitive_id,geometry_id", "ids", "normal", "all"]
# A run is given so long before it counts as hanging: the slowest, the least memory for 1 M rays, takes tens of seconds.
HANG_SECONDS = 600
IN_CORE_BYTES = 4 << 30
# Where --policy and the like exist, `raymill trace --help` lists their values as NAME:{a,b,c}.
POLICY_OPTIONS = ["--policy", "--eviction"]
# The adversarial schedule reads a page for each few nodes: only small lots get it.
MOST_ADVERSARIAL_RAYS = 10000


def choices(raymill, option):
    """What an option of raymill trace may be, from its help; empty where there is none."""
    told = subprocess.run([raymill, "trace", "--help"], capture_output=True, text=True, check=True).stdout
    found = re.search(re.escape(option) + r"\s+\w+:\{([^}]*)\}", " ".join(told.split()))
    return found[1].replace(" ", "").split(",") if found else []


class Lot:
    """What a seed chooses; the same seed, the same choice, whatever the machine."""

    def __init__(self, seed, short):
        self.random = random.Random(seed)
        draw = self.random
        self.scene_kind = draw.choice(KINDS)
        self.triangles = int(10 ** draw.uniform(4, 5.5 if short else 6))
        self.scene_seed = draw.randrange(1000)
        self.positions = draw.choice(["float32", "float32", "lattice:16b", "lattice:20b"])
        codecs = CODECS if self.positions.startswith("lattice") else CODECS[:-1]
        self.build = ["--width", draw.choice(["4", "8"]), "--page-size", draw.choice(PAGES), "--codec",
                      draw.choice(codecs), "--positions", self.positions]
        self.rays = ["--kind", draw.choice(RAY_KINDS), "--count", str(int(10 ** draw.uniform(2.5, 4.5 if short else 5.7))),
                     "--seed", str(draw.randrange(1000)), *draw.choice([[], ["--shuffle"]])]
        query = draw.choice(["closest", "closest", "any"])
        self.query = ["--query", query, "--mode", draw.choice(["watertight", "watertight", "fast", "exact"])]
        if query == "closest":
            self.query += ["--fields", draw.choice(FIELDS)]
        self.runs = [{"threads": draw.randint(1, 4), "share": draw.choice([0, 0, draw.random(), 1]),
                      "cgroup": draw.random() < 0.4, "adversarial": draw.random() < 0.5}
                     for _ in range(3 if short else 5)]

    def scene(self):
        # Woods are of instances: as many triangles as that in a few hundred of them.
        size = [str(100 * self.triangles), "--meshes", "7"] if self.scene_kind == "woods" else [str(self.triangles)]
        return [self.scene_kind, "--triangles", *size, "--seed", str(self.scene_seed)]


class Stress:
    def __init__(self, options):
        self.options = options
        self.ways = {option: choices(options.raymill, option) for option in ["--io", *POLICY_OPTIONS]}
        self.ways = {option: values for option, values in self.ways.items() if values}
        self.ways["--isa"] = ["scalar", "avx2", "avx512"]
        self.cgroup_refusal = MemoryCgroup.refusal()
        self.refused = set()  # values of options that this machine has not: once told, not drawn again
        self.traces = self.pages_read = self.pages_again = 0

    def call(self, *command, **more):
        try:
            return support.Run([self.options.raymill, *command], timeout=HANG_SECONDS, **more)
        except subprocess.TimeoutExpired as expired:
            raise support.Failure(f"{shlex.join(map(str, command))}\n  hangs for {HANG_SECONDS} s") from expired

    def seed(self, seed, folder):
        lot = Lot(seed, self.options.short)
        scene, store, rays = folder / "scene.gltf", folder / "scene.mill", folder / "rays.npy"
        self.call("generate", *lot.scene(), "-o", scene).need()
        self.call("build", scene, "-o", store, "--memory", "2G", *lot.build).need()
        self.call("rays", store, *lot.rays, "--memory", "2G", "-o", rays).need()
        truth = self.trace(folder, "truth.npy", ["--memory", IN_CORE_BYTES, "--threads", "1"], lot)
        decoded = support.run_json(self.options.raymill, "info", store, "--json")["decoded_bytes"]
        digest = support.sha256(folder / "truth.npy")
        for run in lot.runs:
            self.budgeted(folder, lot, run, decoded, digest)
        return truth["rays"]

    def trace(self, folder, hits, options, lot, cgroup=None):
        """The figures of a trace that must succeed."""
        return self.checked(self.start(folder, hits, options, lot, cgroup), folder)

    def start(self, folder, hits, options, lot, cgroup=None):
        self.traces += 1
        return self.call("trace", folder / "scene.mill", folder / "rays.npy", "-o", folder / hits, "--stats",
                         folder / "stats.json", "--progress", "none", *lot.query, *options,
                         cgroup=cgroup.path if cgroup else None)

    def checked(self, done, folder):
        done.need()
        told = json.loads((folder / "stats.json").read_text())
        self.pages_read += told["pages_read"]
        self.pages_again += told["pages_read"] - told["distinct_pages"]
        told["peak_bytes"] = max(told["peak_rss_bytes"], done.rss_bytes)
        return told

    def budgeted(self, folder, lot, run, decoded, digest):
        options = ["--threads", str(run["threads"])]
        adversarial = run["adversarial"] and int(lot.rays[3]) <= MOST_ADVERSARIAL_RAYS
        for option, values in self.ways.items():
            value = lot.random.choice(values)
            if (option, value) not in self.refused:
                options += [option, value]
        info = support.run_json(self.options.raymill, "info", folder / "scene.mill", "--json", "--threads",
                                str(run["threads"]))
        least = info["least_memory_bytes"]
        memory = int(least + run["share"] * max(decoded - least, 0))
        cgroup = None
        for _ in range(8):
            if run["cgroup"] and self.cgroup_refusal is None:
                cgroup = MemoryCgroup.create(memory)
            try:
                flags = ["--adversarial"] if adversarial else []
                done = self.start(folder, "hits.npy", [*options, *flags, "--memory", memory], lot, cgroup)
            finally:
                if cgroup is not None:
                    cgroup.close()
            if done.rc == 2 and self.drop_refused(options, done.stderr):
                continue
            if done.rc != 33:
                break
            memory = support.more_memory(memory, done.stderr)
        told = self.checked(done, folder)
        what = shlex.join(map(str, done.command))
        if told["peak_bytes"] > memory:
            raise support.Failure(f"{what}\n  took {told['peak_bytes']} bytes of {memory}")
        if support.sha256(folder / "hits.npy") != digest:
            raise support.Failure(f"{what}\n  gives other hits than in core")
        (folder / "hits.npy").unlink()

    def drop_refused(self, options, stderr):
        """Takes out what this machine has not (io_uring, AVX2); whether there was any."""
        option = "--io" if "refused here" in stderr else "--isa" if "this machine runs" in stderr else None
        for at in range(0, len(options), 2):
            if options[at] == option:
                self.refused.add((options[at], options[at + 1]))
                print(f"left out: {options[at]} {options[at + 1]} ({stderr.strip()})")
                del options[at:at + 2]
                return True
        return False

    def again(self, seed):
        short = ["--short"] if self.options.short else []
        return shlex.join(["stress.py", "--raymill", str(self.options.raymill), "--seed", str(seed), "--seeds", "1",
                           *short])

    def run(self):
        options = self.options
        print("by lot: " + "; ".join(f"{option} {' '.join(values)}" for option, values in self.ways.items()))
        if self.cgroup_refusal:
            print(f"left out: the memory cgroup ({self.cgroup_refusal})")
        end = time.monotonic() + options.minutes * 60
        seeds = failures = 0
        while (time.monotonic() < end or seeds == 0) and seeds != options.seeds:
            seed = options.seed + seeds
            folder = pathlib.Path(tempfile.mkdtemp(prefix=f"raymill-stress-{seed}-", dir=options.work))
            seeds += 1
            try:
                begin = time.monotonic()
                rays = self.seed(seed, folder)
                if options.verbose:
                    lot = Lot(seed, options.short)
                    print(f"{seed}: {lot.scene_kind} {lot.triangles}, {' '.join(lot.build[1::2])}, {rays} "
                          f"{lot.rays[1]}, {' '.join(lot.query[1::2])}, {time.monotonic() - begin:.1f} s", flush=True)
            except support.Failure as failure:
                failures += 1
                print(f"FAILED: seed {seed}: {failure}\n  again: {self.again(seed)}\n  files: {folder}", flush=True)
                if not options.keep_going:
                    break
                continue
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
            shutil.rmtree(folder, ignore_errors=True)
        print(f"{self.traces} traces, {self.pages_read} pages read, {self.pages_again} of them again")
        print(f"{seeds} seeds run, {failures} failures", flush=True)
        return 1 if failures else 0


def main():
    options = support.parser(__doc__)
    options.add_argument("--minutes", type=float, default=10, help="begins no seed after so long (%(default)g)")
    options.add_argument("--seed", type=int, help="the first seed; others follow it. Default: by the clock; --short: 1")
    options.add_argument("--seeds", type=int, default=-1, help="at most so many")
    options.add_argument("--keep-going", action="store_true", help="go on after a failure")
    options.add_argument("--verbose", action="store_true", help="a line for each seed")
    options = options.parse_args()
    if options.short:
        options.minutes = 20 / 60
    if options.seed is None:
        options.seed = 1 if options.short else int(time.time()) % 10 ** 6 * 1000
    print(f"seed {options.seed} and on, {options.minutes:g} minutes", flush=True)
    return Stress(options).run()


if __name__ == "__main__":
    sys.exit(main())
