"""What the lints of the tree share: the call, and the proof that a violation would be noticed."""

import pathlib
import sys
import tempfile

from repository import repository_files


def self_test(violations, bad, good):
    """Whether each file of `bad` (name: text) is reported, and none of `good`."""
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, text in {**bad, **good}.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        missed = [name for name in bad if not list(violations(root, [name]))]
        wrong = [line for name in good for line in violations(root, [name])]
    for name in missed:
        print(f"not noticed: {name}: {bad[name][:80]!r}")
    for line in wrong:
        print(f"wrongly reported: {line}")
    return not missed and not wrong


def main(violations, bad, good, praise, checks=lambda name: True):
    """LINT REPOSITORY | --self-test; the exit status."""
    if sys.argv[1:] == ["--self-test"]:
        return 0 if self_test(violations, bad, good) else 1
    root = pathlib.Path(sys.argv[1]).resolve()
    files = [name for name in repository_files(root) if checks(name)]
    found = list(violations(root, files))
    print("\n".join(found) or f"{len(files)} files, {praise}")
    return 1 if found else 0
