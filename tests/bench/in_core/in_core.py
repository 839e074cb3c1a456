"""Rays per second with every page in memory, beside Embree on the same rays in the same process.

    in_core.py --raymill RAYMILL --bench BENCH --work DIR [--scenes house.glb,terrain:2M,city:10M] [--rays 500k]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it. Primary and bounce rays, the latter in order and
shuffled, ask for the closest hit, shadow and ao rays for any. Files in --work are named by what they hold and used
again. Prints one line of JSON for each kind (see main.cc), then the geometric mean of the kernels' ratios.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

KINDS = {"closest": ["primary", "bounce", "bounce-shuffled"], "any": ["shadow", "ao"]}


def make_scene(options, folder, name):
    if ":" not in name:
        return pathlib.Path(name)
    kind, triangles = name.split(":")
    scene = folder / f"{kind}-{triangles}.gltf"
    if not scene.exists():
        support.run(options.raymill, "generate", kind, "--triangles", triangles, "-o", scene)
    return scene


def make_rays(options, folder, store, kind):
    rays = folder / f"{store.stem}-{kind}-{options.rays}.npy"
    if not rays.exists():
        shuffle = ["--shuffle"] if kind.endswith("-shuffled") else []
        support.run(options.raymill, "rays", store, "--kind", kind.split("-")[0], "--count", options.rays, *shuffle,
                    "-o", rays)
    return rays


def measure(options, folder, name):
    """The lines of one scene, and whether its hits are Embree's."""
    scene = make_scene(options, folder, name)
    store = folder / f"{scene.stem}.mill"
    if not store.exists():
        support.run(options.raymill, "build", scene, "-o", store)
    lines, alike = [], True
    for query, kinds in KINDS.items():
        rays = [make_rays(options, folder, store, kind) for kind in kinds]
        done = subprocess.run([options.bench, scene, store, *rays, "--query", query, "--mode", options.mode, "--repeat",
                               str(options.repeat), "--engine"], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            sys.exit(f"{options.bench.name}: {done.stderr}")
        alike = alike and done.returncode == 0
        lines += [json.loads(line) for line in done.stdout.splitlines()]
    return lines, alike


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--raymill", required=True, type=support.program)
    parser.add_argument("--bench", required=True, type=support.program, help="raymill-in-core")
    parser.add_argument("--work", type=pathlib.Path, help="folder for scenes, stores and rays; left out: a temporary one")
    parser.add_argument("--scenes", default="terrain:2M,city:10M", help="separated by commas")
    parser.add_argument("--rays", default="500k", help="of each kind")
    parser.add_argument("--mode", default="watertight")
    parser.add_argument("--repeat", default=7, type=int)
    parser.add_argument("--short", action="store_true", help="small scenes and few rays: does it run, are the hits alike")
    options = parser.parse_args()
    if options.short:
        options.scenes, options.rays, options.repeat = "terrain:20k,city:20k", "20k", 1
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.work or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        ratios, all_alike = [], True
        for name in options.scenes.split(","):
            lines, alike = measure(options, folder, name)
            all_alike = all_alike and alike
            for line in lines:
                print(json.dumps(line), flush=True)
                ratios.append(line["kernel_ratio"]["median"])
    print(f"kernels against Embree, geometric mean: {math.exp(sum(map(math.log, ratios)) / len(ratios)):.2f}")
    if not all_alike:
        sys.exit("hits differ from Embree's or the engine's from the kernels'")


if __name__ == "__main__":
    main()
