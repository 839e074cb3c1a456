"""Rays per second by worker threads, what they waited for each other, and what many more of them would.

    thread_table.py --raymill RAYMILL --store X.mill --rays RAYS.npy [--threads 1,2,4] [--memory 4G] [--repeat 3]

1. raymill trace for each number of threads, in turn, --repeat times; the best rate of each. Hits must be the same bytes.
   wait and hold: microseconds a block of 1024 rays that workers waited for the one lock and held it (--stats).
2. A simulation of more workers than the machine has cores: each works for as long as one worker alone worked on a block,
   then waits for the lock, in the order of coming, and holds it for as long as was measured. Lengths are drawn from
   exponential distributions (--seed), which is harder on the lock than lengths that are all alike. What is not in it:
   memory, caches, the thread that pushes and the one that fetches.

Prints both tables, then a line of JSON. Exit codes: 0; 1 hits differ.
"""

import heapq
import json
import pathlib
import random
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

BLOCK_RAYS = 1024
SIMULATED = [1, 2, 4, 8, 16, 32, 64, 128, 256]
SIMULATED_BLOCKS = 40000


def simulate(workers, work, hold, draw):
    """Blocks a second of so many workers. Events: (time, worker) at which a worker comes to the lock."""
    coming = [(draw.expovariate(1 / work), worker) for worker in range(workers)]
    heapq.heapify(coming)
    free_at = done_at = 0.0
    for _ in range(SIMULATED_BLOCKS):
        at, worker = heapq.heappop(coming)
        free_at = max(at, free_at) + draw.expovariate(1 / hold)
        done_at = free_at
        heapq.heappush(coming, (free_at + draw.expovariate(1 / work), worker))
    return SIMULATED_BLOCKS / done_at


class Bench:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.best = {}
        self.truth = None
        self.same = True

    def make(self):
        options = self.options
        self.store, self.rays = options.store, options.rays
        if self.store is None:
            scene, self.store = self.folder / "scene.gltf", self.folder / "scene.mill"
            support.run(options.raymill, "generate", "mixed", "--triangles", options.triangles, "-o", scene)
            support.run(options.raymill, "build", scene, "-o", self.store)
        if self.rays is None:
            self.rays = self.folder / "rays.npy"
            support.run(options.raymill, "rays", self.store, "--kind", "bounce", "--count", options.count, "-o", self.rays)

    def trace(self, threads):
        hits, stats = self.folder / "hits.npy", self.folder / "stats.json"
        support.run(self.options.raymill, "trace", self.store, self.rays, "-o", hits, "--threads", threads, "--memory",
                    self.options.memory, "--layout", self.options.layout, "--stats", stats, "--progress", "none")
        digest = support.sha256(hits)
        self.same = self.same and digest == (self.truth or digest)
        self.truth = digest
        told = json.loads(stats.read_text())
        if told["rays_per_second"] > self.best.get(threads, {"rays_per_second": 0})["rays_per_second"]:
            self.best[threads] = told

    def measured(self):
        table = support.Table(threads=8, Mrays=8, ratio=6, wait_us=8, hold_us=8, idle_s=7)
        one = self.best[self.options.threads[0]]["rays_per_second"]
        for threads, told in self.best.items():
            blocks = told["rays"] / BLOCK_RAYS
            table.row(threads, f"{told['rays_per_second'] / 1e6:.3f}", f"{told['rays_per_second'] / one:.2f}",
                      f"{told['lock_wait_seconds'] / blocks * 1e6:.2f}", f"{told['lock_hold_seconds'] / blocks * 1e6:.2f}",
                      f"{told['idle_seconds']:.2f}")

    def simulated(self):
        """From the run of the fewest threads: what a block costs without and with the lock."""
        threads, told = min(self.best.items())
        blocks = told["rays"] / BLOCK_RAYS
        hold = told["lock_hold_seconds"] / blocks
        work = threads * told["seconds"]["trace"] / blocks - hold
        draw = random.Random(self.options.seed)
        rates = {workers: simulate(workers, work, hold, draw) for workers in SIMULATED}
        print(f"\nsimulated: {work * 1e6:.0f} us of work and {hold * 1e6:.2f} us of lock a block")
        table = support.Table(workers=8, times=8, of_all=7)
        for workers, rate in rates.items():
            table.row(workers, f"{rate / rates[1]:.1f}", f"{rate / rates[1] / workers:.2f}")
        return {workers: rate / rates[1] for workers, rate in rates.items()}

    def run(self):
        self.make()
        for _ in range(self.options.repeat):
            for threads in self.options.threads:
                self.trace(threads)
        self.measured()
        times = self.simulated()
        lines = {threads: {key: told[key] for key in ("rays_per_second", "lock_wait_seconds", "lock_hold_seconds",
                                                      "idle_seconds", "rays_expanded", "isa")}
                 for threads, told in self.best.items()}
        print(json.dumps({"name": f"threads/{self.store.stem}/{self.rays.stem}", "layout": self.options.layout,
                          "runs": lines, "simulated": times, "sha256": self.truth}))


def main():
    options = support.parser(__doc__)
    options.add_argument("--store", type=support.program, help="a store that is there; left out: one is made")
    options.add_argument("--rays", type=support.program, help="a ray file; left out: bounce rays are made")
    options.add_argument("--triangles", default="2M", help="of the store that is made (%(default)s)")
    options.add_argument("--count", default="4M", help="rays that are made (%(default)s)")
    options.add_argument("--threads", type=lambda text: [int(n) for n in text.split(",")], default=[1, 2],
                         help="(1,2)")
    options.add_argument("--memory", default="4G", help="(%(default)s)")
    options.add_argument("--layout", default="expanded", help="as raymill trace (%(default)s)")
    options.add_argument("--repeat", type=int, default=3, help="(%(default)s)")
    options.add_argument("--seed", type=int, default=1, help="of the simulation (%(default)s)")
    options = options.parse_args()
    if options.short:
        options.triangles, options.count, options.repeat = "20K", "50K", 1
    with support.work_folder(options) as folder:
        bench = Bench(options, pathlib.Path(folder))
        bench.run()
        if not bench.same:
            print("hits differ between runs", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
