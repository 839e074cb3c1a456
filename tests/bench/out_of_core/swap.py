"""A swap file of our own, for the time of a with statement; root only."""

import os
import shutil
import subprocess


class SwapRefused(Exception):
    """Why none can be had here."""


class SwapFile:
    def __init__(self, folder, size):
        self.path = folder / "raymill-bench.swap"
        self.size = size
        self.on = False

    def __enter__(self):
        if os.geteuid() != 0:
            raise SwapRefused("making a swap file needs root")
        free = shutil.disk_usage(self.path.parent).free
        if free < self.size * 1.1:
            raise SwapRefused(f"a swap file of {self.size >> 20} MiB does not fit {self.path.parent}")
        try:
            with open(self.path, "wb") as file:
                os.fchmod(file.fileno(), 0o600)
                os.posix_fallocate(file.fileno(), 0, self.size)
            self._tool("mkswap", self.path)
            self._tool("swapon", self.path)
        except (OSError, SwapRefused) as error:
            self.path.unlink(missing_ok=True)
            raise SwapRefused(str(error)) from error
        self.on = True
        return self

    def __exit__(self, *_):
        if self.on:
            subprocess.run(["swapoff", self.path], check=False, capture_output=True)
        self.path.unlink(missing_ok=True)

    @staticmethod
    def _tool(*command):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise SwapRefused(f"{command[0]}: {done.stderr.strip()}")
