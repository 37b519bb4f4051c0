#!/usr/bin/env bash
# Runs a command of a fresh clone in a bare Debian, as a CI machine would: what this machine has installed hides no missing step.
# Usage: sudo deploy/bare-debian.sh FOLDER [COMMAND…]      e.g. deploy/bare-debian.sh /var/tmp/trixie .ci/run
#   FOLDER   for the Debian; made with debootstrap where it is not there (SUITE=trixie, MIRROR=http://deb.debian.org/debian)
#   COMMAND  [default: .ci/run]
# The Rust toolchain of this machine (`rustc --print sysroot`) is mounted there: installing one is the user's own step. For a CI service with
# containers the same in two lines: image debian:13 with rustup's toolchain, script `.ci/run`.
set -euo pipefail
cd "$(dirname "$0")/.."
debian=${1:?usage: deploy/bare-debian.sh FOLDER [COMMAND…]}
shift
[ $# -gt 0 ] || set -- .ci/run
[ "$(id -u)" = 0 ] || { echo "$0: a chroot needs root" >&2; exit 1; }
if [ ! -e "$debian/etc/debian_version" ]; then
    command -v debootstrap >/dev/null || { echo "$0: apt-get install debootstrap" >&2; exit 1; }
    debootstrap --variant=minbase --include=ca-certificates,git,make,curl "${SUITE:-trixie}" "$debian" "${MIRROR:-http://deb.debian.org/debian}"
fi
cp /etc/resolv.conf "$debian/etc/resolv.conf"
grep -qw "$(hostname)" "$debian/etc/hosts" 2>/dev/null || echo "127.0.0.1 localhost $(hostname)" >>"$debian/etc/hosts"
# What this machine trusts: a proxy's certificate, too.
cp /etc/ssl/certs/ca-certificates.crt "$debian/etc/ssl/certs/ca-certificates.crt"
rust=$(rustc --print sysroot)
mkdir -p "$debian/opt/rust"
mounted=()
leave() { for place in "${mounted[@]}"; do umount --lazy "$place"; done; }
trap leave EXIT
put() { mount "${@:1:$#-1}" "$debian${!#}"; mounted=("$debian${!#}" "${mounted[@]}"); }
put --bind -o ro "$rust" /opt/rust
put -t proc proc /proc
put -t sysfs sys /sys
put --bind /dev /dev
put -t devpts devpts /dev/pts
put -t tmpfs shm /dev/shm
rm -rf "$debian/src"
git clone --quiet . "$debian/src"
chroot "$debian" /usr/bin/env -i HOME=/root LANG=C.UTF-8 CI=1 \
    PATH=/opt/rust/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    bash -c 'cd /src && exec "$@"' bash "$@"
