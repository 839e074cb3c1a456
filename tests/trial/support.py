"""What the trials share: running the program and watching its memory, a server, tables, scenes."""

import argparse
import hashlib
import json
import math
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
MIB = 1 << 20


class Failure(Exception):
    """A run that did not do what the trial needs; the message says which and what it printed."""

    def __init__(self, message, rc=None, stderr=""):
        super().__init__(message)
        self.rc, self.stderr = rc, stderr


def program(path):
    """The type of an option that names a program."""
    return pathlib.Path(path).resolve()


def folder(path):
    """The type of an option that names a folder, which is made where there is none."""
    path = pathlib.Path(path).resolve()
    path.mkdir(parents=True, exist_ok=True)
    return path


def parser(text):
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # files are removed on the way out
    options = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=program, help="the program: build/release/bin/raymill")
    options.add_argument("--work", type=folder,
                         help="folder for the trial's files, removed at the end; default TMPDIR")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    return options


def work_folder(options):
    return tempfile.TemporaryDirectory(prefix="raymill-trial-", dir=options.work)


def scenes_folder():
    """The scene collection, or None. With RAYMILL_REQUIRE_SCENES=1 a missing one ends the trial."""
    folder = pathlib.Path(os.environ.get("RAYMILL_SCENES", HERE.parents[2] / "shared" / "scenes"))
    if (folder / "MANIFEST.tsv").exists():
        return folder
    if os.environ.get("RAYMILL_REQUIRE_SCENES") == "1":
        sys.exit(f"no scenes in {folder}; set RAYMILL_SCENES")
    return None


# Where less than the whole of --memory is "given", the difference counts.
NEEDED = re.compile(r"needs? (?:at least )?([0-9.]+) MiB.*?([0-9.]+) ([KM])iB (?:given|left)")


def more_memory(limit, stderr):
    """The limit under which a program that ended with 33 would run, by its own words."""
    needed = NEEDED.search(stderr)
    missing = float(needed[1]) - float(needed[2]) / (1024 if needed[3] == "K" else 1) if needed else 0
    return math.ceil(limit / MIB + max(missing, 0.1)) * MIB


class Run:
    """A finished run: rc, stdout, stderr, seconds, user_seconds, and rss_bytes, the kernel's count of its peak."""

    def __init__(self, command, timeout=None, cgroup=None, limits=()):
        self.command = [str(word) for word in command]
        with tempfile.NamedTemporaryFile(prefix="raymill-run-") as report:
            launcher = [sys.executable, "-I", "-S", HERE / "launch.py", report.name, cgroup or "-", *limits, "--"]
            done = subprocess.run(launcher + self.command, capture_output=True, text=True, timeout=timeout)
            self.stdout, self.stderr = done.stdout, done.stderr
            told = json.loads(pathlib.Path(report.name).read_text() or "{}")
        self.rc = told.get("rc")
        self.rss_bytes = told.get("rss_bytes", 0)
        self.seconds, self.user_seconds = told.get("seconds", 0), told.get("user_seconds", 0)

    def need(self, rc=0):
        if self.rc != rc:
            raise Failure(f"{' '.join(self.command)}\n  ended with {self.rc}, not {rc}: {self.stderr.strip()}")
        return self


def run(*command, rc=0, **options):
    return Run(command, **options).need(rc)


def run_json(*command):
    return json.loads(run(*command).stdout)


def scene(raymill, folder, name):
    """The scene's file: `name` itself, or KIND:TRIANGLES, made in `folder` unless it is there."""
    if ":" not in name:
        return pathlib.Path(name)
    kind, triangles = name.split(":")
    path = folder / f"{kind}-{triangles}.gltf"
    if not path.exists():
        run(raymill, "generate", kind, "--triangles", triangles, "-o", path)
    return path


def sha256(path):
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def vm_hwm_bytes(pid):
    try:
        status = pathlib.Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    for line in status.splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) << 10
    return 0


class Server:
    """raymill serve over an ipc socket in `folder`, for a with statement."""

    def __init__(self, raymill, stores, folder, *options):
        self.address = f"ipc://{folder}/server.sock"
        command = [raymill, "serve", "--stores", stores, "--bind", self.address, "--spool", folder, *options]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        if not self.process.stdout.readline().startswith("raymill serves"):
            stderr = self.process.communicate()[1].strip()
            raise Failure(f"the server did not start: {stderr}", self.process.returncode, stderr)

    @property
    def pid(self):
        return self.process.pid

    def alive(self):
        return self.process.poll() is None

    def rss_bytes(self):
        return vm_hwm_bytes(self.pid)

    def stop(self):
        """Ends it as a user would; returns its exit code."""
        if self.alive():
            self.process.send_signal(signal.SIGTERM)
        try:
            self.process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
        return self.process.returncode

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()


def wait_until(what, seconds, step=0.02):
    """Whether `what` came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if what():
            return True
        time.sleep(step)
    return what()


class Table:
    """Rows printed as they come, columns as wide as said."""

    def __init__(self, **columns):
        self.widths = list(columns.values())
        self.row(*columns.keys())
        self.row(*("-" * width for width in self.widths))

    def row(self, *cells):
        text = [str(cell).ljust(width) if i == 0 else str(cell).rjust(width)
                for i, (cell, width) in enumerate(zip(cells, self.widths))]
        print("  ".join(text).rstrip(), flush=True)


def mib(size):
    return f"{size / MIB:.1f}"


def add_run(path, lines):
    """Appends a run's lines to those of earlier ones, each with the run's time and commit."""
    told = subprocess.run(["git", "-C", str(pathlib.Path(__file__).parent), "rev-parse", "--short", "HEAD"],
                          capture_output=True, text=True, check=False)
    run = {"at": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "commit": told.stdout.strip()}
    with open(path, "a", encoding="utf-8") as file:
        file.writelines(json.dumps(line | {"run": run}) + "\n" for line in lines)


def run_bench(make, options, name):
    """Runs make(options, folder), a bench with lines and problems, in options.work or a folder that is removed; prints
    its lines of JSON and how to repeat it. Returns the exit code."""
    with tempfile.TemporaryDirectory(prefix="raymill-bench-") as temporary:
        bench = make(options, options.work or pathlib.Path(temporary))
        try:
            bench.run()
        except Failure as failure:
            bench.problems.append(str(failure))
    for line in bench.lines:
        print(json.dumps(line))
    if getattr(options, "runs", None):
        add_run(options.runs, bench.lines)
    print(f"again: {shlex.join([sys.executable, *sys.argv])}")
    return ended(bench.problems, name)


class Checks:
    """Stores that are built and traced, and what is said of them. Each check is told as it is made; in a short form only
    those that fail."""

    def __init__(self, options, folder):
        self.options, self.folder, self.failures = options, pathlib.Path(folder), []

    def check(self, what, holds):
        if not holds or not getattr(self.options, "short", False):
            print(("  ok    " if holds else "  WRONG ") + what, flush=True)
        if not holds:
            self.failures.append(what)

    def build(self, scene, name, *words):
        """(store, what `build` says, what `info` says)"""
        store = self.folder / name
        report = run_json(self.options.raymill, "build", scene, "-o", store, "--json", *words)
        run(self.options.raymill, "verify", store)
        return store, report, run_json(self.options.raymill, "info", store, "--json")

    def trace(self, store, rays, *words):
        """(rows, stats)"""
        import numpy  # here, for not every trial needs it
        out, stats = self.folder / "out.npy", self.folder / "stats.json"
        run(self.options.raymill, "trace", store, rays, "-o", out, "--stats", stats, *words)
        return numpy.load(out), json.loads(stats.read_text())

    def ended(self, what):
        """Prints the last line; returns the exit code."""
        return ended(self.failures, what)


def ended(problems, what):
    """Prints the trial's last line; returns its exit code."""
    for problem in problems:
        print(f"FAILED: {problem}")
    print(f"{what}: {'passed' if not problems else f'{len(problems)} failed'}", flush=True)
    return 1 if problems else 0
