"""Rays per second by memory: raymill trace under ever smaller budgets, and Embree in swap at the same bytes.

    budget_curve.py --raymill RAYMILL --peer PEER [--scene S.gltf | --triangles 60M --kind mixed] --work DIR [--rays 10M]

1. Raymill under --fractions of the decoded store, cold: direct reads, and the page cache dropped before each run (as
   root). A fraction below the least that the store needs is run with the least, once.
2. Embree (raymill-peer: rtcIntersect1, not robust, default build) in a version 1 memory cgroup. It builds without a
   limit and drops the arrays that it was built from; what is resident then is its need. Then the limit is lowered to
   --peer-fractions of that need, with swap in a file of this bench's own, and it traces for --seconds. At 100 there is
   no limit.
3. Raymill with --memory at the same bytes.

Every run of Raymill must give the same hits (sha256) and stay within its memory. Rays are shuffled, so that those which
Embree reaches in its time are like the rest; --in-order leaves them as the camera made them. amplification is bytes
read over the bytes of the distinct pages read. Files in --work are named by what they hold and used again.
Prints a table, then one line of JSON for each run.
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
from memory_cgroup import MemoryCgroup  # noqa: E402
from peer import Peer  # noqa: E402
from swap import SwapFile, SwapRefused  # noqa: E402

# Rays at whose edges the two may answer otherwise: Embree is not robust here.
MOST_DIFFERENT = 1e-3
DROP = pathlib.Path("/proc/sys/vm/drop_caches")


def drop_caches():
    if os.geteuid() == 0:
        os.sync()
        try:
            DROP.write_text("3")
        except OSError:
            pass


def numbers(text):
    return [float(word) for word in text.split(",")]


class Curve:
    def __init__(self, options, folder):
        self.options = options
        self.folder = folder
        self.lines = []
        self.problems = []
        self.truths = {}  # by kind of rays: the first run's hash
        self.hits = {}  # and how many rays hit
        self.estimated = False
        self.table = None

    def make(self):
        """The scene, the store and the rays, unless they are there."""
        options = self.options
        stem = options.scene.stem if options.scene else f"{options.kind}-{options.triangles}"
        self.scene = options.scene or self.folder / f"{stem}.gltf"
        self.store = self.folder / f"{stem}.mill"
        if not self.scene.exists():
            support.run(options.raymill, "generate", options.kind, "--triangles", options.triangles, "-o", self.scene)
        if not self.store.exists():
            built = support.run(options.raymill, "build", self.scene, "-o", self.store, "--memory",
                                options.make_memory, *shlex.split(options.build))
            print(built.stdout.splitlines()[0])
        self.rays = {}
        for kind in options.kinds.split(","):
            order = "in-order" if options.in_order else "shuffled"
            self.rays[kind] = self.folder / f"{stem}-{kind}-{options.rays}-{order}.npy"
            if not self.rays[kind].exists():
                support.run(options.raymill, "rays", self.store, "--kind", kind, "--count", options.rays, "--memory",
                            options.make_memory, *([] if options.in_order else ["--shuffle"]), "-o", self.rays[kind])
        self.info = support.run_json(options.raymill, "info", self.store, "--json", "--threads", options.threads)

    def head(self):
        info = self.info
        print(f"{self.store.name}: {info['triangles']} triangles, {info['pages']} pages, "
              f"{support.mib(info['store_bytes'])} MiB, decoded {support.mib(info['decoded_bytes'])} MiB; "
              f"{self.options.rays} rays of a kind")
        self.table = support.Table(run=30, memory=9, threads=7, krays=9, pages=9, distinct=9, amplif=7, MiB_read=9,
                                   peak=8, hits=10)

    def record(self, line, label, cells):
        self.lines.append(line)
        if self.options.out:
            with open(self.options.out, "a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        self.table.row(label, *cells)

    def trace(self, kind, label, fraction, of, memory):
        """One run of Raymill; returns whether it needed more memory than asked for."""
        asked, memory = memory, max(memory, self.info["least_memory_bytes"])
        hits, stats = self.folder / "hits.npy", self.folder / "stats.json"
        for _ in range(8):
            drop_caches()
            done = support.Run([self.options.raymill, "trace", self.store, self.rays[kind], "-o", hits, "--memory",
                                memory, "--threads", self.options.threads, "--stats", stats, "--progress", "none",
                                *shlex.split(self.options.trace)])
            if done.rc != 33:
                break
            memory = support.more_memory(memory, done.stderr)
        done.need()
        told = json.loads(stats.read_text())
        digest = support.sha256(hits)
        hits.unlink()
        distinct = told.get("distinct_bytes")
        estimated = distinct is None
        if estimated:
            self.estimated = True
            distinct = told["distinct_pages"] * self.info["store_bytes"] / self.info["pages"]
        amplification = told["bytes_read"] / distinct if distinct else 0
        peak = max(told["peak_rss_bytes"], done.rss_bytes)
        least = memory > asked
        label = f"{label} {'least' if least else f'{fraction:g}%'}"
        if digest != self.truths.setdefault(kind, digest):
            self.problems.append(f"{label}: other hits than the first run")
        self.hits[kind] = told["hits"]
        if peak > memory:
            self.problems.append(f"{label}: {support.mib(peak)} MiB of {support.mib(memory)} MiB")
        line = {"who": "raymill", "kind": kind, "of": of, "percent": fraction, "least": least, "memory_bytes": memory,
                "threads": told["threads"], "rays": told["rays"], "hits": told["hits"],
                "seconds": told["seconds"]["trace"],
                "rays_per_second": told["rays_per_second"], "pages_read": told["pages_read"],
                "bytes_read": told["bytes_read"], "distinct_pages": told["distinct_pages"], "distinct_bytes": distinct,
                "distinct_bytes_estimated": estimated, "amplification": amplification, "peak_rss_bytes": peak,
                "io": told["io"], "io_note": told.get("io_note", ""), "isa": told["isa"], "sha256": digest}
        self.record(line, label, [
            support.mib(memory), told["threads"], f"{told['rays_per_second'] / 1000:.1f}", told["pages_read"],
            told["distinct_pages"], f"{amplification:.2f}", support.mib(told["bytes_read"]), support.mib(peak),
            digest[:10]])
        return least

    def curve(self, label, of, fractions, whole_bytes):
        for kind in self.rays:
            for fraction in fractions:
                if self.trace(kind, f"{label} {kind}", fraction, of, int(whole_bytes * fraction / 100)):
                    break  # that was the least already

    def peer_run(self, peer, kind, fraction, limit, threads):
        told = peer.trace(self.rays[kind], threads, self.options.seconds)
        if told["complete"] and abs(told["hits"] - self.hits[kind]) > told["rays"] * MOST_DIFFERENT:
            self.problems.append(f"embree {kind}: {told['hits']} rays hit, of Raymill's {self.hits[kind]}")
        line = {"who": "embree", "kind": kind, "of": "embree", "percent": fraction, "memory_bytes": limit,
                "threads": threads, **{key: told[key] for key in ("rays", "hits", "seconds", "rays_per_second",
                                                                  "complete", "rss_bytes")}}
        self.record(line, f"embree {kind} {fraction:g}%", [
            support.mib(limit) if limit else "no limit", threads, f"{told['rays_per_second'] / 1000:.1f}", "-", "-",
            "-", "-", support.mib(told["rss_bytes"]), f"{told['rays']} rays"])

    def peers(self):
        """Embree's runs; returns its need in bytes."""
        options = self.options
        refusal = "left out by --no-swap" if options.no_swap else MemoryCgroup.refusal()
        cgroup = None if refusal else MemoryCgroup.create_open()
        try:
            with Peer(options.peer, self.scene, cgroup) as peer:
                need = peer.built["rss_bytes"]
                print(f"embree: {support.mib(need)} MiB ({need / peer.built['triangles']:.1f} B a triangle), built in "
                      f"{peer.built['build_seconds']:.1f} s with a peak of "
                      f"{support.mib(peer.built['peak_rss_bytes'])} MiB")
                runs = [(kind, threads) for kind in self.rays for threads in options.peer_threads]
                for kind, threads in runs:
                    self.peer_run(peer, kind, 100, None, threads)
                fractions = [fraction for fraction in options.peer_fractions if fraction < 100]
                if refusal is None and fractions:
                    try:
                        with SwapFile(self.folder, need + (need >> 2)):
                            settings = {name: pathlib.Path("/proc/sys/vm", name).read_text().strip()
                                        for name in ("page-cluster", "swappiness")}
                            print("embree under a limit, swap in a file: "
                                  + ", ".join(f"vm.{name} {value}" for name, value in settings.items()))
                            for fraction in fractions:
                                limit = int(need * fraction / 100)
                                cgroup.limit(limit)
                                for kind, threads in runs:
                                    self.peer_run(peer, kind, fraction, limit, threads)
                            peer.process.kill()  # what it has in swap need not come back
                            peer.process.wait()
                            cgroup.limit(None)
                    except SwapRefused as error:
                        refusal = str(error)
                if refusal:
                    print(f"left out: embree under a limit ({refusal})")
                return need
        finally:
            if cgroup is not None:
                cgroup.close()

    def run(self):
        self.make()
        self.head()
        self.curve("raymill", "decoded", self.options.fractions, self.info["decoded_bytes"])
        if self.options.peer:
            need = self.peers()
            self.curve("raymill at embree's", "embree", self.options.peer_fractions, need)
        if self.estimated:
            print("distinct bytes are estimated: distinct pages x mean bytes of a page in the store")


def parse():
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program, help="the program: B/bin/raymill")
    options.add_argument("--peer", type=support.program,
                         help="B/tests/bench/out_of_core/raymill-peer; without it Raymill runs alone")
    options.add_argument("--scene", type=lambda path: pathlib.Path(path).resolve(), help="a glTF file")
    options.add_argument("--triangles", default="60M", help="of a generated scene (%(default)s)")
    options.add_argument("--kind", default="mixed", help="of a generated scene: as raymill generate (%(default)s)")
    options.add_argument("--work", type=support.folder, help="folder for files, which stay; default: one that is removed")
    options.add_argument("--rays", default="10M", help="how many of each kind (%(default)s)")
    options.add_argument("--kinds", default="bounce,random", help="as raymill rays (%(default)s)")
    options.add_argument("--in-order", action="store_true", help="do not shuffle the rays")
    options.add_argument("--fractions", type=numbers, default=numbers("100,50,25,10,5,2"),
                         help="percent of the decoded store (100,50,25,10,5,2)")
    options.add_argument("--threads", default=str(os.cpu_count()), help="of Raymill (%(default)s)")
    options.add_argument("--trace", default="", help="more options of raymill trace, e.g. '--io pread'")
    options.add_argument("--build", default="", help="more options of raymill build, e.g. '--page-size 256K'")
    options.add_argument("--make-memory", default=str(half), help="--memory of making store and rays (half of all)")
    options.add_argument("--peer-fractions", type=numbers, default=numbers("100,50,25,5"),
                         help="percent of Embree's need (100,50,25,5)")
    options.add_argument("--peer-threads", type=lambda text: [int(n) for n in numbers(text)], default=[1, 16],
                         help="of Embree (1,16)")
    options.add_argument("--seconds", type=float, default=60, help="for each run of Embree (%(default)s)")
    options.add_argument("--no-swap", action="store_true", help="leave out Embree under a limit")
    options.add_argument("--out", help="append the lines of JSON to this file too, as they come")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.triangles, options.rays, options.seconds, options.no_swap = "1M", "20k", 1, True
        options.fractions, options.peer_fractions, options.peer_threads = [200, 50], [100, 50], [1, 2]
    return options


def main():
    return support.run_bench(Curve, parse(), "budget curve")


if __name__ == "__main__":
    sys.exit(main())
