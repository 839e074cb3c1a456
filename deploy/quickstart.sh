#!/usr/bin/env bash
# Raymill in one command on a fresh Debian 12: deploy/quickstart.sh [DIRECTORY]
# Installs packages, builds, makes a city of 8 million triangles and its store, then traces rays and draws a picture
# in half of the memory that the decoded store needs. Files go to DIRECTORY (default: quickstart/ in the repository).
# What is up to date is used again.
set -euo pipefail
cd "$(dirname "$0")/.."
repository=$PWD

if (($# > 1)) || [[ ${1:-} == -* ]]; then
  sed -n '2,5s/^# //p' "$0" >&2
  exit 2
fi
directory=${1:-$repository/quickstart}
triangles=8M
rays=4M
picture=1280x720

step() {
  printf '\n== %s\n' "$*"
}

step "packages"
deploy/install_packages.sh
if command -v ccache > /dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=ccache
fi

step "build"
cmake --preset release > /dev/null
cmake --build --preset release --target raymill raymill-image
raymill=$repository/build/release/bin/raymill

mkdir -p "$directory"
cd "$directory"

# Runs a command unless the file it makes is there already and not older than what it is made from.
# make_file FILE SOURCE COMMAND...
make_file() {
  local file=$1 source=$2
  shift 2
  if [[ -e $file && ! $source -nt $file ]]; then
    echo "$file is up to date"
  else
    "$@"
  fi
}
# Prints the value of a key path in a JSON file: json FILE KEY
json() {
  python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))[sys.argv[2]])' "$1" "$2"
}

step "scene: a city of $triangles triangles"
make_file city.gltf "$repository/deploy/quickstart.sh" "$raymill" generate city --triangles "$triangles" -o city.gltf

step "store"
make_file city.mill city.gltf "$raymill" build city.gltf -o city.mill --memory 1G
"$raymill" info city.mill --json > info.json
decoded=$(json info.json decoded_bytes)
least=$(json info.json least_memory_bytes)
budget=$((decoded / 2))
if ((budget < least)); then
  budget=$least
fi
budget_mib=$(((budget + (1 << 20) - 1) >> 20))

step "rays: $rays, scattered once off the surfaces and shuffled"
make_file rays.npy city.mill "$raymill" rays city.mill --kind bounce --count "$rays" --shuffle -o rays.npy

step "trace: the decoded store is $((decoded >> 20)) MiB, the whole process gets $budget_mib MiB"
"$raymill" trace city.mill rays.npy -o hits.npy --memory "${budget_mib}M" --stats trace.json

step "render: ambient occlusion, the same memory"
"$raymill" render city.mill -o city.png --view ao --size "$picture" --memory "${budget_mib}M"

step "done"
python3 - "$budget_mib" "$decoded" trace.json << 'END'
import json
import sys

budget_mib, decoded, stats = int(sys.argv[1]), int(sys.argv[2]), json.load(open(sys.argv[3]))
mib = 1 << 20
print(f"rays per second  {stats['rays_per_second']:,.0f}  ({stats['rays']:,} rays, {stats['hits']:,} hits)")
print(f"paged            {stats['bytes_read'] / mib:,.0f} MiB in {stats['pages_read']:,} reads of"
      f" {stats['distinct_pages']:,} pages")
print(f"peak memory      {stats['peak_rss_bytes'] / mib:,.0f} MiB of {budget_mib} MiB allowed;"
      f" the decoded store is {decoded / mib:,.0f} MiB")
if stats["peak_rss_bytes"] > budget_mib * mib:
    sys.exit("the budget did not hold: please report this")
END
echo "picture          $PWD/city.png"
echo "next             $raymill --help"
