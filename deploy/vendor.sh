#!/usr/bin/env bash
# Makes OUT/cardiotwin-VERSION-source.tar.gz: this commit with the sources of all dependencies, to be built where there is no network.
# Usage: deploy/vendor.sh [OUT]      then, there: tar -xzf …; cd cardiotwin-VERSION; cargo build --release --offline --bins
set -euo pipefail
cd "$(dirname "$0")/.."
out=$(mkdir -p "${1:-dist}" && cd "${1:-dist}" && pwd)
version=$(sed -n 's/^version *= *"\(.*\)"/\1/p' Cargo.toml | head -n 1)
name=cardiotwin-$version
commit=$(git rev-parse --short=12 HEAD)
tree=$(mktemp -d)
trap 'rm -rf -- "$tree"' EXIT
git archive --prefix="$name/" HEAD | tar -C "$tree" -xf -
cd "$tree/$name"
mkdir -p .cargo
cargo vendor --locked vendor >>.cargo/config.toml
# The worker says from which commit it was built; an archive has no .git.
printf '\n[env]\nCARDIOTWIN_COMMIT = "%s"\n' "$commit" >>.cargo/config.toml
tar -C "$tree" --owner=0 --group=0 --sort=name -czf "$out/$name-source.tar.gz.part" "$name"
mv "$out/$name-source.tar.gz.part" "$out/$name-source.tar.gz"
echo "$out/$name-source.tar.gz"
