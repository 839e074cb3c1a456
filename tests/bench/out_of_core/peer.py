"""Embree (raymill-peer) in a memory cgroup of its own: built without a limit, then traced under one after the other."""

import json
import subprocess

import support


class Peer:
    """For a with statement. `built` is what the program says of the scene; cgroup may be None."""

    def __init__(self, program, scene, cgroup):
        command = [str(program), str(scene), "--commands"]
        if cgroup is not None:
            command = ["sh", "-c", 'echo $$ > "$0" && exec "$@"', str(cgroup.path / "cgroup.procs"), *command]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE, text=True)
        self.built = self._answer()

    def _answer(self):
        line = self.process.stdout.readline()
        if not line:
            _, stderr = self.process.communicate()
            raise support.Failure(f"raymill-peer ended with {self.process.returncode}: {stderr.strip()}")
        return json.loads(line)

    def trace(self, rays, threads, seconds):
        self.process.stdin.write(f"{threads} {seconds} {rays}\n")
        self.process.stdin.flush()
        return self._answer()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        try:
            self.process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()
