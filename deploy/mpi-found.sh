#!/usr/bin/env bash
# Whether cardiotwin-worker-mpi can be built here: an MPI's compiler wrapper (MPICC, or mpicc) and libclang, which reads
# the MPI's header. Exit code 1 where something is missing, which it names.
set -euo pipefail
mpicc=${MPICC:-mpicc}
if ! command -v "$mpicc" >/dev/null 2>&1; then
    echo "no MPI: $mpicc is not there (Debian: openmpi-bin libopenmpi-dev, or mpich libmpich-dev)"
    exit 1
fi
for folder in "${LIBCLANG_PATH:-}" /usr/lib/llvm-*/lib /usr/lib/*-linux-gnu /usr/lib64 /usr/lib; do
    compgen -G "$folder/libclang*.so*" | grep -v cpp >/dev/null && exit 0
done
echo "no libclang (Debian: libclang-dev; elsewhere name its folder in LIBCLANG_PATH)"
exit 1
