"""Each registered test has a label that is known and a time limit.

    registered_tests_lint.py CTEST BUILD_DIRECTORY
"""

import json
import subprocess
import sys

LABELS = {"unit", "lint", "corpus", "install", "property", "fuzz", "sim", "trial", "stress", "bench", "cli"}


def main():
    ctest, build = sys.argv[1:]
    listed = subprocess.run([ctest, "--test-dir", build, "--build-config", "together", "--show-only=json-v1"],
                            check=True, capture_output=True, text=True).stdout
    tests = json.loads(listed)["tests"]
    found = []
    for test in tests:
        properties = {entry["name"]: entry["value"] for entry in test.get("properties", [])}
        labels = properties.get("LABELS", [])
        if not labels or not {label.removesuffix("_together") for label in labels} <= LABELS:
            found.append(f"{test['name']}: labels {labels}; known: {' '.join(sorted(LABELS))}")
        if not 0 < float(properties.get("TIMEOUT", 0)) <= 600:
            found.append(f"{test['name']}: needs a TIMEOUT of at most 600 s")
    print("\n".join(found) or f"{len(tests)} tests, all with a label and a time limit")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
