#!/usr/bin/env bash
# `make test`: every check, one after the other; prints how long each part took and stops at the first that fails.
# `make test-all` (CARDIOTWIN_TESTS=all) runs the long tests, too; `make test-long` (CARDIOTWIN_TESTS=long) these alone.
# CARDIOTWIN_TEST_SECONDS=N skips long tests that would not end within N seconds of the beginning; CI runs them
# with the time that is left.
# What a test could not try here is listed in target/not-tested.jsonl; with CI=true it fails unless .ci/allowed-skips lists it.
# Plain cargo, one profile (release): unoptimised kernels are hopeless in tests, and two profiles compile everything twice.
set -euo pipefail
cd "$(dirname "$0")/.."

CARGO=${CARGO:-cargo}
export CARGO_TERM_COLOR=${CARGO_TERM_COLOR:-auto}
# Snapshots are compared, never rewritten, whatever the machine's own settings are.
export INSTA_UPDATE=no INSTA_FORCE_PASS=0

names=()
seconds=()
processor_seconds=() # of all cores; less than twice the time on two cores: the part waits
results=()
n_passed=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT
began=$(date +%s)

target=${CARGO_TARGET_DIR:-target}
mkdir -p "$target"
export CARDIOTWIN_NOT_TESTED=$(cd "$target" && pwd)/not-tested.jsonl
: >"$CARDIOTWIN_NOT_TESTED"

summary() {
    local i
    printf '\n%-44s %9s %9s  %s\n' PART SECONDS PROCESSOR RESULT
    for i in "${!names[@]}"; do
        printf '%-44s %9.1f %9.1f  %s\n' "${names[i]}" "${seconds[i]}" "${processor_seconds[i]}" "${results[i]}"
    done
    printf '%-44s %9.1f %9.1f\n' total "$(sum "${seconds[@]}")" "$(sum "${processor_seconds[@]}")"
}

now() { date +%s.%N; }

sum() { printf '%s\n' "$@" | awk '{ total += $1 } END { print total + 0 }'; }

# Sets `processor` to the seconds of all commands that have ended. Not in a subshell or a pipe, which counts its own commands alone.
read_processor() {
    times >"$log"
    processor=$(awk 'NR == 2 { for (i = 1; i <= 2; i++) { split($i, t, /[ms]/); total += 60 * t[1] + t[2] } print total }' "$log")
}

# Of the output of tests that passed, only what they could not try here.
what_matters() {
    awk '/^successes:$/ { inside = 1 } /^(failures:|test result: .*)$/ { inside = 0 } !inside || /^not tested: /; { fflush() }'
}

part() { # name, command…
    local name=$1 start processor_start not_tested rc=0
    shift
    printf '\n=== %s: %s\n' "$name" "$*"
    start=$(now)
    read_processor
    processor_start=$processor
    "$@" 2>&1 | tee "$log" | what_matters || rc=$?
    n_passed=$((n_passed + $(sed -n 's/^test result: ok\. \([0-9]*\) passed.*/\1/p' "$log" | awk '{ n += $1 } END { print n + 0 }')))
    names+=("$name")
    seconds+=("$(awk -v a="$start" -v b="$(now)" 'BEGIN { printf "%.2f", b - a }')")
    not_tested=$(sed -n 's/^not tested: \(.*\)/; not tested: \1/p' "$log" | sort -u | tr -d '\n')
    read_processor
    processor_seconds+=("$(awk -v a="$processor_start" -v b="$processor" 'BEGIN { printf "%.2f", b - a }')")
    if [ "$rc" != 0 ]; then
        results+=("FAILED ($rc)")
        summary
        printf '\n%s failed: %s\n' "$name" "$*" >&2
        exit 1
    fi
    # What a part could not try here is said in the summary, too.
    results+=("passed$not_tested")
}

skipped() { # name, what is needed (as in .ci/allowed-skips), why
    printf '\n=== %s: skipped, %s\n' "$1" "$3"
    names+=("$1")
    seconds+=(0)
    processor_seconds+=(0)
    results+=("skipped: $3")
    printf '{"test":"%s","needs":"%s","why":"%s"}\n' "$1" "$2" "$3" >>"$CARDIOTWIN_NOT_TESTED"
    if [ "${CI:-}" = true ] && ! grep -q "^$2"$'\t'"." .ci/allowed-skips; then
        results[-1]="FAILED: $2 is missing, and CI=true"
        summary
        printf '\n%s needs %s: install it, or list it with a reason in .ci/allowed-skips\n' "$1" "$2" >&2
        exit 1
    fi
}

# The book says when a long test last passed.
passed_on() { # name
    local page=docs/long-tests.md commit
    commit=$(git rev-parse --short HEAD 2>/dev/null || echo unknown)
    sed -i "s/^| $1 |.*/| $1 | $(date -u +%F) | $commit | ${seconds[-1]%.*} s |/" "$page"
}

has_time() { # expected seconds, name
    local elapsed=$(($(date +%s) - began))
    if [[ ${CARDIOTWIN_TESTS:-} = all || ${CARDIOTWIN_TESTS:-} = long ]]; then
        return 0
    elif [ -z "${CARDIOTWIN_TEST_SECONDS:-}" ]; then
        skipped "$2" time "long: \`make test-all\` runs it"
    elif [ $((elapsed + $1)) -gt "$CARDIOTWIN_TEST_SECONDS" ]; then
        skipped "$2" time "no time left: $1 s expected after $elapsed of $CARDIOTWIN_TEST_SECONDS s"
    else
        return 0
    fi
    return 1
}

long_part() { # expected seconds, name, command…
    has_time "$1" "$2" || return 0
    shift
    part "$@"
    if [[ ${CARDIOTWIN_TESTS:-} = all || ${CARDIOTWIN_TESTS:-} = long ]]; then
        passed_on "$1"
    fi
}

# Test targets outside the units: those that the `tests` crate declares, and the `tests/` folders of the other crates.
integration_targets() {
    awk '/^\[/ { inside = ($0 == "[[test]]") } inside && /^name *=/ { gsub(/"/, "", $3); print $3 }' tests/Cargo.toml
    local file
    for file in schemas/tests/*.rs solver/*/tests/*.rs worker/tests/*.rs coordinator/*/tests/*.rs; do
        [ -e "$file" ] && basename "$file" .rs
    done
    for file in schemas/tests/*/main.rs solver/*/tests/*/main.rs worker/tests/*/main.rs coordinator/*/tests/*/main.rs; do
        [ -e "$file" ] && basename "$(dirname "$file")"
    done
    true
}

part "set up what is missing" deploy/deps.sh test

if $CARGO fmt --version >/dev/null 2>&1; then
    part "format" "$CARGO" fmt --all --check
    part "format: dev" "$CARGO" fmt --all --manifest-path dev/Cargo.toml --check
else
    skipped "format" rustfmt "rustfmt is not installed"
fi

# Before the build: it fails within seconds. Compiling mdbook takes minutes, so without one the book is a long test;
# the links of the pages themselves are checked by tests/documents.rs.
the_book() { docs/book/build.sh "$target/book"; }
if [ "${CARDIOTWIN_TESTS:-}" != long ] && docs/book/mdbook.sh --found "$target/tools" >/dev/null; then
    part "the book, its links" the_book
fi

# The worker on MPI ranks, where an MPI is found; MPICH's: `make test-mpich`.
with_mpi=() dev_with_mpi=()
if missing=$(deploy/mpi-found.sh); then
    with_mpi=(--features cardiotwin-worker/mpi) dev_with_mpi=(--features cardiotwin-dev/mpi)
fi
# Settings of cargo beside the workspace's own: CI compiles faster.
config=() dev_config=()
if [ -n "${CARDIOTWIN_CARGO_CONFIG:-}" ]; then
    config=(--config "$CARDIOTWIN_CARGO_CONFIG") dev_config=(--config "$CARDIOTWIN_CARGO_CONFIG" --config .ci/dev.toml)
fi
# One selection of packages and features for every command, so that nothing is compiled twice.
everything=(--release --locked --workspace "${with_mpi[@]}" "${config[@]}")
# Developers' tools, a workspace of its own.
dev=(--release --locked --manifest-path dev/Cargo.toml --workspace "${dev_with_mpi[@]}" "${dev_config[@]}")

part "build" "$CARGO" build "${everything[@]}" --lib --bins --tests
short_parts() {
    part "unit tests, JSON Schemas are current" "$CARGO" test "${everything[@]}" --lib --bins -q -- --show-output
    part "documentation's examples" "$CARGO" test "${everything[@]}" --doc -q
    [ -n "${with_mpi[*]}" ] || skipped "tests: mpi" mpi "$missing"
    for name in $(integration_targets | sort -u); do
        case $name in
        mpi) [ -n "${with_mpi[*]}" ] || continue ;;
        book) continue ;; # long: below
        esac
        part "tests: $name" "$CARGO" test "${everything[@]}" --test "$name" -q -- --show-output
    done

    part "tests: dev" "$CARGO" test "${dev[@]}" --lib --bins --tests -q -- --show-output

    if $CARGO clippy --version >/dev/null 2>&1; then
        part "clippy, warnings are errors" "$CARGO" clippy "${everything[@]}" --all-targets -- -D warnings
        part "clippy: dev" "$CARGO" clippy "${dev[@]}" --all-targets -- -D warnings
    else
        skipped "clippy" clippy "clippy is not installed"
    fi
    part "documentation, warnings are errors" env RUSTDOCFLAGS="-D warnings" "$CARGO" doc --release --locked --workspace "${config[@]}" --no-deps --document-private-items
    part "documentation: dev" env RUSTDOCFLAGS="-D warnings" "$CARGO" doc "${dev[@]}" --no-deps --document-private-items
}
if [ "${CARDIOTWIN_TESTS:-}" != long ]; then
    short_parts
fi

# The second part: with the time that is left.
# The wheel with the programs of the build above; the extension module alone is compiled.
if ! has_time 400 "long tests: python"; then
    :
elif python3 -c 'import ensurepip' 2>/dev/null && python/maturin.sh "$target" >/dev/null; then
    long_part 400 "long tests: python" env CARDIOTWIN_PROGRAMS="$target/release" python/test.sh --brief
    # With the NumPy of the part before.
    long_part 600 "long tests: second opinion" env CARDIOTWIN="$target/release/cardiotwin" CARDIOTWIN_OPINION=all PYTHONDONTWRITEBYTECODE=1 \
        "$target/python-test/env/bin/python" -m pytest -p no:cacheprovider --noconftest -q python/tests/test_second_opinion.py
    long_part 900 "long tests: notebooks" env CARDIOTWIN_PROGRAMS="$target/release" python/test.sh --notebooks
else
    skipped "long tests: python" python-packages "PyPI does not answer, or python3 has no venv"
fi
if docs/book/mdbook.sh --found "$target/tools" >/dev/null && [ "${CARDIOTWIN_TESTS:-}" != long ]; then
    : # above
elif ! has_time 180 "long tests: links of the book"; then
    :
elif docs/book/mdbook.sh "$target/tools" >/dev/null; then
    long_part 180 "long tests: links of the book" the_book
else
    skipped "long tests: links of the book" book "cargo could not build mdbook"
fi
long_part 1200 "long tests: book" "$CARGO" test "${everything[@]}" --test book -q -- --show-output
long_part 300 "long tests: damaged files" "$CARGO" test "${everything[@]}" --test damaged_files -- --ignored
long_part 1500 "long tests: slurm" "$CARGO" test "${everything[@]}" --test slurm -- --ignored
if why=$(tests/external-fenicsx.sh --can); then
    long_part 2400 "long tests: fenicsx" tests/external-fenicsx.sh "$target"
else
    skipped "long tests: fenicsx" debian-13 "$why"
fi

summary
printf '\nall parts passed; tests:\n%d passed, 0 failed\n' "$n_passed"
