"""Ratios to Embree over the runs that in_core.py --runs has kept.

    runs_plot.py RUNS.jsonl [-o PLOT.png]

Prints a row a run: its time, its commit, and the geometric means that in_core.py prints at its end, as far as the run has
the rays and the peers. With -o they are drawn too, a line for each mean; that needs matplotlib (Debian: python3-matplotlib).
"""

import argparse
import json
import pathlib
import sys

import in_core


def read_runs(path):
    """Lists of lines by (time, commit), in the order of time."""
    runs = {}
    for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            line = json.loads(text)
            runs.setdefault((line["run"]["at"], line["run"]["commit"]), []).append(line)
        except (ValueError, KeyError, TypeError):
            sys.exit(f"{path}:{number}: no line that in_core.py --runs has written")
    return dict(sorted(runs.items()))


def means_of(lines):
    """By the name of each of in_core.MEANS that the run has."""
    found = {name: in_core.ratios(lines, kinds, peers) for name, kinds, peers in in_core.MEANS}
    return {name: in_core.geometric_mean(numbers) for name, numbers in found.items() if numbers}


def draw(means, path):
    import matplotlib  # pylint: disable=import-outside-toplevel
    matplotlib.use("Agg")
    from matplotlib import pyplot  # pylint: disable=import-outside-toplevel
    figure, axes = pyplot.subplots(figsize=(10, 6))
    for name, _, _ in in_core.MEANS:
        points = [(i, its[name]) for i, its in enumerate(means.values()) if name in its]
        if points:
            axes.plot(*zip(*points), marker="o", label=name)
    axes.axhline(1, color="grey", linewidth=0.5)
    axes.set_xticks(range(len(means)), [f"{at[:10]}\n{commit}" for at, commit in means], fontsize=7)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("our best / the peer's")
    axes.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("runs", type=pathlib.Path, help="what in_core.py --runs has written")
    options.add_argument("-o", "--output", type=pathlib.Path, help="the picture, in a format that matplotlib knows")
    options = options.parse_args()
    means = {run: means_of(lines) for run, lines in read_runs(options.runs).items()}
    if not any(means.values()):
        sys.exit(f"{options.runs}: no run has rays beside Embree")
    for (at, commit), its in means.items():
        print(f"{at}  {commit:10}  " + "  ".join(f"{name} {mean:.2f}" for name, mean in its.items()))
    if options.output:
        draw(means, options.output)


if __name__ == "__main__":
    main()
