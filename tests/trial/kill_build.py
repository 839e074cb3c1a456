"""A build that is ended at any moment leaves the store that was there before, or none, and nothing that takes its room.

    kill_build.py --raymill RAYMILL [--triangles N] [--memory SIZE] [--rounds N] [--seed N] [--short]

SIGTERM, SIGINT and SIGKILL in turn, each at a random moment of a build that waits on disk (--seed draws them). After the
first two no file is left and the exit code tells the signal. SIGKILL may leave NAME.PID-N.tmp, which the next build of
the same output removes; that build gives the bytes of an undisturbed one.
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

TEMPORARY = re.compile(r"(scene\.mill|stats\.json)\.\d+-\d+\.tmp")
SIGNALS = {signal.SIGTERM: 143, signal.SIGINT: 130, signal.SIGKILL: -signal.SIGKILL}
OLD = b"an old store"
# How long a build may go on after a signal: a run of each thread, on a machine that is busy.
MOST_SECONDS = 20


def handles(pid, number):
    """Whether the process has installed a handler for the signal."""
    for line in pathlib.Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("SigCgt:"):
            return int(line.split()[1], 16) >> (number - 1) & 1 == 1
    return False


class Trial:
    def __init__(self, options, folder):
        self.folder = folder
        self.out = folder / "out"
        self.out.mkdir()
        self.store, self.stats = self.out / "scene.mill", self.out / "stats.json"
        scene = folder / "scene.gltf"
        support.run(options.raymill, "generate", "forest", "--triangles", options.triangles, "-o", scene)
        self.command = [str(word) for word in [options.raymill, "build", scene, "-o", self.store, "--stats", self.stats,
                                               "--memory", options.memory, "--progress", "json"]]
        self.problems = []
        self.random = random.Random(options.seed)
        told = self.build()
        self.truth = support.sha256(self.store)
        self.seconds = sum(told["seconds"].values())
        if told["temporary_bytes"] == 0:
            self.problems.append("the build needs no temporary file; give it less --memory")
        print(f"undisturbed: {self.seconds:.2f} s, {support.mib(told['temporary_bytes'])} MiB of temporary file")
        self.table = support.Table(signal=8, moment=7, phase=10, old=4, rc=4, stopped=8, left=5, same=5)

    def build(self):
        """Runs the build undisturbed; returns its report."""
        support.run(*self.command)
        told = json.loads(self.stats.read_text(encoding="utf-8"))
        self.stats.unlink()
        return told

    def names(self):
        return sorted(path.name for path in self.out.iterdir())

    def end_one(self, number, moment):
        """Starts a build, sends the signal after so many seconds; returns its exit code, phase and time to stop."""
        with open(self.folder / "progress", "w+", encoding="utf-8") as progress:
            build = subprocess.Popen(self.command, stdout=progress, stderr=subprocess.PIPE, text=True)
            support.wait_until(lambda: build.poll() is not None or handles(build.pid, signal.SIGTERM), 20, 0.001)
            time.sleep(moment)
            sent = time.monotonic()
            build.send_signal(number)
            try:
                build.communicate(timeout=MOST_SECONDS)
            except subprocess.TimeoutExpired:
                build.kill()
                build.communicate()
            seconds = time.monotonic() - sent
            progress.seek(0)
            phases = re.findall(r'"phase":"(\w+)"', progress.read())
        return build.returncode, phases[-1] if phases else "start", seconds

    def round(self, number):
        for name in self.names():
            (self.out / name).unlink()
        old = self.random.random() < 0.5
        if old:
            self.store.write_bytes(OLD)
        moment = self.random.uniform(0, self.seconds)
        rc, phase, seconds = self.end_one(number, moment)
        names = self.names()
        faults = []
        if rc == 0:  # the signal came too late
            if names != ["scene.mill", "stats.json"] or support.sha256(self.store) != self.truth:
                faults.append(f"ended well with {names}")
        else:
            if rc != SIGNALS[number]:
                faults.append(f"ended with {rc}, not {SIGNALS[number]}")
            if seconds > MOST_SECONDS:
                faults.append(f"did not stop within {MOST_SECONDS} s")
            # A kill between the two names that a build gives: the store has its own, the stats have not.
            whole = number == signal.SIGKILL and self.store.exists() and support.sha256(self.store) == self.truth
            if old and not whole and (not self.store.exists() or self.store.read_bytes() != OLD):
                faults.append("the old store is not what it was")
            left = [name for name in names if name != "scene.mill" or not (old or whole)]
            if number != signal.SIGKILL and left:
                faults.append(f"left {left}")
            faults += [f"left {name}" for name in left if not TEMPORARY.fullmatch(name)]
        same = "-"
        if number == signal.SIGKILL:
            self.build()
            same = "yes" if support.sha256(self.store) == self.truth else "NO"
            if same == "NO":
                faults.append("the build after it gives another store")
            if self.names() != ["scene.mill"]:
                faults.append(f"the build after it leaves {self.names()}")
        what = signal.Signals(number).name
        self.table.row(what, f"{moment:.2f} s", phase, "yes" if old else "no", rc, f"{seconds:.2f} s",
                       sum(1 for name in names if TEMPORARY.fullmatch(name)), same)
        self.problems += [f"{what} after {moment:.3f} s: {fault}" for fault in faults]


def main():
    options = support.parser(__doc__)
    options.add_argument("--triangles", default="3M")
    options.add_argument("--memory", default="128M")
    options.add_argument("--rounds", type=int, default=60)
    options.add_argument("--seed", type=int, default=1)
    options = options.parse_args()
    if options.short:
        options.triangles, options.memory, options.rounds = "600k", "64M", 9
    with support.work_folder(options) as folder:
        trial = Trial(options, pathlib.Path(folder))
        for i in range(options.rounds):
            trial.round(list(SIGNALS)[i % len(SIGNALS)])
    return support.ended(trial.problems, f"builds that were ended, {options.rounds} of them, seed {options.seed}")


if __name__ == "__main__":
    sys.exit(main())
