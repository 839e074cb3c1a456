"""Alpha masks through the program, held against a reference in float64 that samples the textures directly.

    masks.py --raymill build/release/bin/raymill --reference build/release/bin/raymill-mask-reference [--short]

For torque_forest, banana_tree and alpha_blend_mode_test (left out where the scenes are missing) and scenes that are
made: hits of a million rays against the reference's, in every mode; the same bytes from little memory, from the schedule
that suspends everywhere, and from every width and ISA; rays per second with masks and with all opaque; how many triangle
tests look a texel up; parts with origins of their own; and pictures that are missing, broken, tiny and large.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "trial"))
import bad_textures  # noqa: E402
import parts  # noqa: E402
from gltf_triangles import read_scene, write_scene  # noqa: E402
from made_scene import make_scene  # noqa: E402
from support import Checks, Table, run, scenes_folder  # noqa: E402

ANSWER = np.dtype([("t", "<f8"), ("geometry_id", "<u4"), ("primitive_id", "<u4")])
SCENES = {"torque_forest": "torque_forest.glb", "banana_tree": "scene.gltf",
          "alpha_blend_mode_test": "AlphaBlendModeTest.glb"}


def make_rays(triangles, count, seed, step=0):
    """From around the scene and from within it, towards triangles; some along axes, some with an interval. With `step`,
    they begin at multiples of it."""
    random = np.random.default_rng(seed)
    corners = triangles["corners"].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = high - low
    weights = random.dirichlet((1, 1, 1), count)
    aims = (triangles["corners"][random.integers(0, len(triangles), count)] * weights[:, :, None]).sum(axis=1)
    way = random.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    far = np.where(random.random(count) < 0.5, np.linalg.norm(size), 0.02 * np.linalg.norm(size))
    direction = -way * (0.5 + random.random(count))[:, None]
    rays = np.zeros((count, 8), np.float32)
    rays[:, 0:3], rays[:, 4:7], rays[:, 7] = aims + way * far[:, None], direction, np.inf
    for axis in range(3):
        some = slice(axis, count, 31)
        rays[some, 0:3], rays[some, 4:7] = aims[some], 0
        rays[some, axis] = low[axis] - size.max()
        rays[some, 4 + axis] = 1
    rays[5::17, 3] = 0.1 * np.linalg.norm(size)
    if step > 0:
        rays[:, :3] = np.round(rays[:, :3] / step) * step
    return rays


class Trial(Checks):
    def __init__(self, options, folder):
        super().__init__(options, folder)
        self.rays = 4000 if options.short else 1_000_000
        self.table = Table(scene=24, rays=9, triangles=10, masked=10, cut=9, wrong=7, ties=6, Mrays=7, opaque=7,
                           texels=9, B_tri=7)

    def reference(self, name, scene, count, step=0, **rules):
        """(rays' path, the reference's answers)"""
        triangles, rows = read_scene(scene, self.folder, **rules)
        raw, path, answers = (self.folder / end for end in ("scene.raw", f"{name}-rays.npy", "answers.raw"))
        write_scene(raw, triangles, rows)
        rays = make_rays(triangles, count, 7, step)
        np.save(path, rays)
        flat = self.folder / "rays.raw"
        rays.tofile(flat)
        run(self.options.reference, raw, flat, answers)
        return path, np.fromfile(answers, ANSWER)

    def compare(self, hits, answers):
        """(rays that hit something else, rays that hit something else at the same t)"""
        hit, should = np.isfinite(hits["t"]), np.isfinite(answers["t"])
        same = (hit == should) & (~hit | ((hits["geometry_id"] == answers["geometry_id"]) &
                                          (hits["primitive_id"] == answers["primitive_id"])))
        with np.errstate(invalid="ignore"):
            near = np.abs(hits["t"] - answers["t"]) <= 4e-7 * np.maximum(np.abs(answers["t"]), 1e-3)
        ties = ~same & hit & should & near
        return int((~same & ~ties).sum()), int(ties.sum())

    def scene(self, name, scene, *words, **rules):
        path, answers = self.reference(name, scene, self.rays, **rules)
        store, report, info = self.build(scene, name + ".mill", "--instances", "never", *words)
        hits, stats = self.trace(store, path)
        wrong, ties = self.compare(hits, answers)
        opaque, _, opaque_info = self.build(scene, "opaque.mill", "--instances", "never", "--ignore-alpha")
        # The same layout for both.
        _, stats = self.trace(store, path, "--layout", "compact")
        opaque_hits, opaque_stats = self.trace(opaque, path, "--layout", "compact")
        counts = report["import"]["counts"]
        self.table.row(name, self.rays, info["triangles"], counts.get("masked_triangles", {}).get("count", 0),
                       counts.get("dropped_cut_out", {}).get("count", 0), wrong, ties,
                       f"{stats['rays_per_second'] / 1e6:.2f}", f"{opaque_stats['rays_per_second'] / 1e6:.2f}",
                       f"{stats['texels_read'] / max(stats['triangles_tested'], 1):.4f}",
                       f"{info['store_bytes'] / info['triangles']:.2f}")
        differ = int((hits["t"] != opaque_hits["t"]).sum())
        print(f"  masks change {differ} answers; {stats['masks_tested']} hits on masks, {stats['texels_read']} texels of "
              f"{stats['triangles_tested']} triangle tests; store {info['store_bytes']} bytes, opaque "
              f"{opaque_info['store_bytes']}; {info.get('masks')}", flush=True)
        self.check(f"{name}: {wrong} of {self.rays} rays hit something else than the reference says", wrong == 0)
        self.check(f"{name}: {ties} ties", ties <= self.rays // 1000)
        self.check(f"{name}: masks matter", differ > 0)
        self.everywhere(name, store, info, path, hits)
        return store, path, hits

    def everywhere(self, name, store, info, path, hits):
        """The same bytes however they come."""
        ways = {"two threads": ["--threads", "2"], "scalar": ["--isa", "scalar"]}
        for share in (4, 20):
            little = info["least_memory_bytes"] + info["decoded_bytes"] // share
            ways[f"1/{share} of memory"] = ["--memory", little]
        few = self.folder / "few.npy"
        np.save(few, np.load(path)[:500 if self.options.short else 20_000])
        for way, words in ways.items():
            again, stats = self.trace(store, path, *words)
            self.check(f"{name}, {way}: the same bytes ({stats['pages_read']} pages read)",
                       again.tobytes() == hits.tobytes())
        some = len(np.load(few))
        again, _ = self.trace(store, few, "--adversarial")
        self.check(f"{name}, suspended everywhere: the same bytes", again.tobytes() == hits[:some].tobytes())
        hit = np.isfinite(hits["t"])
        any_hit, _ = self.trace(store, path, "--query", "any")
        self.check(f"{name}: any hit says the same", ((any_hit["t"] == 0) == hit).all())
        # Along an axis many rays meet borders of a surface, where a hit need not be a crossing (traversal/crossings.md).
        off_axis = (np.load(path)[:, 4:7] != 0).all(axis=1)
        counts, _ = self.trace(store, path, "--query", "count")
        self.check(f"{name}: a count is 0 where there is no hit", ((counts > 0) == hit)[off_axis].all())
        first, _ = self.trace(store, path, "--query", "all", "--first", "1")
        nearest = np.full(len(hits), np.inf, np.float32)
        nearest[counts > 0] = first["t"]
        self.check(f"{name}: the first of all hits is the closest", (nearest == hits["t"])[off_axis].all())

    def modes(self, name, scene, store, path, hits, *words):
        answers = {}
        for mode in ("exact", "fast"):
            answers[mode], _ = self.trace(store, path, "--mode", mode)
            other = int((answers[mode]["primitive_id"] != hits["primitive_id"]).sum())
            self.check(f"{name}, mode {mode}: {other} rays hit another triangle than watertight ones",
                       other <= max(2, len(hits) // 2000))
        narrow, _, _ = self.build(scene, "narrow.mill", "--instances", "never", "--width", "4", "--codec", "lz4",
                                  "--page-size", "16K", *words)
        again, _ = self.trace(narrow, path)
        self.check(f"{name}, 4 wide in small pages: the same bytes", again.tobytes() == hits.tobytes())

    def instances(self, name, scene, path, hits, *words):
        store, report, info = self.build(scene, "placed.mill", "--instances", "always", *words)
        placed, _ = self.trace(store, path)
        other = int((placed["primitive_id"] != hits["primitive_id"]).sum())
        self.check(f"{name}, {info['instances']} instances of {info['objects']} objects: {other} rays hit another "
                   "triangle than in world space", info["instances"] > 0 and other <= max(4, len(hits) // 200))
        self.everywhere(name + ", placed", store, info, path, placed)

    def made(self):
        for seed in (1,) if self.options.short else (1, 2, 3):
            scene = make_scene(self.folder, seed, 8 if self.options.short else 24)
            words = ("--blend-as-mask", "0.4", "--cull-back-faces")
            store, path, hits = self.scene(f"made {seed}", scene, *words, blend_cutoff=0.4, one_side=True)
            self.modes(f"made {seed}", scene, store, path, hits, *words)
            self.instances(f"made {seed}", scene, path, hits, *words)

    def bad(self):
        for name, scene, words, rc, says in bad_textures.cases(self.folder):
            out = self.folder / "bad.mill"
            done = subprocess.run([str(word) for word in (self.options.raymill, "build", scene, "-o", out, *words)],
                                  capture_output=True, text=True)
            said = done.stderr if rc else done.stdout
            print(f"  {done.returncode:3} {name}: {done.stderr.strip()[-160:]}", flush=True)
            self.check(f"{name}: ends with {rc} and says '{says}'", done.returncode == rc and says in said)
            self.check(f"{name}: one sentence, nothing left", done.stderr.count("\n") == (1 if rc else 0) and
                       (rc == 0 or not list(self.folder.glob("bad.mill*"))))
            for path in self.folder.glob("bad.mill*"):
                path.unlink()
        edge = 2048 if self.options.short else 16384
        store, report, info = self.build(bad_textures.large(self.folder, edge), "large.mill", "--memory", "256M")
        self.check(f"{edge} x {edge} texels in 256 MiB: peak {report['peak_rss_bytes'] >> 20} MiB, "
                   f"{info['masks']['pages']} pages of masks", report["peak_rss_bytes"] <= 256 << 20)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--raymill", required=True, type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--reference", required=True, type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--short", action="store_true", help="the form that ctest runs: 4000 rays, the small scenes")
    parser.add_argument("--only", help="of the scenes' names")
    options = parser.parse_args()
    scenes = scenes_folder()
    with tempfile.TemporaryDirectory(prefix="raymill-masks-", dir=os.environ.get("TMPDIR")) as folder:
        trial = Trial(options, folder)
        if options.only in (None, "bad"):
            trial.bad()
        if options.only in (None, "made"):
            trial.made()
        if options.only in (None, "parts"):
            parts.try_parts(trial)
        for name, file in SCENES.items() if scenes else ():
            if options.only in (None, name) and not (options.short and name == "torque_forest"):
                trial.scene(name, scenes / name / file)
    return trial.ended("masks")


if __name__ == "__main__":
    sys.exit(main())
