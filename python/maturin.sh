#!/usr/bin/env bash
# Prints the path of maturin, which pip installs into an environment below FOLDER, once. Usage: python/maturin.sh FOLDER
set -euo pipefail
env=${1:?usage: python/maturin.sh FOLDER}/python-build-env
test -x "$env/bin/maturin" || { "${PYTHON:-python3}" -m venv "$env" && "$env/bin/pip" install --quiet "maturin>=1.9,<2"; } >&2
printf '%s\n' "$env/bin/maturin"
