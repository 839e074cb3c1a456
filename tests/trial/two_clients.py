"""Two clients at once against one server; one is cancelled half way and the other's hits are unchanged.

    two_clients.py --raymill RAYMILL [--scene FILE] [--triangles N] [--rays N] [--memory MIB] [--short]

Each client has rays of its own. The hits of the one that stays must equal those of the embedded engine, byte for byte;
the cancelled one leaves no file; the server stays, runs nothing any more and keeps to its memory.
"""

import json
import pathlib
import re
import signal
import subprocess
import sys
import time

import support

PERCENT = re.compile(r"ALF_PROGRESS (\d+)%")
INTERRUPTED = 130


def start(options, server, store, rays, hits, *more):
    command = [options.raymill, "trace", store.name, rays, "-o", hits, "--server", server.address, *more]
    return subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def cancel_half_way(client):
    """Sends SIGINT once half of the rays are done; returns the last percentage told before."""
    percent = 0
    for line in client.stdout:
        if told := PERCENT.match(line):
            percent = int(told[1])
            if 50 <= percent < 100:
                client.send_signal(signal.SIGINT)
                break
    client.communicate(timeout=120)
    return percent


def trial(options, folder, problems):
    def expect(true, what):
        print(f"{'ok' if true else 'NOT SO'}: {what}", flush=True)
        if not true:
            problems.append(what)

    scene = options.scene
    if scene is None:
        scene = folder / "scene.gltf"
        support.run(options.raymill, "generate", "mixed", "--triangles", options.triangles, "-o", scene)
    store = folder / "scene.mill"
    support.run(options.raymill, "build", scene, "-o", store, "--memory", "8G")
    rays = [folder / "rays0.npy", folder / "rays1.npy"]
    for seed, path in enumerate(rays, 1):
        support.run(options.raymill, "rays", store, "--kind", "random", "--seed", seed, "--count", options.rays, "-o",
                    path)
    embedded = folder / "embedded.npy"
    support.run(options.raymill, "trace", store, rays[0], "-o", embedded)  # by other threads and another ISA: the same
    truth = support.sha256(embedded)
    embedded.unlink()

    serve = ["--memory", f"{options.memory}M", "--max-jobs", "2", *options.engine]
    with support.Server(options.raymill, folder, folder, *serve) as server:
        begin = time.monotonic()
        hits = [folder / "hits0.npy", folder / "hits1.npy"]
        goes = start(options, server, store, rays[1], hits[1], "--progress", "alf")
        stays = start(options, server, store, rays[0], hits[0], "--json")
        percent = cancel_half_way(goes)
        cancelled_at = time.monotonic() - begin
        together = stays.poll() is None
        stdout, stderr = stays.communicate(timeout=3600)
        seconds = time.monotonic() - begin

        expect(goes.returncode == INTERRUPTED and 50 <= percent < 100,
               f"one client was cancelled at {percent} % after {cancelled_at:.1f} s: exit {goes.returncode}")
        expect(together, "the other was still running then")
        expect(not list(folder.glob("hits1*")), "the cancelled one left no file")
        expect(stays.returncode == 0, f"the other ended with {stays.returncode} {stderr.strip()}")
        same = stays.returncode == 0 and support.sha256(hits[0]) == truth
        expect(same, f"its hits are those of the embedded engine: {truth[:10]}")
        if stays.returncode == 0:
            told = json.loads(stdout)
            print(f"{told['rays']} rays, {told['hits']} hits in {seconds:.1f} s")
        jobs = support.run_json(options.raymill, "jobs", "--server", server.address, "--json")
        jobs = jobs["jobs"] if isinstance(jobs, dict) else jobs
        busy = [job["state"] for job in jobs if job["state"] not in ("finished", "cancelled", "failed", "done")]
        expect(server.alive() and not busy, f"the server is there and runs nothing: {[job['state'] for job in jobs]}")
        third = start(options, server, store, rays[0], hits[1])
        third.communicate(timeout=3600)
        expect(third.returncode == 0 and support.sha256(hits[1]) == truth, "a third client gets the same")
        peak, limit = server.rss_bytes(), options.memory * support.MIB
        expect(peak <= limit, f"the server's VmHWM was {support.mib(peak)} MiB of {support.mib(limit)} MiB")
        rc = server.stop()
        expect(rc == 0, f"SIGTERM ends the server with {rc}")


def main():
    options = support.parser(__doc__)
    options.add_argument("--scene", type=pathlib.Path, help="a glTF file; left out: a generated one")
    options.add_argument("--triangles", default="2M")
    options.add_argument("--rays", default="10M")
    options.add_argument("--memory", type=int, default=512, help="of the server, MiB")
    options = options.parse_args()
    options.engine = []
    if options.short:
        # One slow thread: half way must last longer than the second between two reports of progress.
        options.triangles, options.rays, options.memory = "200k", "2500k", 64
        options.engine = ["--threads", "1", "--isa", "scalar"]
    problems = []
    with support.work_folder(options) as folder:
        trial(options, pathlib.Path(folder), problems)
    return support.ended(problems, "two clients")


if __name__ == "__main__":
    sys.exit(main())
