"""`raymill accuracy` as a user runs it: its figures against those of hit files, its memory, its plot, what it refuses.

    accuracy_verb.py --raymill RAYMILL [--work DIR] [--short]
"""

import json
import pathlib
import sys

import numpy

import support

MODES = ["fast", "watertight", "exact"]


def accuracy(options, *words):
    return json.loads(support.run(options.raymill, "accuracy", "--json", "--progress", "none", *words).stdout)


def counted(truth, hits, rays):
    """The figures of a setting, from hit files."""
    should, does = numpy.isfinite(truth["t"]), numpy.isfinite(hits["t"])
    both = should & does
    other = (truth["primitive_id"] != hits["primitive_id"]) | (truth["geometry_id"] != hits["geometry_id"])
    length = numpy.sqrt((rays[:, 4:7].astype(float) ** 2).sum(axis=1)).astype("f4")
    error = numpy.abs(hits["t"][both].astype(float) - truth["t"][both]) * length[both]
    return {"wrong_misses": int((should & ~does).sum()), "wrong_hits": int((~should & does).sum()),
            "wrong_primitives": int((both & other & (truth["t"] != hits["t"])).sum()),
            "most": float(error.max()), "median": float(numpy.median(error))}


def compare(options, folder, stores):
    """Its figures are those that hit files of the same rays give."""
    rays = folder / "rays.npy"
    support.run(options.raymill, "rays", stores[0], "--kind", "bounce", "--count", options.rays, "-o", rays)
    told = accuracy(options, *stores, "--rays", rays, "--rounds", 1)
    made = accuracy(options, *stores, "--kind", "bounce", "--count", options.rays, "--rounds", 2)
    problems = []
    truth = None
    loaded = numpy.load(rays)
    if [line["mode"] for line in told["settings"]] != MODES * len(stores):
        problems.append(f"lines are {[line['mode'] for line in told['settings']]}")
    for store in stores:
        for mode in reversed(MODES):
            hits = folder / "hits.npy"
            support.run(options.raymill, "trace", store, rays, "-o", hits, "--mode", mode)
            hits = numpy.load(hits)
            truth = hits if truth is None else truth
            expected = counted(truth, hits, loaded)
            line, = [one for one in told["settings"] if one["mode"] == mode and one["store"] == str(store)]
            found = {name: line[name] for name in ("wrong_misses", "wrong_hits", "wrong_primitives")}
            found |= {"most": line["t_error_units"]["max"], "median": line["t_error_units"]["median"]}
            same = all(abs(found[name] - expected[name]) <= 0.01 * expected[name] for name in expected)
            if not same:
                problems.append(f"{store.name} {mode}: told {found}, the hit files say {expected}")
            again, = [one for one in made["settings"] if one["mode"] == mode and one["store"] == str(store)]
            if again["wrong_primitives"] != line["wrong_primitives"] or again["t_error_ulps"] != line["t_error_ulps"]:
                problems.append(f"{store.name} {mode}: rays that it makes itself are others than those of 'raymill rays'")
            if line["bytes_read"] == 0:
                problems.append(f"{store.name} {mode}: nothing was read")
    return problems


def choose(options, folder, stores):
    """What it takes within a tolerance; the second store's lattice is coarser than that."""
    problems = []
    told = accuracy(options, *stores, "--rays", folder / "rays.npy", "--rounds", 1, "--tolerance", "1e-2")
    best = told["fastest_within"]
    if best is None or best["store"] != str(stores[0]):
        problems.append(f"within 1e-2 it takes {best}")
    if accuracy(options, *stores[1:], "--count", 1000, "--tolerance", 0)["fastest_within"]["mode"] != "exact":
        problems.append("the oracle itself is not within 0")
    return problems


def on_a_server(options, folder, stores):
    """The same figures where a server traces."""
    words = ["--count", 5000, "--rounds", 1]
    here = accuracy(options, *stores, *words)
    with support.Server(options.raymill, folder, folder) as server:
        there = accuracy(options, *[store.name for store in stores], *words, "--server", server.address)
    return [f"{one['mode']}: other figures on a server" for one, other in zip(here["settings"], there["settings"])
            if answers(one) != answers(other)]


def answers(line):
    return {key: line[key] for key in line if "wrong" in key or "error" in key}


def closed(options, folder):
    """A closed mesh has rays from inside, and no leak where none is allowed."""
    scene, store, rays = folder / "box.obj", folder / "box.mill", folder / "inside.npy"
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2", "3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 6 8", "2 8 4"]
    scene.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces))
    support.run(options.raymill, "build", scene, "-o", store)
    random = numpy.random.default_rng(1)
    half = numpy.concatenate([random.uniform(0.1, 0.9, (1000, 3)), random.uniform(2, 3, (1000, 3))])
    directions = random.normal(size=(2000, 3))
    numpy.save(rays, numpy.concatenate([half, directions], axis=1).astype("f4"))
    problems = []
    for line in accuracy(options, store, "--rays", rays, "--closed")["settings"]:
        if not 990 <= line["rays_from_inside"] <= 1000:
            problems.append(f"{line['rays_from_inside']} of 1000 rays from inside are known to be")
        if line["leaks"] and line["mode"] != "fast":
            problems.append(f"{line['mode']} leaks {line['leaks']}")
    return problems


def in_little_memory(options, store):
    """The same figures and the promised memory."""
    words = [store, "--count", options.rays, "--rounds", 1, "--threads", 2]
    plenty = accuracy(options, *words)
    limit = 20 * support.MIB
    while True:
        done = support.Run([options.raymill, "accuracy", "--json", *words, "--memory", str(limit)])
        if done.rc != 33:
            break
        limit = max(support.more_memory(limit, done.stderr), limit + support.MIB)
    little = json.loads(done.need().stdout)
    problems = []
    if max(little["peak_rss_bytes"], done.rss_bytes) > limit:
        problems.append(f"a peak of {support.mib(little['peak_rss_bytes'])} MiB under {support.mib(limit)}")
    for one, other in zip(plenty["settings"], little["settings"]):
        if answers(one) != answers(other):
            problems.append(f"{one['mode']}: other figures with little memory")
    return problems


def within_tolerances(options, folder, scene):
    """A store with proxies is traced within each tolerance too, and told apart; the figures are those of hit files."""
    store, rays = folder / "proxies.mill", folder / "rays.npy"
    support.run(options.raymill, "build", scene, "-o", store, "--page-size", "16K", "--proxies")
    told = accuracy(options, store, "--rays", rays, "--rounds", 1, "--tolerances", "2,20", "--tolerance-angles", "0.05",
                    "--tolerance", 20, "--wrong-share", 1)
    lines = told["settings"]
    problems = [] if len(lines) == 3 + 2 * 3 else [f"{len(lines)} lines with tolerances"]
    if told["fastest_within"]["tolerance"] + told["fastest_within"]["tolerance_angle"] > 20.05:
        problems.append(f"with anything allowed it takes {told['fastest_within']}")
    hits = {}
    for name, words in {"truth": ["--mode", "exact"], "near": ["--tolerance", "20"]}.items():
        support.run(options.raymill, "trace", store, rays, "-o", folder / "hits.npy", *words)
        hits[name] = numpy.load(folder / "hits.npy")
    line, = [one for one in lines if one["tolerance"] == 20 and one["mode"] == "watertight"]
    should, does = numpy.isfinite(hits["truth"]["t"]), numpy.isfinite(hits["near"]["t"])
    by_proxy = hits["near"]["u"] == -1
    length = numpy.sqrt((numpy.load(rays)[:, 4:7].astype(float) ** 2).sum(axis=1)).astype("f4")
    both = should & does
    error = numpy.abs(hits["near"]["t"][both].astype(float) - hits["truth"]["t"][both]) * length[both]
    expected = {"wrong_misses": int((should & ~does).sum()), "wrong_hits": int((~should & does).sum()),
                "wrong_surfaces": int((error > 20).sum()), "proxy_hits": int(by_proxy.sum())}
    if not by_proxy.any() or any(line[name] != expected[name] for name in expected):
        problems.append(f"within 20 it tells {line}, the hit files say {expected}")
    if any(one["tolerance"] and one["t_error_units"]["max"] > one["tolerance"] for one in lines):
        problems.append("an error of t is larger than the tolerance")
    return problems


def instanced(options, folder):
    """Placed objects, and the same flattened: the figures are those of hit files as well, and next to nothing is wrong."""
    scene, stores = folder / "woods.gltf", [folder / "placed.mill", folder / "flat.mill"]
    support.run(options.raymill, "generate", "woods", "--triangles", "200k" if options.short else "5M", "--meshes", 3,
                "-o", scene)
    for store, rule in zip(stores, ("always", "never")):
        support.run(options.raymill, "build", scene, "-o", store, "--page-size", "16K", "--instances", rule)
    instances = support.run_json(options.raymill, "info", stores[0], "--json")["instances"]
    problems = [] if instances > 0 else ["woods have no instances"]
    problems += compare(options, folder, stores)
    told = accuracy(options, *stores, "--count", 10_000, "--rounds", 1)
    for line in told["settings"]:
        wrong = line["wrong_misses"] + line["wrong_hits"] + line["wrong_primitives"]
        if wrong > 10 or told["rays"]["oracle_hits"] < 1000:
            problems.append(f"{line['store']} {line['mode']}: {wrong} wrong of {told['rays']}")
    return problems


def plot(options, folder, stores):
    picture = folder / "plot.png"
    done = support.run(options.raymill, "accuracy", *stores, "--count", 1000, "--rounds", 1, "--plot", picture,
                       "--tolerance", 1)
    problems = [] if picture.read_bytes().startswith(b"\x89PNG") else ["the plot is no PNG"]
    if len(done.stdout.splitlines()) != 2 + 3 * len(stores) + 1 or "within 1:" not in done.stdout:
        problems.append(f"the table is {done.stdout}")
    return problems


def refuse(options, folder, stores, other):
    empty = folder / "empty.npy"
    numpy.save(empty, numpy.zeros((0, 6), "f4"))
    problems = []
    for words, rc in [([stores[0], "--count", "0"], 2), ([stores[0], "--kind", "sideways"], 2),
                      ([stores[0], "--rays", empty], 42), ([stores[0], "--rays", empty, "--count", "5"], 2),
                      ([stores[0], "--rays", folder / "none.npy"], 42), ([folder / "none.mill"], 42),
                      ([stores[0], other, "--count", "100"], 2), ([stores[0], "--tolerance", "-1"], 2),
                      ([stores[0], "--tolerances", "0"], 2), ([stores[0], "--count", "100", "--tolerances", "1"], 2),
                      ([stores[0], "--tolerance", "much"], 2), ([stores[0], "--plot", folder / "p.jpg"], 2),
                      ([stores[0], "--camera", "nobody"], 2), ([stores[0], "--memory", "1M"], 33),
                      ([stores[0], "--count", "1000", "--temp", folder / "nowhere"], 75), ([], 2)]:
        done = support.Run([options.raymill, "accuracy", *words])
        if done.rc != rc or len(done.stderr.strip().splitlines()) != 1:
            problems.append(f"accuracy {' '.join(map(str, words))}: ended with {done.rc}, not {rc}: {done.stderr.strip()}")
    return problems


def main():
    options = support.parser(__doc__).parse_args()
    options.rays = "20k" if options.short else "1M"
    with support.work_folder(options) as folder:
        folder = pathlib.Path(folder)
        scene, stores = folder / "s.gltf", [folder / "s.mill", folder / "s12.mill"]
        support.run(options.raymill, "generate", "mixed", "--triangles", "100k" if options.short else "5M", "-o", scene)
        support.run(options.raymill, "build", scene, "-o", stores[0], "--page-size", "16K")
        support.run(options.raymill, "build", scene, "-o", stores[1], "--page-size", "16K", "--positions", "lattice:12b")
        problems = compare(options, folder, stores) + choose(options, folder, stores)
        problems += closed(options, folder) + in_little_memory(options, stores[0])
        problems += instanced(options, folder)
        problems += within_tolerances(options, folder, scene)
        problems += on_a_server(options, folder, stores)
        problems += plot(options, folder, stores) + refuse(options, folder, stores, folder / "box.mill")
    return support.ended(problems, "accuracy")


if __name__ == "__main__":
    sys.exit(main())
