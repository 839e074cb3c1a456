"""Runs a command and writes {"rc", "rss_bytes", "seconds", "user_seconds"} to REPORT.

    launch.py REPORT CGROUP|- [NAME=VALUE...] -- COMMAND...

A process of its own because the kernel's peak of a child begins with the memory of the process that forked it: this
one is small. CGROUP is a folder of the memory controller that the command is put into; NAME=VALUE sets its environment.
"""

import json
import os
import resource
import sys
import time


def main():
    report, cgroup, rest = sys.argv[1], sys.argv[2], sys.argv[3:]
    split = rest.index("--")
    settings, command = rest[:split], rest[split + 1:]
    begin = time.monotonic()
    child = os.fork()
    if child == 0:
        try:
            if cgroup != "-":
                with open(os.path.join(cgroup, "cgroup.procs"), "w", encoding="ascii") as file:
                    file.write(str(os.getpid()))
            os.environ.update(setting.split("=", 1) for setting in settings)
            os.execvp(command[0], command)
        except OSError as error:
            print(f"launch: {error}", file=sys.stderr)
        os._exit(127)
    _, status, usage = os.wait4(child, 0)
    rc = os.waitstatus_to_exitcode(status)
    told = {"rc": rc, "rss_bytes": usage.ru_maxrss * 1024, "seconds": time.monotonic() - begin,
            "user_seconds": usage.ru_utime,
            "own_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024}
    with open(report, "w", encoding="ascii") as file:
        json.dump(told, file)


main()
