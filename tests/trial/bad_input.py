"""Bad input: one sentence and the right exit code each time, nothing crashed, nothing half written.

    bad_input.py --raymill RAYMILL [--short]

Exit codes: 2 usage, 33 memory, 42 bad input or a damaged store, 75 temporary (raymill::exit_code). Cases that need root
(a full disk, a read-only mount) are left out without it and named.
"""

import json
import os
import pathlib
import signal
import struct
import subprocess
import sys

import numpy

import bad_meshes
import bad_scenes
import support
from mounts import Mount

USAGE, MEMORY, INPUT, TEMPORARY = 2, 33, 42, 75


class Trial:
    def __init__(self, options, folder):
        self.raymill = options.raymill
        self.folder = folder
        self.out = folder / "out"
        self.problems = []
        self.count = 0
        self.table = support.Table(case=46, rc=3, sentence=0)

    def check(self, name, rc, command, out=None, needs=""):
        """`command` must end with `rc` (or one of them) and one sentence, and leave `out` as it was."""
        out = out or self.out
        before = listing(out)
        allowed = rc if isinstance(rc, tuple) else (rc,)
        done = support.Run([self.raymill, *command], timeout=120)
        faults = []
        if done.rc not in allowed:
            faults.append(f"ended with {done.rc}, not {' or '.join(map(str, allowed))}")
        lines = done.stderr.splitlines()
        if done.rc != 0 and (len(lines) != 1 or not lines[0].startswith("raymill: ")):
            faults.append(f"{len(lines)} lines on stderr")
        if needs not in done.stderr:
            faults.append(f"does not say '{needs}'")
        if done.rc != 0 and listing(out) != before:
            faults.append(f"left {sorted(set(listing(out)) ^ set(before))}")
        self.note(name, done.rc, lines[0].removeprefix("raymill: ") if lines else "", faults)
        return done

    def note(self, name, rc, sentence, faults):
        self.count += 1
        self.table.row(name, rc, "  " + sentence.replace(str(self.folder) + "/", ""))
        self.problems += [f"{name}: {fault}" for fault in faults]


def listing(folder):
    """Names and sizes below a folder."""
    if not folder.is_dir():
        return []
    return sorted((str(path.relative_to(folder)), path.stat().st_size) for path in folder.rglob("*") if path.is_file())


def scenes(trial):
    for case in bad_scenes.CASES:
        path = case.write(trial.folder)
        trial.check(case.name, case.rc, ["build", path, "-o", trial.out / "x.mill"], needs=case.needs)
    for name, suffix, data, needs in bad_meshes.CASES:
        path = trial.folder / f"bad.{suffix}"
        path.write_bytes(data)
        trial.check(name, INPUT, ["build", path, "-o", trial.out / "x.mill"], needs=needs)
    path = trial.folder / "good.ply"
    path.write_bytes(bad_meshes.ply(vertices=8_000_000))
    trial.check("PLY of more vertices than memory", MEMORY, ["build", path, "-o", trial.out / "x.mill", "--memory", "96M"],
                needs="8000000 vertices must be held")
    path.unlink()
    trial.check("scene that is not there", INPUT, ["build", trial.folder / "none.gltf", "-o", trial.out / "x.mill"])
    trial.check("scene that is a folder", INPUT, ["build", trial.out, "-o", trial.out / "x.mill"])


def manifests(trial, scene):
    store, stats, listed = trial.out / "x.mill", trial.out / "x.json", trial.folder / "list.txt"
    command = ["build", "--manifest", listed, "-o", store, "--stats", stats]
    for name, text, needs in [
        ("manifest of nothing", "# nothing\n\n", "lists no scene"),
        ("manifest with a scene that is not there", f"{scene.name}\nnone.gltf\n", "line 2"),
        ("manifest with a folder", "out\n", "is a folder"),
        ("manifest that is no text", "\0" * 5000, "bytes"),
    ]:
        listed.write_text(text, encoding="utf-8")
        trial.check(name, INPUT, command, needs=needs)
    trial.check("manifest that is not there", INPUT, ["build", "--manifest", trial.folder / "none.txt", "-o", store])
    trial.check("manifest that is a folder", INPUT, ["build", "--manifest", trial.out, "-o", store])
    listed.write_text(f"# twice\n\n{scene.name}\n{scene}\n", encoding="utf-8")
    trial.check("stats into a folder that is not there", INPUT, [*command[:-1], trial.out / "none" / "x.json"])
    done = trial.check("manifest of a scene twice, after one: built", 0, [*command, scene, "--json"])
    told = json.loads(stats.read_text()) if done.rc == 0 else {}
    if told != json.loads(done.stdout or "{}"):
        trial.problems.append("build --stats: not what --json prints")
    if set(told.get("peak_bytes_by_tag", {})) != {"base", "build"}:
        trial.problems.append(f"build --stats: peak_bytes_by_tag is {told.get('peak_bytes_by_tag')}")
    geometries = support.run_json(trial.raymill, "info", store, "--json")["geometries"]
    if len(geometries) % 3 != 0 or geometries[0]["mesh"] != geometries[len(geometries) // 3]["mesh"]:
        trial.problems.append(f"manifest: {len(geometries)} geometries")
    store.unlink()
    stats.unlink()


def store_parts(store):
    """Name and byte range of each part (FORMAT of the store: header, pages, metadata, directory, footer)."""
    data = store.read_bytes()
    footer = len(data) - 184
    metadata, metadata_bytes = struct.unpack_from("<QQ", data, footer + 8)
    directory, = struct.unpack_from("<Q", data, footer + 40)
    first = struct.unpack_from("<QQII", data, directory)
    return {
        "header magic": (0, 8), "header version": (8, 4), "header features": (16, 8), "header page size": (24, 4),
        "header unused": (40, 16), "header checksum": (56, 8),
        "page header": (first[0], 16), "page body": (first[0] + first[2] // 2, 16),
        "last page": (metadata - 64, 32), "metadata": (metadata, metadata_bytes),
        "directory": (directory, 24), "footer": (footer, 160), "footer checksum": (footer + 168, 8),
        "footer magic": (footer + 176, 8),
    }


def stores(trial, store, rays):
    whole = store.read_bytes()
    damaged = trial.folder / "damaged.mill"
    hits = trial.out / "h.npy"

    def damage(name, data, rc=INPUT, needs=""):
        damaged.write_bytes(data)
        # Whatever is not read by a trace is found by verify.
        trial.check(f"verify: {name}", rc, ["verify", damaged], needs=needs)
        trace = trial.check(f"trace: {name}", (0, rc), ["trace", damaged, rays, "-o", hits])
        if trace.rc == 0:
            hits.unlink()
        return trace.rc

    for part, (offset, size) in store_parts(store).items():
        data = bytearray(whole)
        data[offset + size // 2] ^= 1 << 3
        rc = damage(f"bit flipped in the {part}", bytes(data))
        if rc == 0 and part not in ("metadata",):
            trial.problems.append(f"trace: bit flipped in the {part}: not noticed")
    data = bytearray(whole)
    struct.pack_into("<I", data, 8, 99)
    damage("store of another version", bytes(data), needs="version")
    damage("store cut short", whole[:-100])
    damage("store cut in half", whole[:len(whole) // 2])
    damage("empty file as a store", b"")
    damage("text as a store", b"not a store\n" * 100)
    trial.check("store that is not there", INPUT, ["trace", trial.folder / "none.mill", rays, "-o", hits])
    damaged.unlink()


def rays_files(trial, store, rays):
    bad = trial.folder / "bad.npy"
    good = numpy.load(rays)
    trace = ["trace", store, bad, "-o", trial.out / "h.npy"]
    for name, array in {
        "rays of shape (N, 7)": numpy.zeros((10, 7), "<f4"),
        "rays of shape (N,)": numpy.zeros(10, "<f4"),
        "rays of shape (N, 8, 1)": numpy.zeros((10, 8, 1), "<f4"),
        "rays of integers": numpy.zeros((10, 8), "<i4"),
        "rays of float16": numpy.zeros((10, 8), "<f2"),
        "rays in big-endian": numpy.zeros((10, 8), ">f4"),
        "rays of Python objects": numpy.array([[None] * 8], dtype=object),
        "rays in Fortran order": numpy.asfortranarray(good),
    }.items():
        numpy.save(bad, array)
        trial.check(name, INPUT, trace)
    numpy.save(bad, good)
    data = bad.read_bytes()
    for name, changed in {"rays file cut short": data[:-5], "rays file too long": data + b"x", "empty rays file": b"",
                          "text as rays": b"1 2 3\n" * 50, "rays header cut": data[:40]}.items():
        bad.write_bytes(changed)
        trial.check(name, INPUT, trace)
    missing = trial.folder / "none.npy"
    trial.check("rays that are not there", INPUT, ["trace", store, missing, "-o", trial.out / "h.npy"])
    strange = good.copy()[:6]
    strange[0, 0], strange[1, 4], strange[2, 4:7] = numpy.nan, numpy.inf, 0
    strange[3, 3], strange[4, 7] = numpy.nan, -1
    numpy.save(bad, strange)
    done = trial.check("rays with NaN, inf, zero dir: answered", 0, [*trace, "--json"])
    t = numpy.load(trial.out / "h.npy")["t"]
    if json.loads(done.stdout)["invalid"] != 5 or not numpy.isnan(t[:5]).all() or numpy.isnan(t[5]):
        trial.problems.append(f"rays with NaN: t is {t}")
    numpy.save(bad, strange.astype("<f8"))
    done = trial.check("the same in float64: answered", 0, [*trace, "--json"])
    if json.loads(done.stdout)["invalid"] != 5:
        trial.problems.append("rays of float64 with NaN: not 5 of them are invalid")
    numpy.save(bad, numpy.full((6, 8), 1e300))
    trial.check("float64 rays beyond float32: answered", 0, trace)
    (trial.out / "h.npy").unlink()
    numpy.save(bad, good[:0])
    trial.check("no rays at all: answered", 0, trace)
    (trial.out / "h.npy").unlink()


def words(trial, store, rays):
    hits = trial.out / "h.npy"
    for name, rc, command in [
        ("no verb", USAGE, []),
        ("unknown verb", USAGE, ["trase"]),
        ("unknown option", USAGE, ["trace", store, rays, "-o", hits, "--fast"]),
        ("build of no scene", USAGE, ["build", "-o", trial.out / "x.mill"]),
        ("no output", USAGE, ["trace", store, rays]),
        ("bad mode", USAGE, ["trace", store, rays, "-o", hits, "--mode", "sloppy"]),
        ("bad ISA", USAGE, ["trace", store, rays, "-o", hits, "--isa", "mmx"]),
        ("bad size", USAGE, ["trace", store, rays, "-o", hits, "--memory", "much"]),
        ("bad codec", USAGE, ["build", store, "-o", trial.out / "x.mill", "--codec", "zip"]),
        ("draco without a lattice", USAGE, ["build", store, "-o", trial.out / "x.mill", "--codec", "draco"]),
        ("--memory too small to trace", MEMORY, ["trace", store, rays, "-o", hits, "--memory", "1M"]),
        ("--memory too small to serve", MEMORY, ["serve", "--stores", trial.out, "--memory", "1M", "--bind",
                                                 f"ipc://{trial.folder}/small.sock"]),
        ("server not there", TEMPORARY, ["trace", store.name, rays, "-o", hits, "--server",
                                         f"ipc://{trial.folder}/none.sock"]),
        ("server address that is none", USAGE, ["trace", store.name, rays, "-o", hits, "--server", "nowhere"]),
        ("stores folder not there", INPUT, ["serve", "--stores", trial.folder / "none", "--bind",
                                            f"ipc://{trial.folder}/no.sock"]),
        ("server beyond loopback without keys", (USAGE, INPUT), ["serve", "--stores", trial.out, "--bind",
                                                                 "tcp://0.0.0.0:0"]),
    ]:
        trial.check(name, rc, command)


def outputs(trial, scene, store, rays):
    commands = {"build": (["build", scene], "x.mill"), "trace": (["trace", store, rays], "h.npy"),
                "rays": (["rays", store, "--kind", "random", "--count", "1M"], "r.npy"),
                "generate": (["generate", "city", "--triangles", "300k"], "s.gltf")}
    for verb, (command, name) in commands.items():
        trial.check(f"{verb}: output folder not there", INPUT, [*command, "-o", trial.out / "none" / name])
        trial.check(f"{verb}: output is a folder", USAGE, [*command, "-o", trial.out])
    small = support.MIB
    for kind, needs in (("full", "No space"), ("read-only", "Read-only")):
        mount, refusal = Mount.create(trial.folder / "mount", small, kind == "read-only")
        if mount is None:
            print(f"left out: a {kind} disk ({refusal})")
            continue
        with mount:
            for verb, (command, name) in commands.items():
                if kind == "full" and verb in ("trace",):
                    many = trial.folder / "many.npy"
                    support.run(trial.raymill, "rays", store, "--kind", "random", "--count", "200k", "-o", many)
                    command = ["trace", store, many]
                if kind == "full" and verb == "build":
                    (mount.path / "filler").write_bytes(b"x" * (small - (32 << 10)))
                trial.check(f"{verb}: {kind} disk", TEMPORARY, [*command, "-o", mount.path / name], out=mount.path,
                            needs=needs)
                if kind == "full":
                    (mount.path / "filler").unlink(missing_ok=True)


def client_gone(trial, store, rays):
    """kill -9 of clients in the middle of a job: the server stays, forgets them and answers the next."""
    faults = []
    many = trial.folder / "many.npy"
    support.run(trial.raymill, "rays", store, "--kind", "random", "--count", "3M", "-o", many)
    with support.Server(trial.raymill, store.parent, trial.folder, "--memory", "64M", "--threads", "1", "--isa",
                        "scalar", "--max-jobs", "2") as server:
        def jobs():
            told = support.run_json(trial.raymill, "jobs", "--server", server.address, "--json")
            return told["jobs"] if isinstance(told, dict) else told

        commands = {"traces": ["trace", store.name, many, "-o", trial.out / "h.npy"],
                    "submits": ["submit", store.name, many]}
        for verb, command in commands.items():
            client = subprocess.Popen([str(word) for word in [trial.raymill, *command, "--server", server.address]],
                                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            if not support.wait_until(lambda: any(job["state"] == "running" for job in jobs()), 20):
                faults.append(f"a client that {verb}: its job never ran")
            client.send_signal(signal.SIGKILL)
            client.wait()
            if not support.wait_until(lambda: all(job["state"] != "running" for job in jobs()), 60, 0.5):
                faults.append(f"a client that {verb}: the server still runs the job of a killed client: {jobs()}")
        left = [name for name, _ in listing(trial.out)]  # the killed client could not remove its own temporary
        for name in left:
            (trial.out / name).unlink()
        if any(not name.endswith(".tmp") for name in left):
            faults.append(f"left {left}")
        after = support.Run([trial.raymill, "trace", store.name, rays, "-o", trial.out / "h.npy", "--server",
                             server.address], timeout=60)
        local = support.Run([trial.raymill, "trace", store, rays, "-o", trial.folder / "local.npy"])
        if after.rc != 0 or local.rc != 0:
            faults.append(f"the next client ended with {after.rc}: {after.stderr.strip()}")
        elif support.sha256(trial.out / "h.npy") != support.sha256(trial.folder / "local.npy"):
            faults.append("the next client got other hits")
        if not server.alive() or server.rss_bytes() > 64 * support.MIB:
            faults.append(f"the server: alive {server.alive()}, VmHWM {support.mib(server.rss_bytes())} MiB of 64")
        sentence = f"server VmHWM {support.mib(server.rss_bytes())} MiB of 64"
        rc = server.stop()
        if rc != 0:
            faults.append(f"SIGTERM ends the server with {rc}")
    (trial.out / "h.npy").unlink(missing_ok=True)
    trial.note("clients killed in the middle of a job", rc, sentence, faults)


def main():
    options = support.parser(__doc__).parse_args()
    with support.work_folder(options) as folder:
        folder = pathlib.Path(folder)
        trial = Trial(options, folder)
        trial.out.mkdir()
        scene, store, rays = folder / "good.gltf", folder / "good.mill", folder / "rays.npy"
        support.run(options.raymill, "generate", "city", "--triangles", "20k", "-o", scene)
        support.run(options.raymill, "build", scene, "-o", store)
        support.run(options.raymill, "rays", store, "--kind", "random", "--count", "1000", "-o", rays)
        scenes(trial)
        manifests(trial, scene)
        stores(trial, store, rays)
        rays_files(trial, store, rays)
        words(trial, store, rays)
        outputs(trial, scene, store, rays)
        client_gone(trial, store, rays)
        left = listing(trial.out)
        if left:
            trial.problems.append(f"files left behind: {left}")
    return support.ended(trial.problems, f"bad input, {trial.count} cases")


if __name__ == "__main__":
    sys.exit(main())
