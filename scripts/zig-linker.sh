#!/bin/sh
# Prints a compiler and linker for an old glibc: programs and libraries that it links ask for no newer one.
# Usage: zig-linker.sh TARGET GLIBC, for example aarch64-unknown-linux-gnu 2.31
#
# It is Zig's C compiler, which knows the symbols of every glibc, by cargo-zigbuild, which knows what rustc means. Both
# are packages of PyPI. They are kept in a virtual environment in the user's cache folder.
set -eu
[ $# = 2 ] || { echo "usage: zig-linker.sh TARGET GLIBC" >&2; exit 2; }
zig=ziglang==0.17.1
zigbuild=cargo-zigbuild==0.24.0

home=${XDG_CACHE_HOME:-$HOME/.cache}/nvsprior/zig-${zig#*==}-${zigbuild#*==}
if [ ! -x "$home/bin/cargo-zigbuild" ]; then
    echo "installing $zig and $zigbuild into $home" >&2
    rm -rf "$home"
    python3 -m venv "$home" >&2
    "$home/bin/pip" install --quiet --disable-pip-version-check "$zig" "$zigbuild" >&2
fi

# One file per target: cargo takes a linker without arguments.
machine=${1%%-*}
linker=$home/cc-$1-$2
cat > "$linker.$$" <<END
#!/bin/sh
export CARGO_ZIGBUILD_PYTHON_PATH="$home/bin/python"
exec "$home/bin/cargo-zigbuild" zig cc -- -g -fno-sanitize=all -target $machine-linux-gnu.$2 "\$@"
END
chmod +x "$linker.$$"
mv "$linker.$$" "$linker"
echo "$linker"
