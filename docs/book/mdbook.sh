#!/usr/bin/env bash
# Prints the path of mdbook: $MDBOOK, the one in PATH (Debian has it from 13 on), else one that cargo builds below FOLDER, once
# (two minutes on two cores; downloads crates). With --found it builds none, and fails instead.
# Usage: docs/book/mdbook.sh [--found] FOLDER
set -euo pipefail
build=yes
if [ "${1:-}" = --found ]; then
    build=no
    shift
fi
folder=${1:?usage: docs/book/mdbook.sh [--found] FOLDER}
version=0.4.52

if [ -n "${MDBOOK:-}" ]; then
    printf '%s\n' "$MDBOOK"
elif command -v mdbook >/dev/null; then
    command -v mdbook
else
    program=$folder/mdbook-$version/bin/mdbook
    if [ ! -x "$program" ]; then
        [ "$build" = yes ] || exit 1
        "${CARGO:-cargo}" install --quiet --locked --version "$version" --no-default-features --features search \
            --config 'profile.release.opt-level=1' --config 'profile.release.lto="off"' \
            --root "$folder/mdbook-$version" --target-dir "$folder/mdbook-build" mdbook >&2
        rm -rf -- "$folder/mdbook-build"
    fi
    printf '%s\n' "$program"
fi
