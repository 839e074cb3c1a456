#!/usr/bin/env bash
# Installs the Debian 12 packages that Raymill needs: deploy/install_packages.sh [--develop] [--list]
# Uses apt-get, as root or through sudo, and only when a package is missing.
#   --develop  also what formatting, static checks and fuzzing need
#   --list     print the packages and stop
set -euo pipefail

packages=(
  # the tools of the build
  g++ cmake ninja-build pkg-config protobuf-compiler
  # scenes in: glTF, Draco and meshopt (PLY, OBJ and STL need none)
  libtinygltf-dev nlohmann-json3-dev libstb-dev libdraco-dev libmeshoptimizer-dev
  # volumes in
  libopenvdb-dev libboost-iostreams-dev
  # building and reading stores
  libembree-dev libtbb-dev libzstd-dev liblz4-dev libxxhash-dev liburing-dev
  # pictures out
  libopenimageio-dev
  # the server and its protocol
  libzmq3-dev cppzmq-dev libprotobuf-dev
  # the command line
  libcli11-dev
  # the tests and the quickstart's summary
  libgtest-dev libgmp-dev python3 python3-numpy
)
develop_packages=(clang clang-format clang-tidy libclang-rt-14-dev shellcheck)

list=no
for argument in "$@"; do
  case "$argument" in
    --develop) packages+=("${develop_packages[@]}") ;;
    --list) list=yes ;;
    *)
      sed -n '2,5s/^# //p' "$0" >&2
      exit 2
      ;;
  esac
done
if [[ $list == yes ]]; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

if ! command -v dpkg-query > /dev/null; then
  echo "install_packages.sh: this is for Debian 12; elsewhere install by hand what --list names" >&2
  exit 1
fi

# Names the packages that are not installed, one a line.
missing_packages() {
  local package
  for package in "${packages[@]}"; do
    if [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2> /dev/null) != installed ]]; then
      echo "$package"
    fi
  done
}

mapfile -t missing < <(missing_packages)
if ((${#missing[@]} == 0)); then
  exit 0
fi

as_root=()
if ((EUID != 0)); then
  if ! command -v sudo > /dev/null; then
    echo "install_packages.sh: run as root, or install sudo; missing: ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo)
fi
echo "installing: ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get -q update
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -y --no-install-recommends install "${missing[@]}"
