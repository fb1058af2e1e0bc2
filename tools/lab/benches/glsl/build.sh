#!/bin/sh
# Compiles the hand-written stages (Debian: glslc).
set -e
cd "$(dirname "$0")"
for stage in splat radix_count radix_scatter; do
    glslc -O --target-env=vulkan1.2 -o "$stage.spv" "$stage.comp"
done
