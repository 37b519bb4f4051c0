#!/usr/bin/env bash
# `make test`: every check, one after the other; prints how long each part took and stops at the first that fails.
# Plain cargo, one profile (release): unoptimised kernels are hopeless in tests, and two profiles compile everything twice.
set -euo pipefail
cd "$(dirname "$0")/.."

CARGO=${CARGO:-cargo}
export CARGO_TERM_COLOR=${CARGO_TERM_COLOR:-auto}
# Snapshots are compared, never rewritten, whatever the machine's own settings are.
export INSTA_UPDATE=no INSTA_FORCE_PASS=0

names=()
seconds=()
results=()
n_passed=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT

summary() {
    local i total=0
    printf '\n%-44s %9s  %s\n' PART SECONDS RESULT
    for i in "${!names[@]}"; do
        printf '%-44s %9.1f  %s\n' "${names[i]}" "${seconds[i]}" "${results[i]}"
        total=$(awk -v a="$total" -v b="${seconds[i]}" 'BEGIN { print a + b }')
    done
    printf '%-44s %9.1f\n' total "$total"
}

now() { date +%s.%N; }

# Of the output of tests that passed, only what they could not try here.
what_matters() {
    awk '/^successes:$/ { inside = 1 } /^(failures:|test result: .*)$/ { inside = 0 } !inside || /^not tested: /; { fflush() }'
}

part() { # name, command…
    local name=$1 start rc=0
    shift
    printf '\n=== %s: %s\n' "$name" "$*"
    start=$(now)
    "$@" 2>&1 | tee "$log" | what_matters || rc=$?
    n_passed=$((n_passed + $(sed -n 's/^test result: ok\. \([0-9]*\) passed.*/\1/p' "$log" | awk '{ n += $1 } END { print n + 0 }')))
    names+=("$name")
    seconds+=("$(awk -v a="$start" -v b="$(now)" 'BEGIN { printf "%.2f", b - a }')")
    if [ "$rc" != 0 ]; then
        results+=("FAILED ($rc)")
        summary
        printf '\n%s failed: %s\n' "$name" "$*" >&2
        exit 1
    fi
    # What a part could not try here is said in the summary, too.
    results+=("passed$(sed -n 's/^not tested: \(.*\)/; not tested: \1/p' "$log" | sort -u | tr -d '\n')")
}

skipped() { # name, why
    printf '\n=== %s: skipped, %s\n' "$1" "$2"
    names+=("$1")
    seconds+=(0)
    results+=("skipped: $2")
}

# Test targets outside the units: those that the `tests` crate declares, and the `tests/` folders of the other crates.
integration_targets() {
    awk '/^\[/ { inside = ($0 == "[[test]]") } inside && /^name *=/ { gsub(/"/, "", $3); print $3 }' tests/Cargo.toml
    local file
    for file in schemas/tests/*.rs solver/*/tests/*.rs worker/tests/*.rs coordinator/tests/*.rs dev/tests/*.rs; do
        [ -e "$file" ] && basename "$file" .rs
    done
    for file in schemas/tests/*/main.rs solver/*/tests/*/main.rs worker/tests/*/main.rs coordinator/tests/*/main.rs; do
        [ -e "$file" ] && basename "$(dirname "$file")"
    done
    true
}

part "set up what is missing" deploy/deps.sh test

if $CARGO fmt --version >/dev/null 2>&1; then
    part "format" "$CARGO" fmt --all --check
else
    skipped "format" "rustfmt is not installed"
fi

# The binaries come first: end-to-end and crash tests run them.
part "build the binaries" "$CARGO" build --release --locked --workspace --bins
part "build the tests" "$CARGO" test --release --locked --workspace --no-run

part "unit tests, JSON Schemas are current" "$CARGO" test --release --locked --workspace --lib --bins -q -- --show-output
part "documentation's examples" "$CARGO" test --release --locked --workspace --doc -q
target_part() { part "tests: $1" "$CARGO" test --release --locked --workspace --test "$1" -q -- --show-output; }

# The worker on MPI ranks, where an MPI is found; MPICH's: `make test-mpich`.
# The whole workspace is selected here too, so that no dependency is compiled twice.
with_mpi=()
if missing=$(deploy/mpi-found.sh); then
    with_mpi=(--features cardiotwin-dev/mpi)
    part "tests: mpi" "$CARGO" test --release --locked --workspace "${with_mpi[@]}" --test mpi --test mpi_beat -q -- --show-output
else
    skipped "tests: mpi" "$missing"
fi
# After it: tests of e2e and slurm run that worker on ranks.
for target in $(integration_targets | sort -u | grep -vxE "mpi|mpi_beat"); do
    target_part "$target"
done

if $CARGO clippy --version >/dev/null 2>&1; then
    part "clippy, warnings are errors" "$CARGO" clippy --release --locked --workspace "${with_mpi[@]}" --all-targets -- -D warnings
else
    skipped "clippy" "clippy is not installed"
fi
if command -v mdbook >/dev/null && command -v python3 >/dev/null; then
    part "the book, its links" docs/book/build.sh "${CARGO_TARGET_DIR:-target}/book"
else
    skipped "the book, its links" "mdbook or python3 is not installed (Debian 13 has both)"
fi
part "documentation, warnings are errors" env RUSTDOCFLAGS="-D warnings" "$CARGO" doc --release --locked --workspace --no-deps --document-private-items

summary
printf '\nall parts passed; tests:\n%d passed, 0 failed\n' "$n_passed"
