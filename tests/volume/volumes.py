"""Volumes through the program, held against OpenVDB and float64 sums.

    volumes.py --raymill build/release/bin/raymill --oracle build/release/bin/raymill-volume-oracle [--fog 1024]
               [--plot errors.png]  (that needs matplotlib: Debian's python3-matplotlib)

For smoke.vdb and sphere.vdb (skipped where the scenes are missing), a fog and level sets that are made: builds, verifies,
traces with plenty of memory, with the least and through a server, and prints a table of errors. --fog N: the edge of the
fog, in voxels. --plot: error of transmittance by samples.
"""

import argparse
import os
import pathlib
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "trial"))
from support import Checks, Server, run, scenes_folder  # noqa: E402

BAD_INPUT = 42


def make_rays(info, count, seed):
    """Rays from around the volume's bounds through it; some along axes, some with an interval."""
    random = np.random.default_rng(seed)
    low, high = (np.array(info["bounds"][end]) for end in ("min", "max"))
    middle, size = (low + high) / 2, high - low
    to = low + size * random.random((count, 3))
    way = random.normal(size=(count, 3))
    org = middle + way / np.linalg.norm(way, axis=1)[:, None] * np.linalg.norm(size)
    direction = to - org
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    for axis in range(3):
        some = slice(axis, count, 10)
        direction[some] = 0
        direction[some, axis] = 1
        org[some] = to[some]
        org[some, axis] = low[axis] - 1
    rays = np.zeros((count, 8), dtype=np.float32)
    rays[:, 0:3], rays[:, 4:7], rays[:, 7] = org, direction, np.inf
    rays[5::7, 3], rays[5::7, 7] = 0.3 * np.linalg.norm(size), np.linalg.norm(size)
    return rays


class Trial(Checks):
    def __init__(self, options, folder):
        super().__init__(options, folder)
        self.curves = []  # what, samples a voxel, rms error of transmittance

    def build(self, scene, name, *words):
        store, _, info = super().build(scene, name, *words)
        return store, info

    def trace(self, store, rays, *words):
        """`rays`: an array."""
        path = self.folder / "rays.npy"
        np.save(path, rays)
        return super().trace(store, path, *words)

    def same_with_little_memory(self, store, info, rays, plenty, *words):
        # A share of the decoded store beside the least that a process needs with it.
        little = info["least_memory_bytes"] + info["decoded_bytes"] // 20
        answers, stats = self.trace(store, rays, "--memory", little, *words)
        self.check(f"the same bytes with {little >> 20} MiB ({info['decoded_bytes'] >> 20} MiB decoded): "
                   f"{stats['pages_read']} pages read, {stats['distinct_pages']} of them different, peak "
                   f"{stats['peak_rss_bytes'] >> 20} MiB",
                   answers.tobytes() == plenty.tobytes() and stats["peak_rss_bytes"] <= little)

    def oracle(self, verb, vdb, rays, dtype, *words):
        path, out = self.folder / "rays.f32", self.folder / "oracle.bin"
        rays.astype(np.float32).tofile(path)
        run(self.options.oracle, verb, vdb, path, out, *words)
        return np.fromfile(out, dtype=dtype)

    def figures(self, info):
        costs = {cost["feature"]: cost for cost in info["costs"]}
        self.check(f"info: volumes take {costs['volumes']['store_bytes']} bytes on disk, {costs['volumes']['decoded_bytes']} "
                   f"decoded, {costs['file']['store_bytes']} stand beside the pages",
                   sum(cost["store_bytes"] or 0 for cost in info["costs"]) == info["store_bytes"] and
                   sum(cost["decoded_bytes"] for cost in info["costs"]) == info["decoded_bytes"])
        self.check(f"info: {', '.join(info['kernels'].values())}", info["layouts"] == ["compact"] and
                   info["kernels"]["spans"] == "spans" and info["kernels"]["transmittance"] == "transmittance/exact")

    def same_through_a_server(self, store, rays, answers, *words):
        with Server(self.options.raymill, self.folder, self.folder) as server:
            remote, _ = self.trace(store.name, rays, *words, "--server", server.address)
        self.check(f"the same bytes through a server: {' '.join(map(str, words[:2]))}",
                   remote.tobytes() == answers.tobytes())

    def spans(self, vdb, store, info, rays, threshold):
        words = ("--query", "spans", "--threshold", threshold)
        spans, stats = self.trace(store, rays, *words)
        offsets = np.load(self.folder / "out.offsets.npy")
        dense = self.oracle("above", vdb, rays, np.float64, 0.05, threshold).reshape(-1, 3)
        length = spans["t_leave"].astype(np.float64) - spans["t"]
        sums = np.diff(np.concatenate([[0], np.cumsum(length)])[offsets])
        # A change lies within half a step of where two samples show it; two between samples are not seen.
        allowed = (dense[:, 1] + 3) * dense[:, 2] + 1e-5 * np.abs(spans["t_leave"]).max()
        off = np.abs(sums - dense[:, 0]) > allowed
        self.check(f"spans above {threshold}: {len(spans)} of {len(rays)} rays, {stats['rays_per_second'] / 1e3:.0f} "
                   f"krays/s; {off.sum()} rays differ by more than dense samples may", off.sum() <= len(rays) // 500)
        inner = np.ones(len(spans), dtype=bool)
        inner[offsets[:-1][np.diff(offsets) > 0]] = False
        self.check("they are in order and apart", len(spans) > 0 and (length >= 0).all() and
                   (spans["t"][1:] > spans["t_leave"][:-1])[inner[1:]].all())
        self.same_with_little_memory(store, info, rays, spans, *words)
        again = np.load(self.folder / "out.offsets.npy")
        self.check("the same offsets with little memory", (again == offsets).all())
        self.same_through_a_server(store, rays, spans, *words)

    def fog(self, vdb, name, count, scale):
        print(f"{vdb.name}: transmittance of {count} rays, density scale {scale}")
        store, info = self.build(vdb, name)
        rays = make_rays(info, count, 1)
        words = ("--query", "transmittance", "--density-scale", scale)
        self.figures(info)
        exact, stats = self.trace(store, rays, *words)
        print(f"  {stats['rays_per_second'] / 1e3:.0f} krays/s")
        # Error of the sum itself: half of the step, a quarter of the error.
        depth, finer = (self.oracle("depth", vdb, rays, np.float64, step) for step in (0.05, 0.02))
        truth, own_error = np.exp(-scale * finer), np.abs(np.exp(-scale * depth) - np.exp(-scale * finer)).max()
        error = np.abs(exact - truth).max()
        self.check(f"exact: largest error {error:.1e}; the sum's own {own_error:.1e}", error < 1e-5 + own_error)
        self.check(f"rays see something: transmittance from {truth.min():.3f} to {truth.max():.3f}", truth.min() < 0.9)
        self.same_with_little_memory(store, info, rays, exact, *words)
        voxel = float(np.linalg.norm(info_voxel(info)))
        errors = []
        for part in (1, 2, 4, 8):
            marched, _ = self.trace(store, rays, *words, "--step", voxel / part)
            errors.append(np.sqrt(np.mean((marched - truth) ** 2)))
            print(f"  march, step voxel / {part}: rms error {errors[-1]:.2e}")
        self.curves.append((f"{vdb.name} march", [1, 2, 4, 8], errors))
        self.check("marching converges", errors[-1] < errors[0] / 8)
        marched, _ = self.trace(store, rays, *words, "--step", voxel)
        self.same_with_little_memory(store, info, rays, marched, *words, "--step", voxel)
        for majorant in (1, 10):
            tracked = np.array([self.trace(store, rays, *words, "--volume-method", "ratio", "--seed", seed,
                                           "--majorant", majorant)[0] for seed in range(8)])
            deviation = tracked.std(axis=0).mean()
            bias = (tracked.mean(axis=0) - truth).mean()
            noise = tracked.std() / np.sqrt(tracked.size)
            self.curves.append((f"{vdb.name} ratio, majorant {majorant}", [1, 2, 4, 8],
                                [np.sqrt(np.mean((tracked[:some].mean(axis=0) - truth) ** 2)) for some in (1, 2, 4, 8)]))
            self.check(f"ratio, majorant {majorant}: deviation of a ray {deviation:.1e}, of the mean of all {bias:+.1e}",
                       abs(bias) < 5 * max(deviation / np.sqrt(tracked.size), 1e-7) + noise * 0.1)
        rounded, rounded_info = self.build(vdb, "rounded-" + name, "--volume-values", "lattice:0.004")
        answers, _ = self.trace(rounded, rays, *words)
        self.same_through_a_server(store, rays, marched, *words, "--step", voxel)
        self.spans(vdb, store, info, rays, 0.3)
        print(f"  lattice:0.004: store {rounded_info['store_bytes'] / info['store_bytes']:.2f} of float32's, decoded "
              f"{rounded_info['decoded_bytes'] / info['decoded_bytes']:.2f}, largest error "
              f"{np.abs(answers - truth).max():.1e}")

    def surface(self, vdb, name, count):
        print(f"{vdb.name}: hits of {count} rays")
        store, info = self.build(vdb, name)
        rays = make_rays(info, count, 2)
        words = ("--fields", "t,geometry_id,normal")
        hits, stats = self.trace(store, rays, *words)
        print(f"  {stats['rays_per_second'] / 1e3:.0f} krays/s")
        reference = self.oracle("surface", vdb, rays, np.float32).reshape(-1, 4)
        voxel = float(np.linalg.norm(info_voxel(info))) / np.sqrt(3)
        both = np.isfinite(hits["t"]) & np.isfinite(reference[:, 0])
        differ = np.isfinite(hits["t"]) != np.isfinite(reference[:, 0])
        # OpenVDB interpolates between two samples of a voxel, so it is off by parts of one, and a grazing ray may miss.
        error = np.abs(hits["t"] - reference[:, 0])[both] / voxel
        self.check(f"{both.sum()} hits beside OpenVDB's: t differs by {np.median(error):.4f} voxels in the middle, "
                   f"{np.quantile(error, 0.999):.3f} of 99.9 %", both.sum() > count // 20 and
                   np.quantile(error, 0.999) < 0.5)
        self.check(f"{differ.sum()} rays hit in one alone", differ.sum() <= count // 500)
        along = (hits["normal"] * reference[:, 1:4]).sum(axis=1)[both]
        self.check(f"normals: cosine at least {np.quantile(along, 0.001):.4f} of 99.9 %", np.quantile(along, 0.001) > 0.98)
        self.same_with_little_memory(store, info, rays, hits, *words)
        any_hits, _ = self.trace(store, rays, "--query", "any")
        self.check("any hit says the same", ((any_hits["t"] == 0) == np.isfinite(hits["t"])).all())

    def bad_files(self, smoke):
        print("bad files")
        for kind, needs in (("empty", "no active voxel"), ("int", "not float32")):
            vdb = self.make(kind)
            said = run(self.options.raymill, "build", vdb, "-o", self.folder / "bad.mill", rc=BAD_INPUT).stderr
            self.check(f"{kind}: {said.strip()}", needs in said and vdb.name in said and said.count("\n") == 1)
        for kind in ("one-voxel", "mixed"):
            store, info = self.build(self.make(kind), kind + ".mill")
            self.check(f"{kind}: builds, {info['volumes'][0]['active_voxels']} active voxels", len(info["volumes"]) == 1)
        whole = (smoke or self.make("fog", 40)).read_bytes()
        for size in (len(whole) - 1, len(whole) // 2, 300, 50, 3):
            cut = self.folder / "cut.vdb"
            cut.write_bytes(whole[:size])
            said = run(self.options.raymill, "build", cut, "-o", self.folder / "bad.mill", rc=BAD_INPUT).stderr
            self.check(f"cut to {size} bytes: {said.strip()}", "cut.vdb" in said and said.count("\n") == 1)
        self.check("nothing is left of what failed", not list(self.folder.glob("bad.mill*")))

    def make(self, kind, size=64):
        path = self.folder / f"{kind}.vdb"
        run(self.options.oracle, "make", kind, path, size)
        return path


def info_voxel(info):
    """The edges of a voxel along the diagonal, from the store's bounds and the volume's cells."""
    cells = np.array(info["volumes"][0]["cells"])
    return (np.array(info["bounds"]["max"]) - np.array(info["bounds"]["min"])) / cells


def plot(path, curves):
    import matplotlib  # pylint: disable=import-outside-toplevel
    matplotlib.use("Agg")
    from matplotlib import pyplot  # pylint: disable=import-outside-toplevel
    figure, axes = pyplot.subplots(figsize=(8, 5))
    for what, samples, errors in curves:
        axes.loglog(samples, errors, marker="o", label=what)
    axes.set_xlabel("samples a voxel (march), estimates averaged (ratio)")
    axes.set_ylabel("rms error of transmittance")
    axes.grid(True, which="both", linewidth=0.3)
    axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--raymill", required=True, type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--oracle", required=True, type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--fog", type=int, default=96)
    parser.add_argument("--rays", type=int, default=4000)
    parser.add_argument("--plot", type=pathlib.Path)
    options = parser.parse_args()
    scenes = scenes_folder()
    with tempfile.TemporaryDirectory(prefix="raymill-volumes-", dir=os.environ.get("TMPDIR")) as folder:
        trial = Trial(options, folder)
        smoke = scenes / "vdb_smoke" / "smoke.vdb" if scenes else None
        trial.bad_files(smoke)
        trial.surface(trial.make("torus", 96), "torus.mill", options.rays)
        trial.surface(trial.make("sphere", 200), "sphere.mill", options.rays)
        if scenes:
            trial.fog(smoke, "smoke.mill", options.rays, 0.2)
            sphere = scenes / "vdb_oiio_sphere" / "sphere.vdb"
            trial.fog(sphere, "oiio.mill", options.rays, 1)
            run(options.oracle, "surface-of", sphere, trial.folder / "surface.vdb")
            trial.surface(trial.folder / "surface.vdb", "surface.mill", options.rays)
            vec3 = scenes / "vdb_sphereCd" / "sphereCd.vdb"
            said = run(options.raymill, "build", vec3, "-o", trial.folder / "bad.mill", rc=BAD_INPUT).stderr
            trial.check(f"sphereCd: {said.strip()}", "vec3s" in said)
        trial.fog(trial.make("fog", options.fog), "fog.mill", options.rays, 0.5)
    if options.plot:
        plot(options.plot, trial.curves)
    return trial.ended("volumes")


if __name__ == "__main__":
    sys.exit(main())
