"""Instanced scenes: store sizes, rays per second by memory, the flattened scene and Embree's instances beside them.

    instance_table.py --raymill RAYMILL --in-flight IN_FLIGHT [--scenes S.gltf,...] [--work DIR] [--rays 1M]

For each scene, by default teapots_galore and torque_forest of the collection and a generated one (--woods triangles of
200 meshes):

1. It is built with instances under --build-memory, and flattened too (--instances never) where it has at most
   --most-flattened triangles: bytes of both stores, seconds and peak of the build.
2. Bounce and random rays are traced at 100, 25 and 5 % of the decoded store above the least that it needs (a small store
   is in that least whole); the hits must be the same bytes and the peak within the limit. The first --adversarial rays
   once more with --adversarial, which evicts whatever the store's size.
3. Against the flattened store (both without masks, where the scene has them): rays where one hits and the other does
   not, or another triangle is hit; among the others the largest distance between the two planes along their normal,
   |t - t'| |d . n|, in units of 2^-24 (largest coordinate of the bounds + |org| + |t d|): the flattened corners were
   rounded to float32 in the world, the ray in the object's space. More than --most-units of them is a failure, and so
   is another answer for more than one ray of ten thousand.
4. Bytes for each ray in flight (raymill-in-flight, --in-flight-rays of them), and `raymill bench --embree`: Embree's own
   instances on the same rays, one thread.

Prints tables, then one line of JSON for each scene.
"""

import json
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import numpy  # noqa: E402
import support  # noqa: E402

FRACTIONS = (100, 25, 5)
KINDS = ("bounce", "random")
MOST_OTHER = 1e-4


def planes_apart(rays, hits, others, largest):
    """|t - t'| |d . n| of rays with the same triangle, in units of 2^-24 (largest + |org| + |t d|)."""
    org, direction = rays[:, 0:3].astype(float), rays[:, 4:7].astype(float)
    normal = others["normal"].astype(float)
    normal /= numpy.maximum(numpy.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    apart = numpy.abs(hits["t"].astype(float) - others["t"]) * numpy.abs((direction * normal).sum(1))
    way = numpy.abs(others["t"].astype(float)) * numpy.linalg.norm(direction, axis=1)
    return apart / (2.0**-24 * (largest + numpy.linalg.norm(org, axis=1) + way))


class Bench:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def scenes(self):
        """(name, file) of each scene."""
        if self.options.scenes:
            return [(pathlib.Path(path).stem, pathlib.Path(path).resolve()) for path in self.options.scenes.split(",")]
        found = []
        collection = None if self.options.short else support.scenes_folder()
        if collection:
            found = [("teapots_galore", collection / "teapots_galore" / "TeapotsGalore.gltf"),
                     ("torque_forest", collection / "torque_forest" / "torque_forest.glb")]
        if self.options.woods != "0":
            woods = self.folder / f"woods-{self.options.woods}.gltf"
            if not woods.exists():
                support.run(self.options.raymill, "generate", "woods", "--triangles", self.options.woods, "--meshes",
                            self.options.woods_meshes, "-o", woods)
            found.append(("woods", woods))
        return found

    def build(self, name, scene, rule, *more):
        store = self.folder / "-".join([name, rule, *(word.strip("-") for word in more)])
        store = store.with_name(store.name + ".mill")
        done = support.Run([self.options.raymill, "build", scene, "-o", store, "--instances", rule, "--memory",
                            self.options.build_memory, "--progress", "none", "--json", *more]).need()
        told = json.loads(done.stdout)
        told.update(rule=rule, wall_seconds=done.seconds, kernel_peak_bytes=done.rss_bytes,
                    info=support.run_json(self.options.raymill, "info", store, "--json"))
        return store, told

    def trace(self, store, rays, hits, memory, *more):
        fields = "t,uv,ids,instance_id,normal"
        return support.run_json(self.options.raymill, "trace", store, rays, "-o", hits, "--memory", memory, "--fields", fields,
                                "--progress", "none", "--json", *more)

    def adversarial(self, name, store, info, rays_file, hits_file):
        """The first rays, suspended at every node, against the same rows of the file."""
        some, found = self.folder / "some.npy", self.folder / "some-hits.npy"
        numpy.save(some, numpy.load(rays_file)[:self.options.adversarial])
        told = self.trace(store, some, found, info["least_memory_bytes"], "--adversarial")
        same = numpy.load(found).tobytes() == numpy.load(hits_file)[:self.options.adversarial].tobytes()
        print(f"{name}, {told['rays']} rays suspended at every node, {told['pages_read']} pages read: "
              f"{'the same bytes' if same else 'OTHER HITS'}")
        if not same:
            self.problems.append(f"{name}: the adversarial schedule gives other hits")

    def by_memory(self, name, store, info, rays, kind):
        """The runs at each fraction; leaves the hits of the last in a file, whose path is returned."""
        hits, digests, runs = self.folder / "hits.npy", set(), []
        for fraction in FRACTIONS:
            # What is decoded, and beside it what the process needs for rays and tables in any case.
            memory = info["least_memory_bytes"] + info["decoded_bytes"] * fraction // 100
            told = self.trace(store, rays, hits, memory)
            digests.add(support.sha256(hits))
            if told["peak_rss_bytes"] > memory:
                self.problems.append(f"{name} {kind} {fraction}%: {support.mib(told['peak_rss_bytes'])} MiB of "
                                     f"{support.mib(memory)}")
            self.table.row(f"{name} {kind} {fraction}%", support.mib(memory), support.mib(told["peak_rss_bytes"]),
                           f"{told['rays_per_second'] / 1e3:.1f}", told["pages_read"], support.mib(told["bytes_read"]),
                           support.sha256(hits)[:8])
            runs.append({"fraction": fraction, "memory_bytes": memory, **told})
        if len(digests) != 1:
            self.problems.append(f"{name} {kind}: the hits depend on the memory")
        return hits, runs

    def compare(self, name, kind, rays_file, hits_file, flat, info):
        others_file = self.folder / "flat-hits.npy"
        told = self.trace(flat, rays_file, others_file, self.options.flat_memory)
        rays, hits, others = numpy.load(rays_file), numpy.load(hits_file), numpy.load(others_file)
        is_hit, is_other = numpy.isfinite(hits["t"]), numpy.isfinite(others["t"])
        both = is_hit & is_other
        same = both & (hits["geometry_id"] == others["geometry_id"]) & (hits["primitive_id"] == others["primitive_id"])
        largest = max(abs(value) for corner in ("min", "max") for value in info["bounds"][corner])
        units = planes_apart(rays[same], hits[same], others[same], largest)
        found = {"kind": kind, "rays": len(rays), "hits": int(is_hit.sum()), "hit_or_miss": int((is_hit != is_other).sum()),
                 "other_triangle": int((both & ~same).sum()), "units_max": float(units.max(initial=0)),
                 "units_median": float(numpy.median(units)) if len(units) else 0.0,
                 "flat_rays_per_second": told["rays_per_second"]}
        print(f"{name} {kind}, against the flattened store ({told['rays_per_second'] / 1e3:.1f} krays/s): {found['hits']} of "
              f"{len(rays)} rays hit, {found['hit_or_miss']} hit or miss otherwise, {found['other_triangle']} hit another "
              f"triangle, planes apart {found['units_max']:.2f} units at most, {found['units_median']:.3f} in the median")
        if found["hit_or_miss"] + found["other_triangle"] > MOST_OTHER * len(rays):
            self.problems.append(f"{name} {kind}: other answers than the flattened scene")
        if found["units_max"] > self.options.most_units:
            self.problems.append(f"{name} {kind}: {found['units_max']:.1f} units from the flattened scene")
        return found

    def peers(self, name, store, plain, line):
        options = self.options
        rays = self.rays(store, "bounce", options.in_flight_rays)
        told = support.run_json(options.in_flight, store, rays, "--count", options.in_flight_rays)
        print(f"{name}: {told['bytes_per_ray']:.1f} bytes for each ray in flight")
        line["in_flight"] = told
        text = support.run(options.raymill, "bench", plain, "--embree", "--threads", 1, "--memory", options.flat_memory,
                           "--kinds", "primary,bounce", "--count", options.rays, "--repeat", 3, "--progress", "none", "--json")
        line["bench"] = [json.loads(one) for one in text.stdout.splitlines()]
        for one in line["bench"]:
            print(f"{name} {one['name']}: {one['embree_ratio']['median']:.2f} of Embree's instances")

    def rays(self, store, kind, count):
        path = store.with_name(f"{store.stem}-{kind}-{count}.npy")
        if not path.exists():
            support.run(self.options.raymill, "rays", store, "--kind", kind, "--count", count, "--shuffle", "-o", path)
        return path

    def one(self, name, scene):
        store, told = self.build(name, scene, "auto")
        info = told["info"]
        line = {"scene": name, "build": told}
        print(f"{name}: {info['import']['kept']} triangles from {told['triangles']}, {info.get('instances', 0)} instances of "
              f"{info.get('objects', 0)} objects; store {info['store_bytes']} bytes, decoded {info['decoded_bytes']}, built in "
              f"{told['wall_seconds']:.1f} s, peak {support.mib(told['kernel_peak_bytes'])} MiB of {self.options.build_memory}")
        # Where masks cut leaves out a rounding changes the texel and with it the leaf, and Embree knows no masks.
        plain, words = store, ["--ignore-alpha"] if "masks" in info["features"] else []
        if words:
            plain, _ = self.build(name, scene, "auto", *words)
        flat = None
        if info["import"]["kept"] <= self.options.most_flattened:
            flat, line["flat"] = self.build(name, scene, "never", *words)
            print(f"{name} flattened: store {line['flat']['info']['store_bytes']} bytes, "
                  f"{line['flat']['info']['store_bytes'] / info['store_bytes']:.0f} times as many")
        self.table = support.Table(run=30, memory=9, peak=9, krays=9, pages=9, MiB_read=9, hits=8)
        line["traces"], line["against_flat"] = {}, []
        for kind in KINDS:
            rays = self.rays(store, kind, self.options.rays)
            hits, line["traces"][kind] = self.by_memory(name, store, info, rays, kind)
            self.adversarial(f"{name} {kind}", store, info, rays, hits)
            if flat:
                if plain != store:
                    self.trace(plain, rays, hits, self.options.flat_memory)
                line["against_flat"].append(self.compare(name, kind, rays, hits, flat, info))
        if self.options.in_flight:
            self.peers(name, store, plain, line)
        self.lines.append(line)

    def run(self):
        for name, scene in self.scenes():
            self.one(name, scene)


def parse():
    options = support.parser(__doc__)
    options.add_argument("--in-flight", type=support.program,
                         help="B/tests/bench/in_flight/raymill-in-flight; without it neither it nor Embree is run")
    options.add_argument("--scenes", help="scene files, separated by commas, in place of the three")
    options.add_argument("--woods", default="10G", help="triangles of the generated scene; 0: none (%(default)s)")
    options.add_argument("--woods-meshes", default="200", help="kinds of tree in it (%(default)s)")
    options.add_argument("--adversarial", type=int, default=50_000, help="rays of the adversarial run (%(default)s)")
    options.add_argument("--rays", default="1M", help="of each kind (%(default)s)")
    options.add_argument("--in-flight-rays", default="10M", help="(%(default)s)")
    options.add_argument("--build-memory", default="512M", help="(%(default)s)")
    options.add_argument("--flat-memory", default="4G", help="of the flattened trace and of bench (%(default)s)")
    options.add_argument("--most-flattened", type=int, default=20_000_000,
                         help="triangles of the largest scene that is flattened too (%(default)s)")
    options.add_argument("--most-units", type=float, default=4, help="see 3 (%(default)s)")
    options = options.parse_args()
    if options.short:
        options.woods, options.woods_meshes, options.rays, options.adversarial = "500k", "10", "10k", 1000
        options.in_flight_rays = "20k"
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(Bench, parse(), "instanced scenes"))
