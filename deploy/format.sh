#!/usr/bin/env bash
# Formats every C++ file of the repository by .clang-format: deploy/format.sh [--check]
#   --check  change nothing; print what differs and fail when something does
set -euo pipefail
cd "$(dirname "$0")/.."

action=(-i)
case "${1:-}" in
  "") ;;
  --check) action=(--dry-run --Werror) ;;
  *)
    sed -n '2,3s/^# //p' "$0" >&2
    exit 2
    ;;
esac
if ! command -v clang-format > /dev/null; then
  echo "format.sh: clang-format is missing; deploy/install_packages.sh --develop installs it" >&2
  exit 1
fi

# Files that are tracked, or new and not ignored.
mapfile -t files < <(git ls-files --cached --others --exclude-standard -- '*.h' '*.cc' | sort -u |
  while read -r file; do [[ ! -f $file ]] || echo "$file"; done)
if ((${#files[@]} == 0)); then
  exit 0
fi
printf '%s\0' "${files[@]}" | xargs -0 -n 16 -P "$(nproc)" clang-format "${action[@]}"
echo "clang-format: ${#files[@]} files"
