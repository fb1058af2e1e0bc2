#!/bin/sh
# Compares the Rust library's public API with that of the last release, by cargo-semver-checks. Before the first release
# there is nothing to compare.
set -eu
cd "$(dirname "$0")/.."
tag=$(git tag --list 'v[0-9]*' --sort=-v:refname --merged HEAD | head -n 1)
if [ -z "$tag" ]; then
    echo "semver-check: there is no release yet, so the API has nothing to keep"
    exit 0
fi
scripts/setup.sh semver
exec cargo semver-checks --baseline-rev "$tag" \
    --package nvsprior --package nvsprior-kernels --package nvsprior-formats --package nvsprior-link
