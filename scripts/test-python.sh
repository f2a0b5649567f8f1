#!/bin/sh
# Builds the Python package into a virtual environment, and runs its tests and mypy:
#
#   scripts/test-python.sh [PYTEST ARGUMENT...]
#
# The C++ and the library are those of cargo's target folder. Tests against the program need it there too: `cargo test`
# leaves it.
set -eu
cd "$(dirname "$0")/.."
environment=${SOLIDMAP_PYTHON_ENVIRONMENT:-target/python}
[ -x "$environment/bin/python" ] || {
    python3 -m venv "$environment" || {
        echo "there is no python3 with venv: apt-get install python3-venv" >&2
        exit 2
    }
}
python=$environment/bin/python
"$python" -m pip install --quiet --upgrade pip
"$python" -m pip install --quiet 'maturin>=1.7,<2'
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
# With the libraries of this system, as `pip install .` has it.
"$environment/bin/maturin" build --release --locked --auditwheel skip --interpreter "$python" --out "$wheels"
"$python" -m pip install --quiet --force-reinstall --no-deps "$wheels"/solidmap-*.whl
# Now that it is there, only what its extra names is still missing.
"$python" -m pip install --quiet "$(ls "$wheels"/solidmap-*.whl)[test]"
"$python" -m mypy
"$python" -m mypy.stubtest solidmap._solidmap --ignore-disjoint-bases
"$python" -m pytest "$@"
