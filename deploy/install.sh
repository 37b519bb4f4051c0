#!/usr/bin/env bash
# Puts what was built under a prefix, as packages and module trees want it. Usage: deploy/install.sh PREFIX [BINARIES]
#   PREFIX    absolute, for example /opt/cardiotwin/0.2.0; DESTDIR is put before it
#   BINARIES  folders with programs, the first that has one wins [default: target/release]
# Gives bin/, share/man/man1/, share/bash-completion/, share/zsh/, share/fish/, share/cardiotwin/ (site profiles, batch scripts) and
# share/modulefiles/cardiotwin/VERSION (for environment-modules and Lmod).
set -euo pipefail
cd "$(dirname "$0")/.."
prefix=${1:?usage: deploy/install.sh PREFIX [BINARIES]}
case $prefix in /*) ;; *) echo "$0: PREFIX '$prefix' has to be absolute" >&2; exit 2 ;; esac
shift
[ $# -gt 0 ] || set -- "${CARGO_TARGET_DIR:-target}/release"
into=${DESTDIR:-}$prefix

found() { # program; the first folder's
    local folder
    for folder in "${folders[@]}"; do
        if [ -x "$folder/$1" ]; then echo "$folder/$1"; return; fi
    done
    return 1
}
folders=("$@")
for program in cardiotwin cardiotwin-worker; do
    found "$program" >/dev/null || { echo "$0: no $program in ${folders[*]}: make build" >&2; exit 1; }
done
install -d "$into/bin" "$into/share/man/man1" "$into/share/cardiotwin/sites"
for program in cardiotwin cardiotwin-worker cardiotwin-worker-mpi; do
    if path=$(found "$program"); then install -m 755 "$path" "$into/bin/$program"; fi
done
cardiotwin=$into/bin/cardiotwin
version=$("$cardiotwin" --version | awk '{ print $2; exit }')
"$cardiotwin" man --out "$into/share/man/man1" >/dev/null
for shell in bash:bash-completion/completions/cardiotwin zsh:zsh/site-functions/_cardiotwin fish:fish/vendor_completions.d/cardiotwin.fish; do
    file=$into/share/${shell#*:}
    install -d "$(dirname "$file")"
    "$cardiotwin" completions "${shell%%:*}" >"$file"
done
install -m 644 deploy/sites/*.toml "$into/share/cardiotwin/sites/"
install -m 755 deploy/submit-cohort.sbatch "$into/share/cardiotwin/"
install -d "$into/share/modulefiles/cardiotwin"
sed -e "s|@PREFIX@|$prefix|g" -e "s|@VERSION@|$version|g" deploy/modulefile >"$into/share/modulefiles/cardiotwin/$version"
echo "$into: cardiotwin $version"
