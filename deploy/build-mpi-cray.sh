#!/usr/bin/env bash
# Builds cardiotwin-worker-mpi with the compiler wrapper `cc` of a Cray (ARCHER2, LUMI and their like), on a login node.
#
#   deploy/build-mpi-cray.sh [target folder, target/mpi without]
#
# `cc` adds MPI's headers and libraries by itself and has no `-show`: the binding is told where they are by
# CRAY_MPICH_DIR, which the module cray-mpich sets. libclang reads the header: name its folder in LIBCLANG_PATH, such as
# the lib folder of the module cce-llvm or of a conda environment with `libclang`. Run the program with srun alone, no
# --mpi: Cray MPICH speaks the site's default.
#
# Not tried on a Cray: nothing of this project was run on one. What may differ is the name of modules.
set -euo pipefail
cd "$(dirname "$0")/.."
fail() { echo "build-mpi-cray: $*" >&2; exit 1; }
command -v cc >/dev/null || fail "no cc: load PrgEnv-gnu"
[ -n "${CRAY_MPICH_DIR:-}" ] || fail "CRAY_MPICH_DIR is not set: load cray-mpich"
[ -n "${LIBCLANG_PATH:-}" ] || fail "LIBCLANG_PATH is not set: name the folder that holds libclang.so"
command -v cargo >/dev/null || fail "no cargo: get one with rustup (https://rustup.rs)"
export CC=cc MPICC=cc
# Rust links with cc, too, so that the wrapper's libraries are found.
export CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_LINKER=cc
exec cargo build --release --locked --package cardiotwin-worker --features mpi --bin cardiotwin-worker-mpi \
    --target-dir "${1:-target/mpi}"
