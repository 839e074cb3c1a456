"""What each mode, lattice and tolerance costs and is worth, with all of a scene in memory and with a part of it.

    accuracy_table.py --raymill RAYMILL --work DIR [--scenes house.glb,terrain:2M] [--positions lattice:16b]
                      [--memory-shares 100,10] [--length-shares 1e-3,1e-2] [--angles 0.01] [--rays 300k] [--plots]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it. Each is built with float32 positions and proxies, and
on each lattice, then `raymill accuracy` traces rays of one kind on all of its stores under each share of the decoded
store's memory (100: all of it, and what the process needs besides; less than the least that a store can be traced in is
raised to that). Tolerances are given as shares of the diagonal of the scene's box. Printed are the tables of
`raymill accuracy`, as Markdown; --plots writes its picture beside the stores. Files in --work are named by what they hold
and used again.
"""

import argparse
import json
import math
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402

COLUMNS = ["positions", "mode", "tolerance", "Mrays/s", "B/tri", "MiB read", "wrong hit/miss", "another surface",
           "by proxy", "t error median", "p99", "max", "ulp p99"]


def number(value):
    return "0" if value == 0 else f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def row(setting, judged):
    error = setting["t_error_units"]
    tolerance = setting["tolerance"] or (f"{setting['tolerance_angle']:g} t" if setting["tolerance_angle"] else "")
    tolerance = tolerance if isinstance(tolerance, str) else f"{tolerance:.3g}"
    return [setting["positions"], setting["mode"], tolerance, f"{setting['mrays_per_second']['median']:.3f}",
            f"{setting['store_bytes_per_triangle']:.2f}", f"{setting['bytes_read'] / support.MIB:.1f}",
            number((setting["wrong_misses"] + setting["wrong_hits"]) / judged), number(setting["wrong_surfaces"] / judged),
            number(setting["proxy_hits"] / judged), number(error["median"]), number(error["p99"]), number(error["max"]),
            number(setting["t_error_ulps"]["p99"])]


class Tables:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def store(self, scene, positions, *words):
        path = self.folder / f"{scene.stem}-{positions.replace(':', '-')}{''.join(words)}.mill"
        if not path.exists():
            support.run(self.options.raymill, "build", scene, "-o", path, "--positions", positions, "--instances", "never",
                        "--memory", self.options.build_memory, *words)
        return path

    def measure(self, scene, stores, share, tolerances):
        info = support.run_json(self.options.raymill, "info", stores[0], "--json")
        wanted = info["decoded_bytes"] * share // 100 + (info["least_memory_bytes"] if share >= 100 else 0)
        least = max(support.run_json(self.options.raymill, "info", store, "--json")["least_memory_bytes"]
                    for store in stores)
        memory = max(wanted, least + (8 << 20))
        plot = self.folder / f"{scene.stem}-{share}.png"
        words = ["--tolerances", ",".join(f"{t:.6g}" for t in tolerances)]
        words += ["--tolerance-angles", self.options.angles] if self.options.angles else []
        words += ["--plot", plot] if self.options.plots else []
        told = support.run_json(self.options.raymill, "accuracy", *stores, *words, "--kind", self.options.kind, "--count",
                                self.options.rays, "--rounds", self.options.rounds, "--memory", memory, "--tolerance",
                                f"{tolerances[-1]:.6g}", "--wrong-share", self.options.wrong_share, "--json")
        judged = told["rays"]["count"] - told["rays"]["invalid"]
        print(f"\n### {scene.stem}, {info['triangles']:,} triangles, {share} %: --memory {support.mib(memory)} of "
              f"{support.mib(info['decoded_bytes'])} decoded, {judged:,} {self.options.kind} rays\n")
        print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS))
        for setting in told["settings"]:
            print("| " + " | ".join(row(setting, judged)) + " |")
            self.lines.append(setting | {"scene": scene.stem, "share": share, "memory_bytes": memory})
            bound = setting["tolerance"]
            if bound and setting["t_error_units"]["max"] > bound:
                self.problems.append(f"{scene.stem}: an error of {setting['t_error_units']['max']} within {bound}")
        best = told["fastest_within"]
        words = "none" if best is None else f"--mode {best['mode']}" + (
            f" --tolerance {best['tolerance']:g}" if best["tolerance"] else "") + f" on {pathlib.Path(best['store']).name}"
        print(f"\nFastest within {tolerances[-1]:.3g} with at most {self.options.wrong_share} of the rays wrong: {words}.",
              flush=True)

    def run(self):
        for name in self.options.scenes.split(","):
            scene = support.scene(self.options.raymill, self.folder, name)
            stores = [self.store(scene, "float32", "--proxies")]
            stores += [self.store(scene, kind) for kind in filter(None, self.options.positions.split(","))]
            bounds = support.run_json(self.options.raymill, "info", stores[0], "--json")["bounds"]
            diagonal = math.dist(bounds["min"], bounds["max"])
            tolerances = [float(share) * diagonal for share in self.options.length_shares.split(",")]
            for share in self.options.memory_shares.split(","):
                self.measure(scene, stores, int(share), tolerances)


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program)
    options.add_argument("--work", type=support.folder, help="folder for scenes and stores; default: one that is removed")
    options.add_argument("--scenes", default="terrain:2M", help="separated by commas (%(default)s)")
    options.add_argument("--positions", default="lattice:16b", help="besides float32, separated by commas (%(default)s)")
    options.add_argument("--memory-shares", default="100,10", help="per cent of the decoded store (%(default)s)")
    options.add_argument("--length-shares", default="1e-3,1e-2", help="tolerances, of the scene's diagonal (%(default)s)")
    options.add_argument("--angles", default="0.01", help="tolerances of cones; empty: none (%(default)s)")
    options.add_argument("--kind", default="primary", help="of the rays (%(default)s)")
    options.add_argument("--rays", default="300k", help="for each scene (%(default)s)")
    options.add_argument("--rounds", default=1, type=int, help="of the rates (%(default)s)")
    options.add_argument("--wrong-share", default="0.01", help="of the rays, for the setting that is named (%(default)s)")
    options.add_argument("--build-memory", default="4G", help="for builds (%(default)s)")
    options.add_argument("--plots", action="store_true", help="write SCENE-SHARE.png into --work")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.scenes, options.rays, options.memory_shares = "terrain:60k", "5k", "100"
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(Tables, parse(), "accuracy"))
