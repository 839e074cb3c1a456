"""A small tmpfs of its own, full soon or read-only; root only."""

import os
import subprocess


class Mount:
    def __init__(self, path):
        self.path = path

    @classmethod
    def create(cls, path, size_bytes, read_only):
        """The mount and None, or None and why there is none."""
        if os.geteuid() != 0:
            return None, "needs root"
        path.mkdir(exist_ok=True)
        how = f"size={size_bytes}" + (",ro" if read_only else "")
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", how, "tmpfs", path], capture_output=True, text=True)
        return (cls(path), None) if done.returncode == 0 else (None, done.stderr.strip())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        subprocess.run(["umount", self.path], check=True)
