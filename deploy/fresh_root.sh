#!/usr/bin/env bash
# Proves the two commands on a machine that has nothing: deploy/fresh_root.sh [--keep] [--scenes DIR] [COMMAND...]
# Makes a clean Debian 12 root for each COMMAND (default: deploy/quickstart.sh and deploy/test.sh), clones this
# repository's HEAD into it, runs the command there by chroot without a terminal, and prints how long each took.
# Needs root, debootstrap and git. Mirror and proxy settings are taken from this machine's apt.
#   --keep        leave the roots standing
#   --scenes DIR  bind DIR read-only where the tests look for scenes; without it they run without scenes
# Roots are made below ${TMPDIR:-/tmp} and removed at the end; the logs stay in build/fresh_root/.
set -euo pipefail

repository=$(cd "$(dirname "$0")/.." && pwd)
keep=no
scenes=
while (($# > 0)); do
  case "$1" in
    --keep) keep=yes ;;
    --scenes)
      scenes=$(cd "$2" && pwd)
      shift
      ;;
    -*)
      sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
      exit 2
      ;;
    *) break ;;
  esac
  shift
done
commands=("$@")
if ((${#commands[@]} == 0)); then
  commands=(deploy/quickstart.sh deploy/test.sh)
fi

if ((EUID != 0)) || ! command -v debootstrap > /dev/null; then
  echo "fresh_root.sh: run as root, with the package debootstrap installed" >&2
  exit 1
fi

work=$(mktemp -d "${TMPDIR:-/tmp}/raymill-fresh.XXXXXX")
logs=$repository/build/fresh_root
mkdir -p "$logs"
# shellcheck disable=SC2317  # called by the trap
remove_roots() {
  if [[ $keep == yes ]]; then
    echo "the roots stand in $work"
  else
    rm -rf --one-file-system "$work"
  fi
}
trap remove_roots EXIT

# shellcheck disable=SC2016  # apt's own placeholders
mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Identifier: Packages' 'Release: bookworm' 'Component: main' |
  head -n 1)
echo "making a clean root"
debootstrap --variant=minbase bookworm "$work/clean" "$mirror" > "$logs/debootstrap.log" 2>&1
# The same sources as this machine, security updates included.
rm -f "$work/clean/etc/apt/sources.list"
cp -r /etc/apt/sources.list.d /etc/apt/apt.conf.d "$work/clean/etc/apt/"
cp /etc/resolv.conf "$work/clean/etc/resolv.conf"
git clone -q --no-hardlinks "$repository" "$work/clean/src/raymill"

# Runs "$2" in the root "$1"; its mounts end with it.
run_in_root() {
  # shellcheck disable=SC2016  # expanded by the inner shell
  unshare --mount --pid --fork --kill-child bash -c '
    set -euo pipefail
    root=$1 scenes=$2 command=$3
    mount -t proc proc "$root/proc"
    mount -t tmpfs tmpfs "$root/dev/shm"
    if [[ -n $scenes ]]; then
      mkdir -p "$root/src/shared/scenes"
      mount --bind "$scenes" "$root/src/shared/scenes"
      mount -o remount,ro,bind "$root/src/shared/scenes"
    fi
    exec chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp LANG=C.UTF-8 \
      bash -c "cd /src/raymill && $command" < /dev/null
  ' bash "$1" "$scenes" "$2"
}

failed=0
for index in "${!commands[@]}"; do
  command=${commands[index]}
  log=$logs/$index.log
  root=$work/root$index
  cp -a "$work/clean" "$root"
  echo "running: $command (log: ${log#"$repository/"})"
  start=$SECONDS
  result=0
  run_in_root "$root" "$command" > "$log" 2>&1 || result=$?
  tail -n 15 "$log"
  echo "== $command: exit code $result after $((SECONDS - start)) s"
  if ((result != 0)); then
    failed=1
  fi
  if [[ $keep == no ]]; then
    rm -rf --one-file-system "$root"
  fi
done
exit "$failed"
