"""The same hits, byte for byte, in every configuration, with the process's memory inside --memory each time.

    same_bytes.py --raymill RAYMILL [--scene FILE] [--triangles N] [--rays N] [--few] [--short]

Varies width, page size, codec, instruction set, threads, embedded or server, and --memory: 100, 25 and 5 % of the
decoded store, or the least that the store allows. Draco is compared with zstd on the same lattice. Peak memory is told
three times: by --stats, by the kernel's account of the child (wait4), and by a memory cgroup where one can be made.
The scene is --scene, else a generated city of --triangles.
"""

import json
import os
import pathlib
import sys

import support
from memory_cgroup import MemoryCgroup

BASE = {"width": 8, "page": "64K", "codec": "zstd", "positions": "float32"}
STORES = [
    {}, {"width": 4}, {"page": "16K"}, {"page": "256K"}, {"page": "1M"}, {"codec": "raw"}, {"codec": "lz4"},
    {"positions": "lattice:18b"}, {"positions": "lattice:18b", "codec": "draco"},
    {"positions": "lattice:18b", "codec": "raw"},
]
FEW_STORES = [STORES[0], STORES[1], STORES[2], STORES[4], STORES[7], STORES[8]]
SHARES = [100, 25, 5]
# Beside the plain run (best ISA, two threads, embedded) of each store.
VARIATIONS = [{"isa": "scalar", "threads": 2}, {"isa": "avx2", "threads": 1}, {"isa": "scalar", "threads": 1},
              {"server": True}]


class Trial:
    def __init__(self, options, folder):
        self.options = options
        self.folder = pathlib.Path(folder)
        self.rays = self.folder / "rays.npy"
        self.shares = [100, 5] if options.short else SHARES
        self.problems = []
        self.truths = {}  # what should be equal: the first hash seen
        self.table = support.Table(configuration=58, limit=8, stats=7, wait4=7, cgroup=7, pages=8, krays=8, sha256=10,
                                   same=5)

    def build(self, scene, setting):
        setting = {**BASE, **setting}
        store = self.folder / "scene.mill"
        built = support.run_json(self.options.raymill, "build", scene, "-o", store, "--memory",
                                 self.options.build_memory, "--width", setting["width"], "--page-size",
                                 setting["page"], "--codec", setting["codec"], "--positions", setting["positions"],
                                 "--json")
        name = f"N{setting['width']} {setting['page']} {setting['codec']} {setting['positions']}"
        return store, name, built["decoded_bytes"], setting["positions"]

    def trace(self, store, options, limit, server=None, cgroup=None):
        """Hits' hash, stats, and the peaks of the process that traces: by --stats, the kernel, the cgroup."""
        hits, stats = self.folder / "hits.npy", self.folder / "stats.json"
        command = [self.options.raymill, "trace", store.name if server else store, self.rays, "-o", hits, "--stats",
                   stats, *options, *(["--server", server.address] if server else ["--memory", str(limit)])]
        done = support.Run(command, cgroup=cgroup.path if cgroup else None)
        if done.rc != 0:
            return done, None, None
        told = json.loads(stats.read_text())
        kernel = server.rss_bytes() if server else done.rss_bytes
        return done, support.sha256(hits), (told, kernel)

    def grow_to_least(self, attempt, limit):
        """Runs attempt(limit); where the program names a larger least amount, runs it with that."""
        for _ in range(8):
            try:
                done, digest, told = attempt(limit)
            except support.Failure as failure:  # the server does not start
                done, digest, told = failure, None, None
            if done.rc != 33:
                break
            limit = support.more_memory(limit, done.stderr)
        return limit, done, digest, told

    def case(self, store, label, truth, share, decoded, variation, query=()):
        """One row; returns whether the store needed more memory than the share."""
        limit = asked = max(int(decoded * share / 100), support.MIB)
        options = list(query)
        threads = variation.get("threads", 2)
        engine = ["--threads", str(threads)] + (["--isa", variation["isa"]] if "isa" in variation else [])
        what = f"{variation.get('isa', 'best')} {threads}t"
        what += "".join(f" {place}" for place in ("server", "cgroup") if variation.get(place))
        label = f"{label} {what}" + "".join(f" {word}" for word in query[1::2])
        cgroup = None
        if variation.get("server"):
            def attempt(limit):
                serve = ["--memory", str(limit), "--max-jobs", "1", "--max-stores", "1", *engine]
                with support.Server(self.options.raymill, self.folder, self.folder, *serve) as server:
                    return self.trace(store, options, limit, server)
        else:
            def attempt(limit):
                return self.trace(store, options + engine, limit)
        limit, done, digest, told = self.grow_to_least(attempt, limit)
        if variation.get("cgroup"):  # after a run outside: too small a group kills without a word
            def confined(limit):
                nonlocal cgroup
                cgroup = MemoryCgroup.create(limit)
                try:
                    return self.trace(store, options + engine, limit, cgroup=cgroup)
                finally:
                    cgroup.close()
            limit, done, digest, told = self.grow_to_least(confined, limit)
        label += f" {share}%" + (" (least)" if limit > asked else "")
        if digest is None:
            self.problems.append(f"{label}: ended with {done.rc}: {done.stderr.strip()}")
            self.table.row(label, support.mib(limit), "-", "-", "-", "-", "-", "-", "NO")
            return False
        stats, kernel = told
        same = digest == self.truths.setdefault(truth, digest)
        peak = max(stats["peak_rss_bytes"], kernel)
        if not same:
            self.problems.append(f"{label}: other hits than the first run of {truth}")
        if peak > limit:
            self.problems.append(f"{label}: {support.mib(peak)} MiB of {support.mib(limit)} MiB")
        self.table.row(label, support.mib(limit), support.mib(stats["peak_rss_bytes"]), support.mib(kernel),
                       support.mib(cgroup.max_bytes) if cgroup else "-", stats["pages_read"],
                       f"{stats['rays_per_second'] / 1000:.1f}", digest[:10], ("yes" if same else "NO") +
                       (" OVER" if peak > limit else ""))
        return limit > asked

    def store(self, scene, setting, variations, queries):
        store, name, decoded, positions = self.build(scene, setting)
        if variations and MemoryCgroup.refusal() is None:
            variations = [*variations, {"cgroup": True}]
        for variation in [{}, *variations]:
            for share in self.shares:
                if self.case(store, name, f"closest {positions}", share, decoded, variation):
                    break  # that was the least already
        for query in queries:
            for share in (self.shares[0], self.shares[-1]):
                for variation in [{}, {"isa": "scalar", "threads": 1}]:
                    self.case(store, name, " ".join(query) + " " + positions, share, decoded, variation, query)
        store.unlink()


def main():
    options = support.parser(__doc__)
    options.add_argument("--scene", type=pathlib.Path, help="a glTF file; left out: a generated city")
    options.add_argument("--triangles", default="20M")
    options.add_argument("--rays", default="250k")
    options.add_argument("--kind", default="bounce", help="as for raymill rays")
    options.add_argument("--build-memory", default="12G")
    options.add_argument("--few", action="store_true", help="half of the stores")
    options = options.parse_args()
    if options.short:
        options.triangles, options.rays = "200k", "20k"
    stores = FEW_STORES if options.short or options.few else STORES
    queries = [["--mode", "fast"], ["--query", "any"], ["--query", "any", "--mode", "fast"]]
    with support.work_folder(options) as folder:
        scene = options.scene
        if scene is None:
            scene = pathlib.Path(folder) / "scene.gltf"
            support.run(options.raymill, "generate", "city", "--triangles", options.triangles, "-o", scene)
        if refusal := MemoryCgroup.refusal():
            print(f"left out: the memory cgroup ({refusal})")
        trial = Trial(options, folder)
        first, _, _, _ = trial.build(scene, {})
        support.run(options.raymill, "rays", first, "--kind", options.kind, "--count", options.rays, "--shuffle", "-o",
                    trial.rays)
        os.sync()
        for i, setting in enumerate(stores):
            full = i == 0 or (setting.get("codec") == "draco" and stores is STORES)
            trial.store(scene, setting, VARIATIONS if full else [], queries if i == 0 else [])
    return support.ended(trial.problems, "same bytes")


if __name__ == "__main__":
    sys.exit(main())
