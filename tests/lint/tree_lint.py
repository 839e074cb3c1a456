"""What stands in the repository: allowed entries at the top, no overlong file, no path of somebody's machine, and links
in its pages that lead somewhere.

    tree_lint.py REPOSITORY | --self-test
"""

import re
import sys

import checker

TOP = {"CMakeLists.txt", "CMakePresets.json", "LICENSE", "README.md",
       "client", "deploy", "server", "storage", "tests", "traversal"}
MAX_LINES = 500
CODE = re.compile(r"(\.(h|cc|inl|cu|cuh|py|sh|cmake|proto|md|yml)|CMakeLists\.txt|\.ci/run)$")
# Written in pieces, so that this file does not report itself.
MACHINE_PATH = re.compile(r"(?<![\w.~])/(home|root|Users|wo" r"rk)/\w")
UNFINISHED = re.compile(r"\b(TO" r"DO|FIX" r"ME|XX" r"X)\b")
# Named by the layer that a folder would stand in, an old copy has no place.
LINK = re.compile(r"\]\(([^)#\s]+)(#[^)\s]*)?\)")
OLD_COPY = re.compile(r"(^|/)(old|backup|copy|tmp)\d*(/|$)|\.(orig|bak|rej)$|~$")


def violations(root, files):
    for name in sorted({file.split("/")[0] for file in files}):
        if name not in TOP and not name.startswith("."):
            yield f"{name}: does not belong at the top; allowed: {' '.join(sorted(TOP))} and dot files"
    for file in files:
        if OLD_COPY.search(file):
            yield f"{file}: an old copy"
        if not CODE.search(file):
            continue
        lines = (root / file).read_text(encoding="utf-8", errors="replace").splitlines()
        if len(lines) > MAX_LINES:
            yield f"{file}: {len(lines)} lines; split what is longer than {MAX_LINES}"
        for number, line in enumerate(lines, 1):
            if MACHINE_PATH.search(line):
                yield f"{file}:{number}: a path of one machine: {line.strip()}"
            if UNFINISHED.search(line):
                yield f"{file}:{number}: unfinished: {line.strip()}"
            for target, _ in LINK.findall(line) if file.endswith(".md") else []:
                if "://" not in target and not (root / file).parent.joinpath(target).exists():
                    yield f"{file}:{number}: a link to what is not there: {target}"


BAD = {
    "scratch/notes.txt": "a folder that is not allowed\n",
    "client/long.cc": "int x;\n" * (MAX_LINES + 1),
    "client/path.cc": f'open("/{"home"}/somebody/scene.gltf");\n',
    "deploy/path.sh": f"cd /{'wo'}rk/main\n",
    "server/later.cc": f"// {'TO'}DO: later\n",
    "traversal/old2/kernel.cc": "\n",
    "tests/README.md": "see [unit](unit/README.md)\n",
}
GOOD = {
    "README.md": "see [import](storage/import/golden.json#top), [more](https://example.org) and build/release\n",
    ".clang-format": "\n",
    "client/short.cc": "int x;\n" * MAX_LINES,
    "deploy/install.sh": f"/usr/bin/env ~/{'wo'}rk/x ../{'wo'}rk/y https://example.org/home/page\n",
    "storage/import/golden.json": "1\n" * 5000,
}


if __name__ == "__main__":
    sys.exit(checker.main(violations, BAD, GOOD, "all in order"))
