#!/usr/bin/env bash
# Makes a wheel with the programs inside. Usage: python/build-wheel.sh [FOLDER], by default dist
# CARDIOTWIN_CARGO_CONFIG=FILE adds settings of cargo, as in .ci/parts.sh.
# CARDIOTWIN_PROGRAMS=FOLDER takes the programs from there instead of building them.
set -euo pipefail
cd "$(dirname "$0")/.."

CARGO=${CARGO:-cargo}
out=$(realpath -m "${1:-dist}")
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
config=()
[ -z "${CARDIOTWIN_CARGO_CONFIG:-}" ] || config=(--config "$CARDIOTWIN_CARGO_CONFIG")

programs=${CARDIOTWIN_PROGRAMS:-}
if [ -z "$programs" ]; then
    "$CARGO" build --release --locked "${config[@]}" --package cardiotwin --package cardiotwin-worker --bins
    programs=$target/release
fi
scripts=python/cardiotwin.data/scripts
rm -rf -- python/cardiotwin.data
mkdir -p "$scripts"
for program in cardiotwin cardiotwin-worker; do
    install -m 755 "$programs/$program" "$scripts/$program"
    strip "$scripts/$program" 2>/dev/null || echo "build-wheel: $program keeps its symbols, since there is no strip" >&2
done

maturin=$(python/maturin.sh "$target")
mkdir -p "$out"
# The programs in it are those of this machine's C library, so the wheel claims no older one.
CARGO_TARGET_DIR=$target "$maturin" build --release --locked "${config[@]}" --compatibility linux --manifest-path python/Cargo.toml --out "$out"
