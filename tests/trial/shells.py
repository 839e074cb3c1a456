"""All hits of rays that leave a nest of shells: as many as there are shells, in order, each once, in time that is linear.

    shells.py --raymill RAYMILL [--work DIR] [--rays 100k] [--memory 64M] [--short]

Stores of 1, 10, 100 and 1000 shells about one point: a closed surface of 320 triangles, larger by one for each. A ray
from there meets every shell once, the k-th at k times the t of the first, whatever triangle it meets: so the lists are
known without a tracer. They are read piece by piece, as they may be larger than memory (100k rays through 1000 shells:
100 M hits, 800 MB, in 64 MiB). Prints processor time a hit and peaks.
"""

import json
import pathlib
import sys

import numpy

import support

TRIANGLES = 320  # of a shell


def shell():
    """(corners (n,3), triangles (320,3)) of an icosahedron whose triangles were cut into four twice, of radius 1."""
    golden = (1 + 5**0.5) / 2
    corners = [(a, b * golden, 0) for a in (-1, 1) for b in (-1, 1)]
    corners = numpy.array(corners + [(0, a, b) for a, b, _ in corners] + [(b, 0, a) for a, b, _ in corners], float)
    near = numpy.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.1
    triangles = [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    for _ in range(2):
        corners, triangles = cut_in_four(list(map(tuple, corners)), triangles)
    return corners / numpy.linalg.norm(corners, axis=1)[:, None], numpy.array(triangles)


def cut_in_four(corners, triangles):
    middles, pieces = {}, []

    def middle(a, b):
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(corners)
            corners.append(tuple((numpy.array(corners[a]) + corners[b]) / 2))
        return middles[key]

    for a, b, c in triangles:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        pieces += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return numpy.array(corners), pieces


def write_nest(path, count):
    """Shells of sizes 1, 2, ... count, one after the other, as PLY."""
    corners, triangles = shell()
    points = (corners[None] * numpy.arange(1, count + 1)[:, None, None]).reshape(-1, 3).astype("<f4")
    faces = numpy.zeros(count * TRIANGLES, dtype=[("n", "u1"), ("corner", "<i4", 3)])
    faces["n"] = 3
    faces["corner"] = (triangles[None] + len(corners) * numpy.arange(count)[:, None, None]).reshape(-1, 3)
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\n"
                   f"property float y\nproperty float z\nelement face {len(faces)}\n"
                   "property list uchar int vertex_indices\nend_header\n".encode())
        file.write(points.tobytes() + faces.tobytes())


class Trial:
    PIECE = 1 << 20  # hits that are looked at together

    def __init__(self, options, folder):
        self.options, self.folder, self.problems = options, pathlib.Path(folder), []
        self.count = int(options.rays.replace("k", "000"))
        self.rays = self.folder / "rays.npy"
        random = numpy.random.default_rng(5)
        rays = numpy.zeros((self.count, 6), numpy.float32)
        rays[:, 3:] = random.normal(size=(self.count, 3))
        rays[:, 3:] /= numpy.linalg.norm(rays[:, 3:], axis=1)[:, None]
        numpy.save(self.rays, rays)

    def expect(self, holds, what):
        if not holds:
            self.problems.append(what)

    def check(self, name, shells):
        """The lists in `name`: for each ray the shells 1, 2, ... in order, each at its multiple of the first one's t."""
        offsets = numpy.load(self.folder / f"{name}.offsets.npy")
        self.expect(numpy.array_equal(offsets, numpy.arange(self.count + 1) * shells), f"{shells} shells: other counts")
        hits = numpy.load(self.folder / f"{name}.npy", mmap_mode="r")
        if len(hits) != self.count * shells:
            return self.expect(False, f"{shells} shells: {len(hits)} hits, not {self.count * shells}")
        rays = max(1, self.PIECE // shells)
        for first in range(0, self.count, rays):
            piece = numpy.array(hits[first * shells:(first + rays) * shells]).reshape(-1, shells)
            order = numpy.arange(1, shells + 1)
            self.expect((piece["primitive_id"] // TRIANGLES + 1 == order).all(), f"{shells} shells: not in their order")
            self.expect((numpy.diff(piece["t"], axis=1) > 0).all(), f"{shells} shells: t does not rise")
            expected = piece["t"][:, :1].astype(float) * order
            self.expect((abs(piece["t"] - expected) <= 1e-6 * expected).all(), f"{shells} shells: t is another")

    def run(self):
        table = support.Table(shells=7, hits=11, MB=8, peak_MiB=8, us_a_hit=9)
        memory = self.options.memory
        for shells in (1, 10, 100) if self.options.short else (1, 10, 100, 1000):
            scene, store = self.folder / "nest.ply", self.folder / "nest.mill"
            write_nest(scene, shells)
            support.run(self.options.raymill, "build", scene, "-o", store, "--page-size", "16K")
            output, stats = self.folder / "hits.npy", self.folder / "stats.json"
            done = support.run(self.options.raymill, "trace", store, self.rays, "-o", output, "--query", "all", "--fields",
                               "t,primitive_id", "--memory", memory, "--stats", stats)
            told = json.loads(stats.read_text())
            self.expect(told["peak_rss_bytes"] <= int(memory[:-1]) << 20, f"{shells} shells: more than {memory}")
            self.check("hits", shells)
            hits = self.count * shells
            table.row(shells, hits, f"{output.stat().st_size / 1e6:.1f}", support.mib(told["peak_rss_bytes"]),
                      f"{done.user_seconds / hits * 1e6:.3f}")
            output.unlink()


def main():
    options = support.parser(__doc__)
    options.add_argument("--rays", default="100k", help="(%(default)s)")
    options.add_argument("--memory", default="64M", help="(%(default)s)")
    options = options.parse_args()
    options.rays = "5k" if options.short else options.rays
    with support.work_folder(options) as folder:
        trial = Trial(options, folder)
        trial.run()
    return support.ended(trial.problems, "shells")


if __name__ == "__main__":
    sys.exit(main())
