#!/usr/bin/env bash
# Static checks by .clang-tidy: deploy/tidy.sh [FILE.cc...]
# Without files: every source of the debug build. Needs deploy/install_packages.sh --develop.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v clang-tidy > /dev/null; then
  echo "tidy.sh: clang-tidy is missing; deploy/install_packages.sh --develop installs it" >&2
  exit 1
fi
cmake --preset debug > /dev/null
# Generated headers must be there before anything is parsed.
ninja -C build/debug -t targets all | sed -n 's/^\(.*\.pb\.h\): .*/\1/p' | xargs -r ninja -C build/debug > /dev/null

files=("$@")
if ((${#files[@]} == 0)); then
  mapfile -t files < <(sed -n "s|^ *\"file\": \"$PWD/\(.*\)\",\?\$|\1|p" build/debug/compile_commands.json |
    grep -E '^(storage|traversal|server|client)/' | sort -u)
fi
printf '%s\0' "${files[@]}" | xargs -0 -n 1 -P "$(nproc)" clang-tidy --quiet -p build/debug 2>&1 |
  sed -E "/^[0-9]+ warnings?( and [0-9]+ errors?)? generated/d"
echo "clang-tidy: ${#files[@]} files"
