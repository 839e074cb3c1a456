"""The service and its libraries load neither OpenImageIO nor OpenVDB, which bring hundreds of shared objects.

    linkage_lint.py PROGRAM...
"""

import re
import subprocess
import sys

FORBIDDEN = re.compile(r"lib(OpenImageIO\w*|openvdb|opencv_\w+|gdal|X11)\.so")


def main():
    found = []
    for program in sys.argv[1:]:
        loaded = subprocess.run(["ldd", program], check=True, capture_output=True, text=True).stdout
        names = [line.split()[0] for line in loaded.splitlines() if line.strip()]
        found += [f"{program} loads {name}" for name in names if FORBIDDEN.search(name)]
        found += [f"{program}: {line.strip()}" for line in loaded.splitlines() if "not found" in line]
        print(f"{program}: {len(names)} shared objects")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
