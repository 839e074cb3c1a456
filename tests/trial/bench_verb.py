"""`raymill bench` as a user runs it: the same hits under any memory, Embree's beside them, and the words it refuses.

    bench_verb.py --raymill RAYMILL [--work DIR] [--short]
"""

import json
import pathlib
import sys

import support

KINDS = ["primary", "bounce", "shadow", "ao", "random"]
MOST_DIFFERENT = 1e-3  # of the rays, from Embree's


def bench(options, store, *words):
    done = support.run(options.raymill, "bench", store, "--json", "--progress", "none", *words)
    return [json.loads(line) for line in done.stdout.splitlines()]


def least_memory(options, store, words):
    """The least limit that is not refused."""
    limit = 20 * support.MIB
    while True:
        done = support.Run([options.raymill, "bench", store, "--memory", str(limit), *words])
        if done.rc != 33:
            done.need()
            return limit
        limit = max(support.more_memory(limit, done.stderr), limit + support.MIB)


def compare(options, store, rays):
    problems = []
    words = ["--count", rays, "--repeat", "2", "--threads", "2"]
    plenty = bench(options, store, *words, "--memory", "1G", "--embree")
    small = bench(options, store, *words, "--memory", str(least_memory(options, store, words)))
    for lines in (plenty, small):
        if [line["name"].split("/")[1] for line in lines] != KINDS:
            problems.append(f"lines are {[line['name'] for line in lines]}")
    for one, other in zip(plenty, small):
        name = one["name"]
        if one["hits"] != other["hits"]:
            problems.append(f"{name}: {one['hits']} hits with plenty of memory, {other['hits']} with little")
        if one["different_from_embree"] > MOST_DIFFERENT * one["rays"]:
            problems.append(f"{name}: {one['different_from_embree']} hits are not Embree's")
        if not one["embree_ratio"]["least"] > 0:
            problems.append(f"{name}: no ratio to Embree")
        if other["run"]["peak_rss_bytes"] > other["run"]["memory_bytes"]:
            problems.append(f"{name}: a peak of {support.mib(other['run']['peak_rss_bytes'])} MiB")
    if not any(line["pages_read"] for line in small[1:]):
        problems.append("with little memory no page was read twice")
    shuffled, = bench(options, store, *words, "--kinds", "bounce", "--shuffle")
    if shuffled["hits"] != plenty[1]["hits"]:
        problems.append("shuffled rays hit something else")
    return problems


def refuse(options, store):
    problems = []
    for words, rc in [(["--kinds", "primary,sideways"], 2), (["--count", "0"], 2), (["--repeat", "0"], 2),
                      (["--count", "1G", "--memory", "1G"], 33), (["--embree", "--server", "ipc:///tmp/none"], 2),
                      (["--camera", "nobody"], 2)]:
        done = support.Run([options.raymill, "bench", store, *words])
        if done.rc != rc or len(done.stderr.strip().splitlines()) != 1:
            problems.append(f"bench {' '.join(words)}: ended with {done.rc}, not {rc}: {done.stderr.strip()}")
    return problems


def main():
    options = support.parser(__doc__).parse_args()
    with support.work_folder(options) as folder:
        folder = pathlib.Path(folder)
        scene, store = folder / "s.gltf", folder / "s.mill"
        support.run(options.raymill, "generate", "mixed", "--triangles", "200k" if options.short else "5M", "-o", scene)
        support.run(options.raymill, "build", scene, "-o", store, "--page-size", "16K")
        problems = compare(options, store, "10k" if options.short else "500k") + refuse(options, store)
    return support.ended(problems, "bench")


if __name__ == "__main__":
    sys.exit(main())
