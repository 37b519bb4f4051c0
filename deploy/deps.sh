#!/usr/bin/env bash
# Installs what this machine lacks, and says what. Usage: deploy/deps.sh demo|test
#   demo  what building and running needs: a C compiler and linker, CA certificates (cargo downloads crates)
#   test  that, and what the tests need beyond: rustfmt, clippy, git, Chromium with a font (the report is looked at), Python, Open MPI
#         and libclang (the worker on MPI ranks)
# Where it may not install (no root, no sudo, no apt), it names what is missing, goes on with what is not needed for
# the demo, and stops only at what is.
set -euo pipefail
cd "$(dirname "$0")/.."

purpose=${1:-test}
case $purpose in demo | test) ;; *) echo "usage: $0 demo|test" >&2; exit 2 ;; esac

say() { printf 'deps: %s\n' "$*" >&2; }
have() { command -v "$1" >/dev/null 2>&1; }
any_of() { local name; for name in "$@"; do have "$name" && return 0; done; return 1; }
font_is_there() { compgen -G '/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf' >/dev/null || { have fc-list && [ -n "$(fc-list :lang=en 2>/dev/null | head -n 1)" ]; }; }

# --- what is missing, as Debian packages -------------------------------------------------------------------------
needed=()   # without these nothing can be built
optional=() # without these a part of the tests is skipped
any_of cc gcc clang || needed+=(build-essential)
[ -e /etc/ssl/certs/ca-certificates.crt ] || [ -e /etc/pki/tls/certs/ca-bundle.crt ] || [ -n "${SSL_CERT_FILE:-}" ] || needed+=(ca-certificates)
if [ "$purpose" = test ]; then
    have git || optional+=(git)
    any_of chromium chromium-browser google-chrome google-chrome-stable || optional+=(chromium)
    font_is_there || optional+=(fonts-dejavu-core)
    have python3 || optional+=(python3) # the example of an external solver
    python3 -c 'import ensurepip' 2>/dev/null || optional+=(python3-venv) # the reader of RO-Crates, from PyPI
    deploy/mpi-found.sh >/dev/null || optional+=(openmpi-bin libopenmpi-dev libclang-dev)
fi

# --- may we install? ---------------------------------------------------------------------------------------------
as_root=none
if [ "$(id -u)" = 0 ]; then
    as_root=""
elif have sudo && sudo -n true 2>/dev/null; then
    as_root="sudo -n"
elif have sudo && [ -t 0 ] && [ -z "${CI:-}" ]; then
    as_root="sudo" # asks for the password at the terminal
fi

install() { # packages…; false where it did not work
    have apt-get || { say "this is not a Debian-like system (no apt-get)"; return 1; }
    [ "$as_root" != none ] || { say "neither root nor sudo: may not install"; return 1; }
    say "installing with apt-get: $*"
    # A list that cannot be refreshed may still hold the packages: the installation decides.
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 update >&2 || say "apt-get update failed; trying with the lists as they are"
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 -y --no-install-recommends install "$@" >&2
}

if [ ${#needed[@]} -gt 0 ] && ! install "${needed[@]}"; then
    say "MISSING and needed: ${needed[*]} (Debian package names); install them and run this again"
    exit 1
fi
if [ ${#optional[@]} -gt 0 ] && ! install "${optional[@]}"; then
    say "skipped, not needed for the demo: ${optional[*]}; tests that need them say so and are skipped"
fi

# Debian has it from 13 on; the book is left out without it.
if [ "$purpose" = test ] && ! have mdbook && [ "$(. /etc/os-release 2>/dev/null && echo "${ID:-}${VERSION_ID:-0}" | sed -n 's/^debian//p')" -ge 13 ] 2>/dev/null; then
    install mdbook || say "skipped, not needed for the demo: mdbook"
fi

# --- the Rust toolchain: never installed behind anyone's back -----------------------------------------------------
wanted=$(sed -n 's/^rust-version *= *"\([0-9.]*\)".*/\1/p' Cargo.toml)
how_to="get one with rustup (https://rustup.rs):  curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh"
# make and sudo may drop what the login shell adds to PATH.
if ! have cargo && [ -x "$HOME/.cargo/bin/cargo" ]; then
    say "cargo is in $HOME/.cargo/bin, which is not in PATH: run  . \"$HOME/.cargo/env\"  and try again"
    exit 1
fi
if ! have cargo; then
    say "MISSING and needed: a Rust toolchain, $wanted or newer; $how_to"
    if have apt-cache; then
        candidate=$(apt-cache policy rustc 2>/dev/null | sed -n 's/^ *Candidate: *//p')
        case $candidate in
        "" | "(none)") ;;
        *)
            if [ "$(printf '%s\n%s\n' "$wanted" "${candidate%%[+~-]*}" | sort -V | head -n 1)" = "$wanted" ]; then
                say "or, since Debian's rustc here is $candidate: apt-get install cargo rustfmt rust-clippy"
            else
                say "(Debian's own rustc here is $candidate, older than the $wanted that is needed)"
            fi
            ;;
        esac
    fi
    exit 1
fi
if ! found=$(rustc --version 2>&1); then
    say "cargo is there, but rustc does not run: $found"
    exit 1
fi
found=$(printf '%s' "$found" | sed -n 's/^rustc \([0-9.]*\).*/\1/p')
if [ "$(printf '%s\n%s\n' "$wanted" "$found" | sort -V | head -n 1)" != "$wanted" ]; then
    say "rustc is $found, but cardiotwin needs $wanted or newer (found at $(command -v rustc)); $how_to"
    say "(Debian's packages are often older than that; with rustup already there: rustup update stable)"
    exit 1
fi

if [ "$purpose" = test ]; then
    for component in rustfmt clippy; do
        case $component in rustfmt) run="cargo fmt --version" ;; clippy) run="cargo clippy --version" ;; esac
        $run >/dev/null 2>&1 && continue
        if have rustup && say "installing with rustup: $component" && rustup component add "$component" >&2; then
            continue
        fi
        say "skipped, not needed for the demo: $component (rustup component add $component, or Debian's rustfmt and rust-clippy)"
    done
fi
say "ready for $purpose: rustc $found, $(for c in cc gcc clang; do have $c && { $c --version | head -n 1; break; }; done)"
