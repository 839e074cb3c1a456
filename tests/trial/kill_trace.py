"""A trace that is ended at any moment leaves nothing; with --resume it leaves its finished rows and goes on from them.

    kill_trace.py --raymill RAYMILL [--triangles N] [--rays N] [--rounds N] [--seed N] [--short]

SIGTERM, SIGINT and SIGKILL in turn, each at a random moment (--seed draws them), with and without --resume. Without it no
hits and, but for SIGKILL's NAME.PID-N.tmp, no other file are left. With it the command is repeated until it ends well: the
hits are those of an undisturbed run, every repetition begins where the last one ended, and no file beside them is left.
"""

import json
import pathlib
import random
import re
import signal
import subprocess
import sys
import time

import support

SIGNALS = {signal.SIGTERM: 143, signal.SIGINT: 130, signal.SIGKILL: -signal.SIGKILL}
TEMPORARY = re.compile(r"(hits\.npy|stats\.json)\.\d+-\d+\.tmp")
MOST_SECONDS = 20


class Trial:
    def __init__(self, options, folder):
        self.out = folder / "out"
        self.out.mkdir()
        self.hits, self.part = self.out / "hits.npy", self.out / "hits.npy.part"
        self.stats = self.out / "stats.json"
        scene, store, rays = folder / "scene.gltf", folder / "scene.mill", folder / "rays.npy"
        support.run(options.raymill, "generate", "mixed", "--triangles", options.triangles, "-o", scene)
        support.run(options.raymill, "build", scene, "-o", store)
        support.run(options.raymill, "rays", store, "--kind", "random", "--count", options.rays, "-o", rays)
        self.command = [str(word) for word in [options.raymill, "trace", store, rays, "-o", self.hits, "--stats", self.stats,
                                               "--memory", options.memory, "--progress", "none"]]
        self.problems = []
        self.random = random.Random(options.seed)
        begin = time.monotonic()
        support.run(*self.command)
        self.seconds = time.monotonic() - begin
        self.truth, self.size = support.sha256(self.hits), self.hits.stat().st_size
        self.rays = json.loads(self.stats.read_text(encoding="utf-8"))["rays"]
        print(f"undisturbed: {self.seconds:.2f} s for {self.rays} rays")
        self.table = support.Table(signal=8, resume=6, ended=30, traced=10, same=5)

    def run(self, command, number=None):
        """Runs the command and sends the signal at a random moment; returns the exit code."""
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if number is not None:
            time.sleep(self.random.uniform(0.05, self.seconds))
            process.send_signal(number)
        try:
            process.communicate(timeout=None if number is None else MOST_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            self.problems.append(f"did not stop within {MOST_SECONDS} s of {number}")
        return process.returncode

    def clean(self):
        for path in self.out.iterdir():
            path.unlink()

    def plain(self, number):
        self.clean()
        rc = self.run(self.command, number)
        names = sorted(path.name for path in self.out.iterdir())
        what = signal.Signals(number).name
        left = [name for name in names if not (number == signal.SIGKILL and TEMPORARY.fullmatch(name))]
        if rc != 0 and (rc != SIGNALS[number] or left):
            # A kill between the two names that a trace gives.
            whole = left == ["hits.npy"] and support.sha256(self.hits) == self.truth
            if rc != SIGNALS[number] or not (number == signal.SIGKILL and whole):
                self.problems.append(f"{what}: exit code {rc}, left {left}")
        self.table.row(what, "no", str(rc), "-", "-")

    def resumed(self, number):
        self.clean()
        ends, done = [], 0
        for attempt in range(40):
            last = attempt == 39 or (attempt > 0 and self.random.random() < 0.3)
            rc = self.run(self.command + ["--resume"], None if last else number)
            ends.append(rc)
            if rc == 0:
                break
            if rc != SIGNALS[number]:
                self.problems.append(f"{signal.Signals(number).name}, --resume: exit code {rc}")
                break
            if self.hits.exists():
                self.problems.append("unfinished hits have the output's name")
            size = self.part.stat().st_size if self.part.exists() else 0
            if size < done:
                self.problems.append(f"a repetition went back from {done} to {size} bytes")
            done = size
        traced = json.loads(self.stats.read_text(encoding="utf-8"))["rays"] if self.stats.exists() else 0
        same = self.hits.exists() and support.sha256(self.hits) == self.truth
        if not same:
            self.problems.append(f"{signal.Signals(number).name}, --resume: the hits differ")
        expected = self.rays - max(0, done - (self.size - self.rays * self.row_bytes())) // self.row_bytes()
        if traced != expected:
            self.problems.append(f"the last run traced {traced} rays where {expected} were left")
        left = sorted(path.name for path in self.out.iterdir() if path.name not in ("hits.npy", "stats.json"))
        if [name for name in left if not (number == signal.SIGKILL and TEMPORARY.fullmatch(name))]:
            self.problems.append(f"left {left}")
        self.table.row(signal.Signals(number).name, "yes", " ".join(map(str, ends)), traced, "yes" if same else "NO")

    def row_bytes(self):
        return self.size // self.rays


def main():
    options = support.parser(__doc__)
    options.add_argument("--triangles", default="2M")
    options.add_argument("--rays", default="4M")
    options.add_argument("--memory", default="40M")
    options.add_argument("--rounds", type=int, default=30)
    options.add_argument("--seed", type=int, default=1)
    options = options.parse_args()
    if options.short:
        options.triangles, options.rays, options.rounds = "200k", "1500k", 6
        options.memory = "24M"
    with support.work_folder(options) as folder:
        trial = Trial(options, pathlib.Path(folder))
        for i in range(options.rounds):
            number = list(SIGNALS)[i // 2 % len(SIGNALS)]
            (trial.plain if i % 2 == 0 else trial.resumed)(number)
    return support.ended(trial.problems, f"traces that were ended, {options.rounds} of them, seed {options.seed}")


if __name__ == "__main__":
    sys.exit(main())
