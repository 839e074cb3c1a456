"""Data goes one way: fails on an #include that goes back up the layers.

A file may include what stands in its own layer or before it. Intrinsics stand in one folder; OpenImageIO and OpenVDB
are included by programs of their own alone.

    layering_lint.py REPOSITORY | --self-test
"""

import re
import sys

import checker

# In the data's way, first to last. A path belongs to the longest layer that it begins with.
LAYERS = [
    "storage/base",
    "storage/import",
    "storage/build",
    "storage/volume",
    "storage/pages",
    "storage/io",
    "storage/cache",
    "storage",  # files that stand in storage/ itself
    "traversal",
    "server",
    "client/cpp",
    "client/cli",
    "client",
]
INTRINSICS = re.compile(r"(imm|xmm|emm|pmm|tmm|smm|nmm|wmm|amm|x86|avx\w*)intrin\.h|arm_(neon|sve|acle)\.h")
INTRINSICS_FOLDER = "traversal/simd/"
IMAGE_LIBRARIES = re.compile(r"(OpenImageIO|openvdb|nanovdb)/")
IMAGE_FILES = re.compile(r"client/cli/(image/|image_)|storage/import/vdb/|tests/")

SOURCE = re.compile(r"\.(h|cc|inl|cu|cuh)$")
INCLUDE = re.compile(r'^\s*#\s*include\s*(["<])([^">]+)[">]', re.MULTILINE)


def layer(path):
    """The place of `path` in LAYERS, or None for what is no layer of ours."""
    matches = [name for name in LAYERS if path.startswith(name + "/")]
    return LAYERS.index(max(matches, key=len)) if matches else None


def violations(root, files):
    for file in files:
        text = (root / file).read_text(encoding="utf-8", errors="replace")
        for match in INCLUDE.finditer(text):
            bracket, target = match.groups()
            where = f"{file}:{text.count(chr(10), 0, match.start(2)) + 1}"
            if INTRINSICS.fullmatch(target) and not file.startswith(INTRINSICS_FOLDER):
                yield f"{where}: intrinsics ({target}) stand in {INTRINSICS_FOLDER} only"
            if IMAGE_LIBRARIES.match(target) and not IMAGE_FILES.match(file):
                yield f"{where}: {target} belongs in a program of its own only: client/cli/image, storage/import/vdb"
            if bracket != '"' or layer(file) is None:
                continue
            if "/" not in target or target.startswith("."):
                if "/" in target or (root / file).parent.joinpath(target).exists():
                    yield f'{where}: "{target}": includes are written from the repository\'s root'
                continue
            to = layer(target)
            if to is not None and to > layer(file):
                yield f"{where}: {LAYERS[layer(file)]} must not include {LAYERS[to]} ({target}): data goes one way"


BAD = {
    "storage/base/up.h": '#include "storage/import/scene.h"\n',
    "storage/build/up.cc": '#pragma once\n\n  #  include "storage/pages/page.h"\n',
    "storage/cache/up.cc": '#include "traversal/ray.h"\n',
    "traversal/up.cc": '#include "server/job.h"\n',
    "server/up.cc": '#include "client/cpp/client.h"\n',
    "client/cpp/up.cc": '#include "client/cli/main.h"\n',
    "traversal/kernel.cc": "#include <immintrin.h>\n",
    "storage/pages/planes.cc": "#include <arm_neon.h>\n",
    "traversal/mask.cc": "#include <OpenImageIO/imageio.h>\n",
    "storage/import/vdb.cc": "#include <openvdb/openvdb.h>\n",
    "server/relative.cc": '#include "../storage/base/status.h"\n',
}
GOOD = {
    "storage/base/status.h": "#include <string>\n",
    "storage/cache/cache.cc": '#include "storage/base/status.h"\n#include "storage/io/reader.h"\n',
    "traversal/simd/avx2.cc": '#include <immintrin.h>\n#include "storage/pages/page.h"\n',
    "traversal/engine.h": '#include "traversal/service.h"\n// #include "server/job.h"\n',
    "client/cli/image/main.cc": "#include <OpenImageIO/imageio.h>\n",
    "client/cli/main.cc": '#include "client/cpp/raymill.h"\n#include "server/server.h"\n',
    "tests/unit/any.cc": '#include "client/cli/main.h"\n#include "storage/base/status.h"\n',
}


if __name__ == "__main__":
    sys.exit(checker.main(violations, BAD, GOOD, "none includes what stands after it", SOURCE.search))
