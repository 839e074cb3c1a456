"""A memory cgroup (v1) with a hard limit on memory and swap together, or on memory alone; root only."""

import os
import pathlib
import time

ROOT = pathlib.Path("/sys/fs/cgroup/memory")


class MemoryCgroup:
    def __init__(self, path, limit_bytes):
        self.path = path
        self.limit_bytes = limit_bytes
        self.max_bytes = 0
        self.failures = 0

    @staticmethod
    def refusal():
        """Why none can be made here, or None."""
        if os.geteuid() != 0:
            return "needs root"
        if not (ROOT / "memory.limit_in_bytes").exists():
            return f"no version 1 memory controller at {ROOT}"
        try:
            probe = ROOT / f"raymill-probe-{os.getpid()}"
            probe.mkdir()
            probe.rmdir()
        except OSError as error:
            return str(error)
        return None

    @classmethod
    def create(cls, limit_bytes):
        path = ROOT / f"raymill-trial-{os.getpid()}"
        path.mkdir(exist_ok=True)
        (path / "memory.limit_in_bytes").write_text(str(limit_bytes))
        both = path / "memory.memsw.limit_in_bytes"  # absent where the kernel does not account swap
        if both.exists():
            both.write_text(str(limit_bytes))
        return cls(path, limit_bytes)

    @classmethod
    def create_open(cls):
        """Without a limit yet; what limit() then takes from it goes to swap."""
        path = ROOT / f"raymill-open-{os.getpid()}"
        path.mkdir(exist_ok=True)
        return cls(path, None)

    def limit(self, limit_bytes, seconds=600):
        """Sets the limit on memory, None for none. The kernel says busy until it has written enough to swap."""
        end = time.monotonic() + seconds
        while True:
            try:
                (self.path / "memory.limit_in_bytes").write_text(str(-1 if limit_bytes is None else limit_bytes))
                self.limit_bytes = limit_bytes
                return
            except OSError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)

    def used_bytes(self):
        return int((self.path / "memory.usage_in_bytes").read_text())

    def close(self):
        """Notes the most that was charged, and how often the limit was met, and removes the group."""
        self.max_bytes = int((self.path / "memory.max_usage_in_bytes").read_text())
        self.failures = int((self.path / "memory.failcnt").read_text())
        for _ in range(50):  # the last process may not be gone yet
            try:
                self.path.rmdir()
                return
            except OSError:
                time.sleep(0.02)
