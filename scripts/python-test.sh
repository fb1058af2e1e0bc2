#!/bin/sh
# Tests of the Python package: its lints, and pytest on a wheel that is installed in an environment of its own.
# Usage: [PROFILE=dev] python-test.sh [WHEEL]; without a wheel, one is built.
# NVSPRIOR_PROGRAM: the program whose packets the package's are compared with, target/debug/nvsprior if it is there.
set -eu
cd "$(dirname "$0")/.."
built=${CARGO_TARGET_DIR:-target}
case $built in /*) ;; *) built=$PWD/$built ;; esac

if [ $# = 0 ]; then
    # As maturin builds it, so that nothing is built twice.
    PYO3_BUILD_EXTENSION_MODULE=1 cargo clippy --package nvsprior-python --all-targets -- -D warnings
    PROFILE=${PROFILE:-dev} OUT=$built/python-test/wheels scripts/wheel.sh
    set -- "$built"/python-test/wheels/nvsprior-*.whl
fi
venv=$built/python-test/venv
if ! "$venv/bin/python" -c 'import matplotlib, mypy, numpy, PIL, pytest' 2> /dev/null; then
    python3 -m venv --clear "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check numpy pytest mypy matplotlib pillow
fi
"$venv/bin/pip" install --quiet --disable-pip-version-check --force-reinstall --no-deps "$1"

if [ -z "${NVSPRIOR_PROGRAM:-}" ] && [ -x "$built/debug/nvsprior" ]; then
    export NVSPRIOR_PROGRAM="$built/debug/nvsprior"
fi
# The folder of the sources must not stand in for what is installed.
cd "$built/python-test"
"$venv/bin/python" -m mypy --strict --package nvsprior
"$venv/bin/python" -m mypy.stubtest nvsprior
exec "$venv/bin/python" -m pytest --quiet -p no:cacheprovider "$OLDPWD/python/tests"
