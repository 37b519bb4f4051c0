#!/usr/bin/env bash
# Makes the wheel, installs it into a new virtual environment, and tests what was installed: types, style, python/tests, the notebooks.
# Packages come from the index of pip. Usage: python/test.sh [--brief | --notebooks] [ARGUMENTS OF PYTEST]
# --brief leaves out the notebooks, polars and xarray, which need large packages, and the long kinds of the second opinion.
# --notebooks runs the notebooks alone, and keeps them with their outputs and their pictures in TARGET/python-test/notebooks.
# nibabel, SciPy and scikit-image: examples/own-anatomy/mesh_from_image.py needs them.
set -euo pipefail
cd "$(dirname "$0")/.."

extras=pandas,parquet,polars,xarray,notebooks
left_out=()
tests=$PWD/python/tests
export CARDIOTWIN_OPINION=${CARDIOTWIN_OPINION:-all}
if [ "${1:-}" = --brief ]; then
    shift
    extras=pandas,parquet
    CARDIOTWIN_OPINION=quick
    left_out=(--ignore="$tests/test_notebooks.py" -k "not polars_and_xarray")
elif [ "${1:-}" = --notebooks ]; then
    shift
    extras=notebooks
    tests=$tests/test_notebooks.py
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
# With NumPy alone.
(cd "$folder" && env/bin/python -c 'import cardiotwin; assert cardiotwin.Ventricle.average().beat().biomarkers.SV_mL > 0')
"$folder/env/bin/pip" install --quiet "${wheel[0]}[$extras]" "pytest>=8" "ruff>=0.8" "nibabel>=5" "scipy>=1.11" "scikit-image>=0.22"
if [ "$extras" != notebooks ]; then
    "$folder/env/bin/ruff" check --quiet --no-cache --config python/pyproject.toml python/cardiotwin python/tests python/benchmarks
    "$folder/env/bin/ruff" format --quiet --no-cache --check --config python/pyproject.toml python/cardiotwin python/tests python/benchmarks
    # Each release of a checker, or of stubs, finds something else: all are pinned, in an environment of their own.
    # Of polars and PyVista only the types are needed, not the large libraries below them.
    "$PYTHON" -m venv "$folder/types"
    "$folder/types/bin/pip" install --quiet mypy==2.4.1 "pyright[nodejs]==1.1.414" numpy==2.4.6 pandas==3.1.1 pandas-stubs==3.1.0.261029 xarray==2026.9.0
    "$folder/types/bin/pip" install --quiet --no-deps polars==2.1.0 pyvista==0.49.1
    (
        cd python
        "$folder/types/bin/mypy" --config-file pyproject.toml --cache-dir "$folder/mypy" cardiotwin tests/typed_use.py
        "$folder/types/bin/pyright" --pythonpath "$folder/types/bin/python" --project pyproject.toml cardiotwin tests/typed_use.py
    )
fi
# Out of the source tree, so that only the installed package is found.
cd "$folder"
export CARDIOTWIN_NOTEBOOKS=$folder/notebooks
export CARDIOTWIN=$folder/env/bin/cardiotwin
PYTHONDONTWRITEBYTECODE=1 PYVISTA_OFF_SCREEN=true MPLBACKEND=agg "$folder/env/bin/python" -m pytest -p no:cacheprovider --import-mode=importlib -q "$tests" "${left_out[@]}" "$@"
