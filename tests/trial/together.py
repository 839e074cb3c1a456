"""Everything that a scene may be made of in one store: the same bytes however its pages come and go.

    together.py --raymill RAYMILL --oracle VOLUME_ORACLE [--sheets N] [--rays N] [--short]

A stack of sheets with masks of every kind, each a mesh that is placed by several nodes, some of them mirrored
(instances, alphaMode MASK and BLEND, single-sided materials, vertex attributes), with a level set and a fog between them
(VOLUME_ORACLE makes both). Each query that such a store answers is asked with plenty of memory, and again with the least,
one and more threads, other instructions, other policies, through a server, with every ray suspended at every node and
every page evicted after it, and in stores of another width, page size and codec.
"""

import itertools
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[0] / "masks"))

import made_scene  # noqa: E402
import numpy  # noqa: E402
import support  # noqa: E402

NONE = 0xFFFFFFFF

QUERIES = {
    "closest": ["--query", "closest", "--fields", "t,uv,ids,instance_id,normal"],
    "attributes": ["--query", "closest", "--fields", "t,ids,shading_normal,uv0,uv1,color0"],
    "any": ["--query", "any"],
    "all": ["--query", "all", "--fields", "t,uv,ids,instance_id,normal"],
    "exact": ["--query", "closest", "--mode", "exact", "--fields", "t,ids,instance_id"],
    "transmittance": ["--query", "transmittance"],
    "spans": ["--query", "spans", "--threshold", "0.2"],
}
WAYS = {
    "one thread": ["--threads", "1"],
    "scalar": ["--isa", "scalar"],
    "pread, sorted": ["--io", "pread", "--sort-rays", "always"],
    "sweep, clock": ["--policy", "sweep", "--eviction", "clock"],
}
# What a mode of other pages or nodes answers is the same; u and v are of the same triangle.
STORES = [("8", "64K", "zstd"), ("4", "16K", "lz4"), ("8", "16K", "raw")]


class Trial:
    def __init__(self, options, folder):
        self.options, self.folder = options, pathlib.Path(folder)
        self.problems, self.truths = [], {}
        self.table = support.Table(query=16, store=16, way=24, pages=9, MiB=7, same=5)

    def run(self, *words):
        return support.run(self.options.raymill, *words)

    def make(self):
        scene = made_scene.make_scene(self.folder, 1, self.options.sheets)
        volumes = []
        for kind, size, rows in (("torus", 48, "0.6,0,0,1,0,0.6,0,1,0,0,0.6,1"),
                                 ("fog", 48, "0.5,0,0,0.6,0,0.5,0,0.8,0,0,0.5,1")):
            path = self.folder / f"{kind}.vdb"
            support.run(self.options.oracle, "make", kind, path, size)
            volumes.append((path, rows))
        self.scene = [scene, *(path for path, _ in volumes), "--blend-as-mask", "0.4", "--cull-back-faces", "--instances",
                      "always", "--attributes", "normal,uv0,uv1,color0",
                      *itertools.chain.from_iterable(("--volume-transform", rows) for _, rows in volumes)]

    def build(self, width, page, codec):
        store = self.folder / f"{width}-{page}-{codec}.mill"
        self.run("build", *self.scene, "-o", store, "--width", width, "--page-size", page, "--codec", codec)
        self.run("verify", store)
        return store, support.run_json(self.options.raymill, "info", store, "--json")

    def trace(self, query, store, way, words, rays):
        out, stats = self.folder / "out.npy", self.folder / "stats.json"
        self.run("trace", store, rays, "-o", out, "--stats", stats, "--progress", "none", *QUERIES[query], *words)
        offsets = self.folder / "out.offsets.npy"
        digest = support.sha256(out) + (support.sha256(offsets) if offsets.exists() else "")
        offsets.unlink(missing_ok=True)
        truth = self.truths.setdefault((query, rays.name), digest)
        told = support.json.loads(stats.read_text())
        self.table.row(query, pathlib.Path(store).stem, way, told["pages_read"], support.mib(told["peak_rss_bytes"]),
                       "yes" if digest == truth else "NO")
        if digest != truth:
            self.problems.append(f"{query}, {store}, {way}: other bytes")

    def look(self, store, rays):
        """That rays meet all of it: else the same bytes would say little."""
        out = {}
        for query in ("closest", "attributes", "transmittance", "spans"):
            path, stats = self.folder / "look.npy", self.folder / "stats.json"
            self.run("trace", store, rays, "-o", path, "--stats", stats, "--progress", "none", *QUERIES[query])
            out[query] = numpy.load(path)
            if query == "closest":
                told = support.json.loads(stats.read_text())
        hits, shaded = (out[query][numpy.isfinite(out["closest"]["t"])] for query in ("closest", "attributes"))
        placed = hits["instance_id"] != NONE
        found = {"triangles of instances": int(placed.sum()), "points of the level set": int((~placed).sum()),
                 "hits on masks": told["masks_tested"], "texels": told["texels_read"],
                 "rays through fog": int((out["transmittance"] < 1).sum()), "spans": len(out["spans"]),
                 "shading normals": int(numpy.isfinite(shaded["shading_normal"][:, 0]).sum()),
                 "colours": int(numpy.isfinite(shaded["color0"][:, 0]).sum()),
                 "hits without attributes": int(numpy.isnan(shaded["uv0"][~placed, 0]).sum())}
        print(f"{len(out['closest'])} rays: " + ", ".join(f"{count} {what}" for what, count in found.items()), flush=True)
        self.problems += [f"no {what}" for what, count in found.items() if count == 0]

    def ways(self, store, info, rays, few):
        least = info["least_memory_bytes"]
        for query in QUERIES:
            self.trace(query, store, "plenty", [], rays)
            self.trace(query, store, "plenty, few", [], few)
            for way, words in WAYS.items():
                self.trace(query, store, way, words, rays)
            self.trace(query, store, "the least memory", ["--memory", least], rays)
            self.trace(query, store, "suspended everywhere", ["--memory", least, "--adversarial"], few)
        with support.Server(self.options.raymill, self.folder, self.folder) as server:
            for query in QUERIES:
                self.trace(query, store.name, "a server", ["--server", server.address], few)

    def all(self):
        self.make()
        rays, few = self.folder / "rays.npy", self.folder / "few.npy"
        for i, kind in enumerate(STORES[:2] if self.options.short else STORES):
            store, info = self.build(*kind)
            if i == 0:
                wanted = {"triangles", "geometry_ids", "instances", "masks", "volumes", "attributes"}
                if not wanted <= set(info["features"]):
                    self.problems.append(f"the store has {info['features']} alone")
                for path, count in ((rays, self.options.rays), (few, self.options.rays // 20)):
                    self.run("rays", store, "--kind", "random", "--count", count, "-o", path)
                self.look(store, rays)
                self.ways(store, info, rays, few)
            else:
                for query in QUERIES:
                    self.trace(query, store, "plenty", [], rays)
                    self.trace(query, store, "suspended everywhere", ["--adversarial"], few)


def main():
    options = support.parser(__doc__)
    options.add_argument("--oracle", required=True, type=support.program, help="B/bin/raymill-volume-oracle")
    options.add_argument("--sheets", type=int, default=24, help="meshes, each with a material (%(default)s)")
    options.add_argument("--rays", type=int, default=100_000, help="(%(default)s)")
    options = options.parse_args()
    if options.short:
        options.sheets, options.rays = 7, 4000
    with support.work_folder(options) as folder:
        trial = Trial(options, folder)
        try:
            trial.all()
        except support.Failure as failure:
            trial.problems.append(str(failure))
    return support.ended(trial.problems, "everything together")


if __name__ == "__main__":
    sys.exit(main())
