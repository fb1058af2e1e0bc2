#!/bin/sh
# Checks the decoder in Python against the vectors of tests/vectors, in a Python with numpy of its own.
set -eu
cd "$(dirname "$0")/.."
python=target/conformance/bin/python
if ! "$python" -c 'import numpy' 2>/dev/null; then
    python3 -m venv target/conformance
    "$python" -m pip install --quiet 'numpy>=2'
fi
exec "$python" tools/reference/python/conformance.py "$@"
