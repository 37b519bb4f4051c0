#!/usr/bin/env bash
# `make worked-changes`: applies all diffs of CONTRIBUTING.md to a copy of the tree, builds it, and tries each change as a
# user would. Argument: the target folder, which keeps the copy and what was built.
set -euo pipefail
cd "$(dirname "$0")/.."

target=$(mkdir -p "$1" && cd "$1" && pwd)
copy=$target/tree
rm -rf "$copy"
mkdir -p "$copy"
git ls-files -z --cached --others --exclude-standard | tar --null --files-from=- --create | tar --extract --directory "$copy"

cd "$copy"
awk '/^```diff$/ { inside = 1; next } /^```$/ { inside = 0 } inside' CONTRIBUTING.md >"$target/worked.diff"
git init --quiet .
git apply "$target/worked.diff"
echo "applied: $(grep -c '^diff --git' "$target/worked.diff") files"

export CARGO_TARGET_DIR=$target/build
cargo fmt --all --check
cargo run --quiet --release --locked -p cardiotwin-schemas --example write-json-schemas
cargo run --quiet --release --locked -p cardiotwin-models --example effect_pages
cargo build --quiet --release --locked --workspace --bins
cargo test --no-fail-fast --quiet --release --locked -p cardiotwin-vocabulary -p cardiotwin-schemas -p cardiotwin-signals -p cardiotwin-models \
    -p cardiotwin-mechanics --lib
cargo test --quiet --release --locked -p cardiotwin-worker --lib finite_element::wall
# The diffs apply once.
cargo test --quiet --release --locked -p cardiotwin-tests --test documents -- --skip worked_changes_apply

bin=$CARGO_TARGET_DIR/release
cohort=$target/cohort
rm -rf "$cohort"
cp -r examples/coa-seven "$cohort"

expect() { # words, command…
    local words=$1 said
    shift
    said=$("$@" 2>&1) || { printf '%s failed:\n%s\n' "$*" "$said" >&2; exit 1; }
    grep -qF -- "$words" <<<"$said" || { printf '%s says no "%s":\n%s\n' "$*" "$words" "$said" >&2; exit 1; }
    echo "$* says \"$words\""
}
simulate=("$bin/cardiotwin" simulate 01-CoA --cohort "$cohort" --out "$target/beat")
expect P_mean_mmHg "${simulate[@]}" --contraction half-sine --set S_max_kPa=90 --set beta=2
expect volume_offset cat docs/effects/README.md
expect 30 "$bin/cardiotwin" config show "$cohort" --set posterior.steps_per_draw=30
expect demiray "$bin/cardiotwin" config show "$cohort" --set solver.finite_element.wall.muscle_law=demiray
echo "all worked changes hold"
