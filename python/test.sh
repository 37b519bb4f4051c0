#!/usr/bin/env bash
# Makes the wheel, installs it into a new virtual environment, and tests what was installed: types, style, python/tests, the notebooks.
# Packages come from the index of pip. Usage: python/test.sh [--brief] [ARGUMENTS OF PYTEST]
# nibabel, SciPy and scikit-image: examples/own-anatomy/mesh_from_image.py needs them.
# --brief leaves out the notebooks, polars, xarray and types, which need large packages, and the long kinds of the second opinion.
set -euo pipefail
cd "$(dirname "$0")/.."

extras=parquet,polars,xarray,notebooks
left_out=()
export CARDIOTWIN_OPINION=${CARDIOTWIN_OPINION:-all}
if [ "${1:-}" = --brief ]; then
    shift
    extras=parquet
    CARDIOTWIN_OPINION=quick
    left_out=(--ignore="$PWD/python/tests/test_notebooks.py" -k "not polars_and_xarray")
fi

PYTHON=${PYTHON:-python3}
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
folder=$target/python-test
rm -rf -- "$folder"
mkdir -p "$folder"
python/build-wheel.sh "$folder/dist"
"$PYTHON" -m venv "$folder/env"
wheel=("$folder"/dist/cardiotwin-*.whl)
began=$(date +%s)
"$folder/env/bin/pip" install --quiet "${wheel[0]}"
echo "installed in $(($(date +%s) - began)) s: $("$folder/env/bin/cardiotwin" --version)"
"$folder/env/bin/pip" install --quiet "${wheel[0]}[$extras]" "pytest>=8" "mypy>=1.13" "ruff>=0.8" pandas-stubs \
    "nibabel>=5" "scipy>=1.11" "scikit-image>=0.22"
"$folder/env/bin/ruff" check --quiet --no-cache --config python/pyproject.toml python/cardiotwin python/tests python/benchmarks
"$folder/env/bin/ruff" format --quiet --no-cache --check --config python/pyproject.toml python/cardiotwin python/tests python/benchmarks
if [ ${#left_out[@]} = 0 ]; then
    (cd python && "$folder/env/bin/mypy" --config-file pyproject.toml --cache-dir "$folder/mypy" cardiotwin)
fi
# Out of the source tree, so that only the installed package is found.
tests=$PWD/python/tests
cd "$folder"
export CARDIOTWIN=$folder/env/bin/cardiotwin
PYTHONDONTWRITEBYTECODE=1 PYVISTA_OFF_SCREEN=true MPLBACKEND=agg "$folder/env/bin/python" -m pytest -p no:cacheprovider --import-mode=importlib -q "$tests" "${left_out[@]}" "$@"
