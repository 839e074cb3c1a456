#!/usr/bin/env bash
# Builds Raymill and runs all its tests: deploy/test.sh [--sanitize] [--tsan] [-R REGEX]
#   --sanitize  after that, the unit and corpus tests under AddressSanitizer and UndefinedBehaviorSanitizer
#   --tsan      the unit tests under ThreadSanitizer too
#   -R REGEX    only the tests whose name matches
# Scenes are looked for in $RAYMILL_SCENES, else in ../shared/scenes beside the repository; tests that need them are
# left out where they are missing, unless RAYMILL_REQUIRE_SCENES=1.
set -euo pipefail
cd "$(dirname "$0")/.."

suites=(release)
filter=()
while (($# > 0)); do
  case "$1" in
    --sanitize) suites+=(asan) ;;
    --tsan) suites+=(tsan) ;;
    -R)
      filter=(--tests-regex "${2:?-R needs a regular expression}")
      shift
      ;;
    *)
      sed -n '2,7s/^# \{0,1\}//p' "$0" >&2
      exit 2
      ;;
  esac
  shift
done

deploy/install_packages.sh
if command -v ccache > /dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=ccache
fi

export RAYMILL_SCENES=${RAYMILL_SCENES:-$PWD/../shared/scenes}
if [[ -f $RAYMILL_SCENES/MANIFEST.tsv ]]; then
  RAYMILL_SCENES=$(cd "$RAYMILL_SCENES" && pwd)
elif [[ ${RAYMILL_REQUIRE_SCENES:-0} == 1 ]]; then
  echo "test.sh: RAYMILL_REQUIRE_SCENES=1, but there are no scenes in $RAYMILL_SCENES" >&2
  exit 1
else
  echo "test.sh: no scenes in $RAYMILL_SCENES; the tests that need them are left out"
fi

# build SUITE: configured and built.
build() {
  cmake --preset "$1" > /dev/null && cmake --build --preset "$1"
}

log=$(mktemp)
next_log=$(mktemp)
next_build=
trap 'rm -f "$log" "$next_log"; [[ -z $next_build ]] || kill -- "-$next_build" 2> /dev/null || true' EXIT

# build_beside SUITE: begins to build it, in what the tests of the suite before it leave idle.
build_beside() {
  set -m
  (
    renice -n 10 "$BASHPID" > /dev/null
    build "$1"
  ) > "$next_log" 2>&1 < /dev/null &
  next_build=$!
  set +m
}

# wait_for_build: until the build that was begun is done; its output, and 1 where it failed.
wait_for_build() {
  local done=0
  wait "$next_build" || done=$?
  next_build=
  cat "$next_log"
  return "$done"
}

# together_counts SUITE: how many more tests ran, failed and were skipped there than ctest counts, for it counts tests
# that ran in one process as one; then the names of those that were skipped, which it does not list.
together_counts() {
  awk '/^[0-9]+\/[0-9]+ Testing: / {together = $3 ~ /\.[0-9]+_of_[0-9]+$/}
       together && /^\[==========\] [0-9]+ tests? from .* ran\./ {tests += $2 - 1}
       together && /^\[  FAILED  \] [0-9]+ tests?, listed below:$/ {failed += $4 - 1}
       together && /^\[  SKIPPED \] [0-9]+ tests?, listed below:$/ {skipped += $4}
       together && /^\[  SKIPPED \] [^ ]+$/ {names = names " " $4}
       END {print tests + 0, failed + 0, skipped + 0 names}' "build/$1/Testing/Temporary/LastTest.log"
}

declare -A labels=([release]='.*' [asan]='unit|corpus|fuzz' [tsan]='unit')
passed=0
failed=0
left_out=0
build "${suites[0]}"
for index in "${!suites[@]}"; do
  suite=${suites[index]}
  if ((index > 0)); then
    wait_for_build
  fi
  if ((index + 1 < ${#suites[@]})); then
    build_beside "${suites[index + 1]}"
  fi
  chosen=(--label-regex "${labels[$suite]}" "${filter[@]}")
  if [[ $suite == asan && ${#filter[@]} == 0 ]]; then
    # Many in one process: most start in more time than they run.
    chosen=(--build-config together --label-regex '(unit|corpus)_together|fuzz')
  fi
  ctest --preset "$suite" --parallel "$(nproc)" "${chosen[@]}" 2>&1 | tee "$log" || true
  # The closing lines: "98% tests passed, 2 tests failed out of 100" and "Total Test time"; "12 - name (Skipped)".
  if ! summary=$(grep -E '^[0-9]+% tests passed, [0-9]+ tests failed out of [0-9]+$' "$log"); then
    echo "test.sh: ctest did not come to its end for $suite" >&2
    exit 1
  fi
  read -r suite_failed suite_total < <(sed -E 's/^.*passed, ([0-9]+) tests failed out of ([0-9]+)$/\1 \2/' <<< "$summary")
  suite_skipped=$(grep -cE '^[[:space:]]+[0-9]+ - .* \((Skipped|Disabled)\)$' "$log" || true)
  read -r more_tests more_failed more_skipped names < <(together_counts "$suite")
  suite_total=$((suite_total + more_tests))
  suite_failed=$((suite_failed + more_failed))
  suite_skipped=$((suite_skipped + more_skipped))
  if [[ -n $names ]]; then
    echo "skipped: $names"
  fi
  passed=$((passed + suite_total - suite_failed - suite_skipped))
  failed=$((failed + suite_failed))
  left_out=$((left_out + suite_skipped))
done
if ((left_out > 0)); then
  echo "$left_out tests were left out; they are listed above as skipped"
fi
echo "$passed passed, $failed failed"
if ((failed > 0)); then
  exit 1
fi
