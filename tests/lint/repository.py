"""The files of the repository: tracked, or new and not ignored; without git, all but what builds leave behind."""

import os
import re
import subprocess

LEFT_BEHIND = re.compile(r"^(build.*|quickstart|\.git|\.cache|compile_commands\.json)$")


def repository_files(root):
    """Sorted paths relative to `root`, with forward slashes."""
    command = ["git", "-c", f"safe.directory={root}", "-C", str(root),
               "ls-files", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    except (OSError, subprocess.CalledProcessError):
        listed = list(walk(root))
    return sorted({name for name in listed if (root / name).is_file()})


def walk(root):
    for folder, folders, names in os.walk(root):
        relative = os.path.relpath(folder, root)
        if relative == ".":
            folders[:] = [name for name in folders if not LEFT_BEHIND.match(name)]
            names = [name for name in names if not LEFT_BEHIND.match(name)]
        folders[:] = [name for name in folders if name != "__pycache__"]
        yield from (os.path.normpath(os.path.join(relative, name)) for name in names)
