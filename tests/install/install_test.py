"""Installs a build and uses it as a stranger would.

    install_test.py CMAKE BUILD_DIRECTORY EXAMPLE_DIRECTORY CXX_COMPILER

The installed program makes a scene, its store and a picture; the example, built outside of the tree by
find_package(Raymill), traces one ray in the store; the installed program traces the same ray. Both must meet the same
triangle at the same distance.
"""

import json
import math
import pathlib
import struct
import subprocess
import sys
import tempfile


def run(*command):
    print("+", *command, flush=True)
    done = subprocess.run([str(part) for part in command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\nexit code {done.returncode}")
    return done.stdout


def write_ray(path, values):
    """One (1, 8) float32 .npy file: org, tnear, dir, tfar."""
    header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 8), }"
    header += " " * (63 - (10 + len(header)) % 64) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + struct.pack("<8f", *values))


def read_hit(path):
    """t, primitive_id and geometry_id of the one row."""
    data = path.read_bytes()
    length = struct.unpack_from("<H", data, 8)[0]
    assert "'t'" in data[10:10 + length].decode(), data[:200]
    return struct.unpack_from("<fII", data, 10 + length)


def as_float32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def main():
    cmake, build, example, compiler = sys.argv[1:]
    with tempfile.TemporaryDirectory(prefix="raymill-install-") as folder:
        folder = pathlib.Path(folder)
        prefix = folder / "prefix"
        raymill = prefix / "bin/raymill"
        store = folder / "scene.mill"
        run(cmake, "--install", build, "--prefix", prefix)
        run(raymill, "generate", "terrain", "--triangles", "20000", "-o", folder / "scene.gltf")
        run(raymill, "build", folder / "scene.gltf", "-o", store)

        run(cmake, "-S", example, "-B", folder / "example", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}",
            f"-DCMAKE_CXX_COMPILER={compiler}", "-DCMAKE_BUILD_TYPE=Release")
        run(cmake, "--build", folder / "example")
        printed = run(folder / "example/example", store)
        print(printed)
        t, primitive, geometry = printed.split()
        t, primitive, geometry = float(t), int(primitive), int(geometry)

        bounds = json.loads(run(raymill, "info", store, "--json"))["bounds"]
        low, high = bounds["min"], bounds["max"]
        org = [(low[0] + high[0]) / 2, high[1] + 1, (low[2] + high[2]) / 2]
        write_ray(folder / "ray.npy", [*map(as_float32, org), 0, 0, -1, 0, math.inf])
        run(raymill, "trace", store, folder / "ray.npy", "-o", folder / "hit.npy", "--fields",
            "t,primitive_id,geometry_id")
        program_hit = read_hit(folder / "hit.npy")
        print("program:", program_hit)
        assert 1 - 1e-3 <= t <= (high[1] - low[1] + 1) * 1.001, (t, bounds)
        assert (as_float32(t), primitive, geometry) == program_hit, program_hit

        run(raymill, "render", store, "-o", folder / "picture.png")
        assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG"), "no picture"


if __name__ == "__main__":
    main()
