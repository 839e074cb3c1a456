"""Masks where a scene has parts with origins of their own: the hits of the same scene about zero, bit for bit.

The scene's nodes stand at whole multiples of 2^-20, and so do the rays' origins; it is placed three times, thousands of
kilometres apart, at multiples of 2^20. So each part's origin is its place, float64 rays reach the part without a
rounding, and what is hit there is what is hit about zero, which the reference has sampled the textures for.
"""

import json

import numpy as np
from made_scene import make_scene

PLACES = np.array([(-(2.0**22), 3 * 2.0**20, -(2.0**21)), (0, 0, 0), (2.0**22, -(2.0**22), 2.0**20)])
RULES = ("--blend-as-mask", "0.4", "--cull-back-faces")
FIELDS = ("--fields", "t,uv,ids,normal")


def far_scene(path):
    """(the scene at each of the places, geometries of one)"""
    document = json.loads(path.read_text())
    nodes = document["nodes"]
    everywhere = [dict(node) for _ in PLACES for node in nodes]
    for i, place in enumerate(PLACES):
        children = list(range(i * len(nodes), (i + 1) * len(nodes)))
        everywhere.append({"translation": place.tolist(), "children": children})
    roots = list(range(len(everywhere) - len(PLACES), len(everywhere)))
    document |= {"nodes": everywhere, "scenes": [{"nodes": roots}]}
    far = path.with_name("far.gltf")
    far.write_text(json.dumps(document))
    return far, len(nodes)


def try_parts(trial):
    scene = make_scene(trial.folder, 4, 8 if trial.options.short else 24)
    rays, answers = trial.reference("parts", scene, trial.rays, step=2.0**-20, blend_cutoff=0.4, one_side=True)
    far, geometries = far_scene(scene)
    for instances in ("never", "always"):
        near, _, _ = trial.build(scene, "near.mill", "--instances", instances, *RULES)
        truth, stats = trial.trace(near, rays, *FIELDS)
        if instances == "never":
            wrong, ties = trial.compare(truth, answers)
            trial.check(f"parts, about zero: {wrong} wrong, {ties} ties", wrong == 0 and ties <= trial.rays // 1000)
        trial.check("parts: rays look texels up", stats["texels_read"] > 0)
        # What --instances places by matrices is in no part; --origins always gives its rays all digits too.
        for origins in ("auto", "always") if instances == "never" else ("always",):
            name = f"parts, --origins {origins} --instances {instances}"
            store, _, info = trial.build(far, "far.mill", "--origins", origins, "--instances", instances, *RULES)
            trial.check(f"{name}: {info['features']}", {"origins", "masks", "instances"} <= set(info["features"]))
            for number, place in enumerate(PLACES):
                there = moved(trial, rays, place)
                at_place(trial, f"{name}, part {number}", store, info, there, truth, number * geometries)
    lost, _, _ = trial.build(far, "lost.mill", "--origins", "never", "--instances", "never", *RULES)
    hits, _ = trial.trace(lost, moved(trial, rays, PLACES[0]), *FIELDS)
    trial.check("parts, --origins never: float32 has lost them, so parts matter",
                (hits["t"] != truth["t"]).sum() > trial.rays // 10)


def moved(trial, rays, place):
    """The rays at a place, in float64."""
    there = np.load(rays).astype(np.float64)
    there[:, :3] += place
    path = trial.folder / "there.npy"
    np.save(path, there)
    return path


def at_place(trial, name, store, info, rays, truth, first_geometry):
    hits, stats = trial.trace(store, rays, *FIELDS)
    mine = hits.copy()
    mine["geometry_id"][np.isfinite(hits["t"])] -= first_geometry
    other = int((mine["t"] != truth["t"]).sum())
    trial.check(f"{name}: {other} t are not those about zero",
                all(mine[field].tobytes() == truth[field].tobytes()
                    for field in ("t", "u", "v", "geometry_id", "primitive_id")))
    # Of a placed triangle they are made of length one once more.
    with np.errstate(invalid="ignore"):
        turned = np.nanmax(np.abs(mine["normal"] - truth["normal"]))
    trial.check(f"{name}: normals are off by {turned}", turned <= 2.0**-24)
    trial.check(f"{name}: texels are looked up", stats["texels_read"] > 0)
    few = trial.folder / "few.npy"
    np.save(few, np.load(rays)[:len(truth) // 8])
    for way, words in {"scalar, two threads": ["--isa", "scalar", "--threads", "2"],
                       "the least memory": ["--memory", info["least_memory_bytes"]]}.items():
        again, _ = trial.trace(store, rays, *FIELDS, *words)
        trial.check(f"{name}, {way}: the same bytes", again.tobytes() == hits.tobytes())
    again, _ = trial.trace(store, few, *FIELDS, "--adversarial")
    trial.check(f"{name}, suspended everywhere: the same bytes", again.tobytes() == hits[:len(again)].tobytes())
    any_hit, _ = trial.trace(store, rays, "--query", "any")
    trial.check(f"{name}: any hit says the same", ((any_hit["t"] == 0) == np.isfinite(hits["t"])).all())
