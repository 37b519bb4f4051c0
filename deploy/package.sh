#!/usr/bin/env bash
# Makes OUT/cardiotwin-VERSION-ARCH.tar.gz: a coordinator without shared libraries (musl), the worker of this machine, manual, completions,
# site profiles, a modulefile. Usage: deploy/package.sh [OUT] [PREFIX]
#   OUT     [default: dist]
#   PREFIX  where the tarball will be unpacked, for the modulefile [default: /opt/cardiotwin/VERSION]
# Needs `rustup target add x86_64-unknown-linux-musl` and musl-gcc (Debian: musl-tools), which compiles SQLite.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-dist}
arch=$(uname -m)
target=$arch-unknown-linux-musl
built=${CARGO_TARGET_DIR:-target}
command -v musl-gcc >/dev/null || { echo "$0: no musl-gcc: apt-get install musl-tools" >&2; exit 1; }
rustc --print target-libdir --target "$target" | xargs ls >/dev/null 2>&1 || { echo "$0: rustup target add $target" >&2; exit 1; }
env "CC_${target//-/_}=musl-gcc" cargo build --release --locked --target "$target" --package cardiotwin --bin cardiotwin
cargo build --release --locked --bins
version=$("$built/$target/release/cardiotwin" --version | awk '{ print $2; exit }')
prefix=${2:-/opt/cardiotwin/$version}
tree=$(mktemp -d)
trap 'rm -rf -- "$tree"' EXIT
DESTDIR=$tree deploy/install.sh "$prefix" "$built/$target/release" "$built/release"
mkdir -p "$out"
name=cardiotwin-$version-$arch
mv "$tree$prefix" "$tree/$name"
tar -C "$tree" --owner=0 --group=0 --sort=name -czf "$out/$name.tar.gz.part" "$name"
mv "$out/$name.tar.gz.part" "$out/$name.tar.gz"
echo "$out/$name.tar.gz"
