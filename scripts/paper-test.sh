#!/bin/sh
# Tests of tools/paper in a virtual environment of their own. PyTorch takes gigabytes, so this is no part of CI.
# Usage: paper-test.sh; PYTHON: Python 3.11 or newer (default: python3).
set -eu
cd "$(dirname "$0")/.."

venv=${CARGO_TARGET_DIR:-target}/paper-venv
requirements=tools/paper/requirements.txt
if ! cmp -s "$requirements" "$venv/installed.txt"; then
    "${PYTHON:-python3}" -m venv --clear "$venv"
    "$venv/bin/pip" install --quiet --requirement "$requirements"
    cp "$requirements" "$venv/installed.txt"
fi
scripts/wheel.sh
wheels=${CARGO_TARGET_DIR:-target}/wheels
"$venv/bin/pip" install --quiet --force-reinstall --no-deps "$wheels"/nvsprior-*_"$(uname -m)".whl
exec "$venv/bin/python" -W ignore -m unittest discover -s tools/paper/tests
