"""Reads by policy and eviction: every way to choose the page to read times every way to choose the one that goes.

    policy_table.py --raymill RAYMILL --belady B/tests/bench/out_of_core/raymill-belady --work DIR [--triangles 4M]
    policy_table.py ... --store X.mill --rays-file RAYS.npy --fractions 25,5      # on what is there already

Each run writes the pages that its batches entered (raymill trace --page-trace); raymill-belady tells the fewest reads
that the same requests, in the same order, could have done with in as many frames. That bounds what another victim could
save in this run, not what another order of work could: a page more in memory lets other rays go on, and other requests
follow. Recording costs a few percent of the time; --no-belady leaves it out.

Reads are counts and differ by a percent or two between runs of two threads; krays/s by whatever else the machine does.
Every run must give the same hits (sha256) and stay within its memory. Prints a table, then a line of JSON for each run.
"""

import argparse
import json
import os
import pathlib
import shlex
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402
from budget_curve import drop_caches, numbers  # noqa: E402

POLICIES = "score,most-rays,fifo,sweep"
EVICTIONS = "clock,demand"


class PolicyTable:
    def __init__(self, options, folder):
        self.options = options
        self.folder = folder
        self.lines = []
        self.problems = []
        self.truths = {}  # by rays: the first run's hash
        self.table = None

    def make(self):
        """The store and the rays, unless they are there."""
        options = self.options
        self.store = options.store or self.folder / f"{options.kind}-{options.triangles}.mill"
        if not self.store.exists():
            scene = self.folder / f"{self.store.stem}.gltf"
            support.run(options.raymill, "generate", options.kind, "--triangles", options.triangles, "-o", scene)
            support.run(options.raymill, "build", scene, "-o", self.store, "--memory", options.make_memory,
                        *shlex.split(options.build))
        self.rays = list(options.rays_file)
        for kind in options.kinds.split(",") if not self.rays else []:
            self.rays.append(self.folder / f"{self.store.stem}-{kind}-{options.rays}.npy")
            if not self.rays[-1].exists():
                support.run(options.raymill, "rays", self.store, "--kind", kind, "--count", options.rays, "--memory",
                            options.make_memory, "--shuffle", "-o", self.rays[-1])
        self.info = support.run_json(options.raymill, "info", self.store, "--json", "--threads", options.threads)

    def bound(self, pages):
        if not self.options.belady:
            return {}
        told = support.run_json(self.options.belady, pages)
        pages.unlink()
        return {key: told[key] for key in ("frames", "batches", "requests", "belady_reads")}

    def trace(self, rays, fraction, policy, eviction):
        memory = max(int(self.info["decoded_bytes"] * fraction / 100), self.info["least_memory_bytes"])
        hits, stats, pages = (self.folder / name for name in ("hits.npy", "stats.json", "run.pages"))
        record = ["--page-trace", pages] if self.options.belady else []
        for _ in range(8):
            drop_caches()
            done = support.Run([self.options.raymill, "trace", self.store, rays, "-o", hits, "--memory", memory,
                                "--threads", self.options.threads, "--stats", stats, "--progress", "none", "--policy",
                                policy, "--eviction", eviction, *record])
            if done.rc != 33:
                break
            memory = support.more_memory(memory, done.stderr)
        told = json.loads(done.need() and stats.read_text())
        digest = support.sha256(hits)
        hits.unlink()
        label = f"{rays.stem} {fraction:g}% {policy} {eviction}"
        if digest != self.truths.setdefault(rays, digest):
            self.problems.append(f"{label}: other hits than the first run")
        peak = max(told["peak_rss_bytes"], done.rss_bytes)
        if peak > memory:
            self.problems.append(f"{label}: {support.mib(peak)} MiB of {support.mib(memory)} MiB")
        bound = self.bound(pages)
        if bound and told["pages_read"] < bound["belady_reads"]:
            self.problems.append(f"{label}: {told['pages_read']} reads, fewer than Belady's {bound['belady_reads']}")
        self.lines.append({"rays": rays.stem, "percent": fraction, "policy": policy, "eviction": eviction,
                           "memory_bytes": memory, "threads": told["threads"], "ray_count": told["rays"],
                           **{key: told[key] for key in ("seconds", "rays_per_second", "pages_read", "bytes_read",
                                                         "distinct_pages", "amplification", "evictions", "rays_parked",
                                                         "decode_seconds", "idle_seconds", "io", "isa")},
                           "peak_rss_bytes": peak, "sha256": digest, **bound})
        best = bound.get("belady_reads")
        self.table.row(f"{fraction:g}% {policy}", eviction, told["pages_read"], best or "-",
                       f"{told['pages_read'] / best:.2f}" if best else "-", support.mib(told["bytes_read"]),
                       f"{told['amplification']:.2f}", f"{told['rays_per_second'] / 1000:.1f}", support.mib(peak))

    def run(self):
        self.make()
        options = self.options
        print(f"{self.store.name}: {self.info['triangles']} triangles, {self.info['pages']} pages, decoded "
              f"{support.mib(self.info['decoded_bytes'])} MiB; least memory "
              f"{support.mib(self.info['least_memory_bytes'])} MiB")
        for rays in self.rays:
            print(rays.stem)
            self.table = support.Table(run=18, eviction=9, reads=9, belady=9, ratio=6, MiB_read=9, amplif=7, krays=8,
                                       peak=8)
            for fraction in options.fractions:
                for policy in options.policies.split(","):
                    for eviction in options.evictions.split(","):
                        self.trace(rays, fraction, policy, eviction)


def parse():
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program, help="the program: B/bin/raymill")
    options.add_argument("--belady", type=support.program, help="B/tests/bench/out_of_core/raymill-belady")
    options.add_argument("--no-belady", action="store_true", help="leave out the page traces and the bound")
    options.add_argument("--store", type=lambda path: pathlib.Path(path).resolve(), help="a store that is there")
    options.add_argument("--rays-file", type=lambda path: pathlib.Path(path).resolve(), action="append", default=[],
                         help="rays that are there; may be repeated")
    options.add_argument("--triangles", default="4M", help="of a generated scene (%(default)s)")
    options.add_argument("--kind", default="mixed", help="of a generated scene: as raymill generate (%(default)s)")
    options.add_argument("--work", type=support.folder, help="folder for files, which stay; default: one that is removed")
    options.add_argument("--rays", default="1M", help="how many of each kind (%(default)s)")
    options.add_argument("--kinds", default="bounce,random", help="as raymill rays (%(default)s)")
    options.add_argument("--fractions", type=numbers, default=numbers("25,10,5"),
                         help="percent of the decoded store (25,10,5)")
    options.add_argument("--policies", default=POLICIES, help="(%(default)s)")
    options.add_argument("--evictions", default=EVICTIONS, help="(%(default)s)")
    options.add_argument("--threads", default=str(os.cpu_count()), help="of Raymill (%(default)s)")
    options.add_argument("--build", default="", help="more options of raymill build, e.g. '--page-size 256K'")
    options.add_argument("--make-memory", default=str(half), help="--memory of making store and rays (half of all)")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.triangles, options.rays, options.kinds, options.fractions = "500k", "20k", "bounce", [25]
        options.build += " --page-size 16K"
    if options.no_belady:
        options.belady = None
    elif options.belady is None:
        sys.exit("policy_table.py: --belady PROGRAM, or --no-belady")
    return options


def main():
    return support.run_bench(PolicyTable, parse(), "policy table")


if __name__ == "__main__":
    sys.exit(main())
