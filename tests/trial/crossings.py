"""Counts, lists and filters as a user asks for them: files that agree with each other, and the words that are refused.

    crossings.py --raymill RAYMILL [--work DIR] [--short]
"""

import json
import pathlib
import subprocess
import sys

import numpy

import support

NONE = 0xFFFFFFFF
USAGE, INPUT, TEMPORARY = 2, 42, 75


class Trial:
    def __init__(self, options, folder):
        self.raymill, self.folder = options.raymill, pathlib.Path(folder)
        self.rays, self.store = self.folder / "r.npy", self.folder / "s.mill"
        self.problems = []
        scene, count = self.folder / "s.gltf", "20k" if options.short else "2M"
        support.run(self.raymill, "generate", "mixed", "--triangles", "100k" if options.short else "5M", "-o", scene)
        support.run(self.raymill, "build", scene, "-o", self.store, "--page-size", "16K")
        support.run(self.raymill, "rays", self.store, "--kind", "random", "--count", count, "-o", self.rays)

    def expect(self, holds, what):
        if not holds:
            self.problems.append(what)

    def trace(self, *words, name="h.npy"):
        store = self.store.name if "--server" in words else self.store
        done = support.run(self.raymill, "trace", store, self.rays, "-o", self.folder / name, "--json", *words)
        return numpy.load(self.folder / name, mmap_mode="r"), json.loads(done.stdout)

    def lists(self, *words, name="lists.npy"):
        hits, stats = self.trace("--query", "all", *words, name=name)
        return hits, numpy.load(self.folder / name.replace(".npy", ".offsets.npy")), stats

    def agree(self):
        counts, counted = self.trace("--query", "count", name="counts.npy")
        hits, offsets, listed = self.lists()
        self.expect(counts.dtype == numpy.uint32 and offsets.dtype == numpy.uint64, "other types than promised")
        self.expect(offsets[0] == 0 and (numpy.diff(offsets) == counts).all(), "lists are as long as their counts")
        self.expect(counted["crossings"] == listed["crossings"] == len(hits), "stats say how many crossings there are")
        ray = numpy.repeat(numpy.arange(len(counts)), counts)
        self.expect((hits["t"][1:] >= hits["t"][:-1])[ray[1:] == ray[:-1]].all(), "a list is in order")
        for words in (["--memory", "40M", "--layout", "compact"], ["--threads", "1", "--sort-rays", "always"]):
            self.lists(*words, name="others.npy")
            for name in ("lists.npy", "lists.offsets.npy"):
                same = support.sha256(self.folder / name) == support.sha256(self.folder / name.replace("lists", "others"))
                self.expect(same, f"{name} with {' '.join(words)}: other bytes")
        return hits, offsets, counts

    def filters(self, hits, offsets, counts):
        first, first_offsets, _ = self.lists("--first", "2", name="first.npy")
        self.expect((numpy.diff(first_offsets) == numpy.minimum(counts, 2)).all(), "--first 2: other lengths")
        starts = offsets[:-1][counts > 0]
        self.expect((first[first_offsets[:-1][counts > 0]] == hits[starts]).all(), "--first 2: not the nearest")
        skip = numpy.full((len(counts), 2), NONE, numpy.uint32)
        skip[counts > 0] = numpy.stack([hits["geometry_id"][starts], hits["primitive_id"][starts]], 1)
        numpy.save(self.folder / "skip.npy", skip)
        fewer, _ = self.trace("--query", "count", "--skip", self.folder / "skip.npy")
        self.expect((fewer + (counts > 0) == counts).all(), "--skip: not one less")
        numpy.save(self.folder / "geometries.npy", numpy.array([1], numpy.uint32))
        masks = numpy.arange(len(counts), dtype=numpy.uint32) % 2
        numpy.save(self.folder / "masks.npy", masks)
        seen, _ = self.trace("--query", "count", "--geometry-masks", self.folder / "geometries.npy", "--ray-masks",
                             self.folder / "masks.npy")
        hidden = numpy.zeros(len(counts), numpy.int64)
        numpy.add.at(hidden, numpy.repeat(numpy.arange(len(counts)), counts), hits["geometry_id"] == 0)
        self.expect((seen + hidden * (masks == 0) == counts).all(), "masks: other hits are left out")

    def server(self):
        local, _ = self.trace("--query", "count")
        with support.Server(self.raymill, self.folder, self.folder) as server:
            remote, _ = self.trace("--query", "count", "--server", server.address, name="remote.npy")
            self.expect((local == remote).all(), "a server counts something else")
            brought = ["--skip", self.folder / "skip.npy", "--geometry-masks", self.folder / "geometries.npy",
                       "--ray-masks", self.folder / "masks.npy"]
            for words in ([], ["--first", "2"], brought):
                self.lists(*words, name="here.npy")
                self.lists(*words, "--server", server.address, name="there.npy")
                for name in ("here.npy", "here.offsets.npy"):
                    same = support.sha256(self.folder / name) == support.sha256(self.folder / name.replace("here", "there"))
                    self.expect(same, f"{name} {' '.join(map(str, words))}: other bytes through a server")

    def refuse(self, words, rc):
        output = self.folder / "refused.npy"
        store = self.store.name if "--server" in words else self.store
        done = support.Run([self.raymill, "trace", store, self.rays, "-o", output, *words])
        if done.rc != rc or len(done.stderr.strip().splitlines()) != 1 or output.exists():
            self.problems.append(f"{' '.join(map(str, words))}: ended with {done.rc}, not {rc}: {done.stderr.strip()}")

    def refusals(self):
        short = self.folder / "short.npy"
        numpy.save(short, numpy.zeros((3, 2), numpy.uint32))
        for words, rc in [(["--query", "closest", "--first", "2"], USAGE), (["--query", "all", "--resume"], USAGE),
                          (["--query", "count", "--fields", "t"], USAGE), (["--fields", "t,count"], USAGE),
                          (["--mask", "1"], USAGE), (["--skip", self.rays], INPUT), (["--skip", short], INPUT),
                          (["--ray-masks", short], INPUT), (["--geometry-masks", self.folder / "none.npy"], INPUT)]:
            self.refuse(words, rc)
        done = subprocess.run([self.raymill, "trace", self.store, self.rays, "-o", "/dev/null", "--query", "all"],
                              capture_output=True, text=True)
        self.expect(done.returncode == USAGE and "plain file" in done.stderr, f"lists to a device: {done.stderr}")


def main():
    options = support.parser(__doc__).parse_args()
    with support.work_folder(options) as folder:
        trial = Trial(options, folder)
        trial.filters(*trial.agree())
        trial.server()
        trial.refusals()
    return support.ended(trial.problems, "crossings")


if __name__ == "__main__":
    sys.exit(main())
