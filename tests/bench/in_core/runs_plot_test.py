"""Runs are kept, read in the order of time and summed up; a file of something else is refused with its line."""

import contextlib
import io
import json
import pathlib
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "trial"))

import runs_plot  # noqa: E402
import support  # noqa: E402


def line(kind, **rates):
    return {"kind": kind, "tracers": {name: {"mrays_per_second": {"median": rate}} for name, rate in rates.items()}}


def refusal(path):
    """What reading it ends with."""
    with contextlib.redirect_stderr(io.StringIO()):
        try:
            runs_plot.read_runs(path)
        except SystemExit as refused:
            return str(refused)
    return ""


def main():
    problems = []

    def expect(true, what):
        if not true:
            problems.append(what)

    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "runs.jsonl"
        support.add_run(path, [line("bounce-shuffled", expanded=2, compact=1, embree1=1),
                               line("bounce-shuffled", expanded=1, compact=8, embree1=1),
                               line("primary", expanded=3)])
        early = line("bounce", expanded=1, embree1=4) | {"run": {"at": "2020-01-01T00:00:00Z", "commit": "abc"}}
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(early) + "\n")
        runs = runs_plot.read_runs(path)
        means = [runs_plot.means_of(lines) for lines in runs.values()]
        expect([len(lines) for lines in runs.values()] == [1, 3], f"runs stand by time: {list(runs)}")
        expect(means[0] == {"closest in order / embree1": 0.25}, f"the first run's means: {means[0]}")
        shuffled = means[-1].get("incoherent closest / embree1", 0)
        expect(len(means[-1]) == 1 and abs(shuffled - 4) < 1e-12, f"our best to the peer's, by geometric mean: {means[-1]}")
        path.write_text(path.read_text(encoding="utf-8") + '{"name": "another bench"}\n', encoding="utf-8")
        expect("runs.jsonl:5: " in refusal(path), f"another bench's line is named: {refusal(path)!r}")
    return support.ended(problems, "runs plot")


if __name__ == "__main__":
    sys.exit(main())
