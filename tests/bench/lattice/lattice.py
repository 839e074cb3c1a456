"""What a lattice costs in answers and gives in bytes, for 8 to 24 bits.

    lattice.py --raymill RAYMILL --leaks RAYMILL-LEAKS --work DIR [--scenes terrain:1M,city:1M,forest:1M] [--bits 8,12,16]

A scene is a file, or KIND:TRIANGLES as `raymill generate` makes it. Each is built with float32 positions and on each
lattice; `raymill accuracy` traces random segments on all of them. The table tells bytes a triangle, the largest and the
root mean square displacement of a corner, and in mode --mode, against mode exact on the float32 store: the parts of the
rays that are a wrong hit or miss and that hit a wrong primitive, and the largest error of t. Then cracks: closed meshes on
each lattice in small pages, so that many edges lie at their borders, and rays from inside, aimed at vertices and edges,
that hit nothing (tests/bench/leaks); none is allowed but where the lattice has taken a triangle's area, so that it is
dropped and edges are unpaired. Files in --work are named by what they hold and used again.
"""

import argparse
import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import support  # noqa: E402


class Lattice:
    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.lines, self.problems = [], []

    def store(self, scene, positions):
        """The store's path and the report of its build, which stands beside it."""
        path = self.folder / f"{scene.stem}-{positions.replace(':', '-')}.mill"
        report = path.with_suffix(".json")
        if not (path.exists() and report.exists()):
            done = support.run(self.options.raymill, "build", scene, "-o", path, "--positions", positions, "--json")
            report.write_text(done.stdout)
        return path, json.loads(report.read_text())

    def measure(self, scene, positions):
        built = [self.store(scene, kind) for kind in positions]
        told = support.run_json(self.options.raymill, "accuracy", *[path for path, _ in built], "--kind", "random",
                                "--count", self.options.rays, "--rounds", self.options.rounds, "--json")
        for kind, (path, report) in zip(positions, built):
            line, = [one for one in told["settings"] if one["store"] == str(path) and one["mode"] == self.options.mode]
            yield line | {"scene": scene.stem, "lattice": kind, "max_displacement": report["max_displacement"],
                          "rms_displacement": report["rms_displacement"]}

    def cracks(self, positions):
        """Misses of each mesh in watertight and exact."""
        for mesh in ("rough_sphere", "box_soup"):
            command = [str(self.options.leaks), "--mesh", mesh, "--rays", self.options.crack_rays, "--positions", positions,
                       "--page-bytes", "16384"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode not in (0, 1):
                raise support.Failure(f"{self.options.leaks.name}: {done.stderr}")
            cells, = [line.split() for line in done.stdout.splitlines() if line.startswith(mesh)]
            yield {"mesh": mesh, "lattice": positions, "unpaired_edges": int(cells[4]), "rays": int(cells[6]),
                   "watertight": int(cells[8]), "exact": int(cells[9])}

    def run(self):
        positions = ["float32"] + [f"lattice:{bits}b" for bits in self.options.bits.split(",")]
        table = support.Table(scene=14, positions=12, **{"B/tri": 7, "max moved": 10, "RMS": 10, "Mrays/s": 8, "hit/miss": 9,
                                                         "primitive": 9, "max t error": 11})
        for name in self.options.scenes.split(","):
            for line in self.measure(support.scene(self.options.raymill, self.folder, name), positions):
                self.lines.append(line)
                table.row(line["scene"][:14], line["lattice"], f"{line['store_bytes_per_triangle']:.2f}",
                          f"{line['max_displacement']:.3g}", f"{line['rms_displacement']:.3g}",
                          f"{line['mrays_per_second']['median']:.3f}",
                          f"{line['wrong_answer_rate']:.2g}", f"{line['wrong_primitive_rate']:.2g}",
                          f"{line['t_error_units']['max']:.3g}")
        table = support.Table(mesh=14, positions=12, rays=9, unpaired=8, watertight=10, exact=8)
        for kind in positions:
            for line in self.cracks(kind):
                self.lines.append(line)
                table.row(line["mesh"], kind, line["rays"], line["unpaired_edges"], line["watertight"], line["exact"])
                if line["unpaired_edges"] == 0 and line["watertight"] + line["exact"] > 0:
                    self.problems.append(f"{line['mesh']} on {kind} has cracks")


def parse():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--raymill", required=True, type=support.program)
    options.add_argument("--leaks", required=True, type=support.program, help="raymill-leaks")
    options.add_argument("--work", type=support.folder, help="folder for scenes and stores; default: one that is removed")
    options.add_argument("--scenes", default="terrain:1M,city:1M,forest:1M", help="separated by commas (%(default)s)")
    options.add_argument("--bits", default="8,10,12,14,16,18,20,22,24", help="separated by commas (%(default)s)")
    options.add_argument("--rays", default="500k", help="for each scene (%(default)s)")
    options.add_argument("--crack-rays", default="1M", help="for each lattice (%(default)s)")
    options.add_argument("--rounds", default=3, type=int, help="of the rates (%(default)s)")
    options.add_argument("--mode", default="watertight", help="whose figures are shown (%(default)s)")
    options.add_argument("--short", action="store_true", help="the form that ctest runs")
    options = options.parse_args()
    if options.short:
        options.scenes, options.bits, options.rays, options.crack_rays, options.rounds = "terrain:20k", "8,16", "10k", "10k", 1
    return options


if __name__ == "__main__":
    sys.exit(support.run_bench(Lattice, parse(), "lattice"))
