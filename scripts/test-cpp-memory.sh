#!/bin/sh
# The C++ side under the sanitizers and valgrind:
#
#   scripts/test-cpp-memory.sh            without CGAL and TetGen: address and undefined, thread, valgrind
#   scripts/test-cpp-memory.sh native     with them: address and undefined, also in cpp/native (15 minutes and 6 GB)
#
# Rust needs none of it: the static library is the ordinary one, and the C++ in it is replaced by C++ built with checks,
# which the linker meets first.
set -eu
cd "$(dirname "$0")/.."
root=$(pwd)
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$root/target}"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
features=cpp
libraries="-lpthread -ldl -lm"
[ "${1:-}" != native ] || {
    features=cpp,native
    libraries="-ltet -lmpfr -lgmp $libraries"
}

echo "== static library ($features)"
cargo rustc --locked --release --lib --crate-type staticlib --no-default-features --features "$features" \
    --message-format json >"$work/messages"
# Where the bridge's generated header is; the last build script of the crate is the one of these features.
generated=$(grep '"build-script-executed"' "$work/messages" | grep '"package_id":"path+file:' |
    sed 's/.*"out_dir":"\([^"]*\)".*/\1/' | tail -n 1)/cxxbridge
archive=$CARGO_TARGET_DIR/release/libsolidmap.a
cp "$archive" "$work/libsolidmap.a"

# objects FOLDER FLAGS...: the C++ side with these checks.
objects() {
    folder=$work/$1
    shift
    mkdir -p "$folder"
    set -- -std=c++17 -O1 -g -fno-omit-frame-pointer "$@" -Icpp/include -Icpp/src -Icpp/native \
        -I"$generated/include" -I"$generated/crate"
    glue=""
    [ "$features" = cpp ] || glue="cpp/native/glue.cpp $generated/sources/solidmap/src/native/bridge.rs.cc"
    for source in cpp/src/*.cpp cpp/tests/unit/*.cpp "$generated"/sources/solidmap/src/ffi/bridge.rs.cc $glue; do
        c++ "$@" -DEXPECTED_NATIVE="$(echo "$features" | grep -c native)" -DEXPECTED_VERSION="\"$version\"" \
            -c "$source" -o "$folder/$(echo "${source#"$generated"}" | tr / _).o"
    done
    [ "$features" = cpp ] || for source in distance mesh3 remesh self_intersections tetgen wrap; do
        # Without -g: the templates' names alone would fill gigabytes.
        c++ "$@" -g0 -frounding-math -DTETLIBRARY -I/usr/include/eigen3 -c "cpp/native/$source.cpp" -o "$folder/$source.o"
    done
}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)

echo "== address and undefined behaviour"
objects address -fsanitize=address,undefined -fno-sanitize-recover=all
# shellcheck disable=SC2086 # the libraries are words
c++ -fsanitize=address,undefined "$work"/address/*.o "$work/libsolidmap.a" $libraries -o "$work/address/tests"
# The library tests TetGen's error function by a request for memory that cannot be granted.
ASAN_OPTIONS=allocator_may_return_null=1 timeout -k 5 600 "$work/address/tests"

[ "$features" = cpp ] || exit 0

echo "== threads"
objects thread -fsanitize=thread
# The sanitizer sees calls of memcpy and free in Rust, but not what synchronises them: everything of Rust goes into a shared
# library without checks, whose calls can be ignored.
# shellcheck disable=SC2086
c++ -shared -Wl,-z,now -Wl,--whole-archive "$work/libsolidmap.a" -Wl,--no-whole-archive $libraries \
    -o "$work/thread/libunchecked.so"
c++ -fsanitize=thread -rdynamic "$work"/thread/*.o -L"$work/thread" -lunchecked -Wl,-rpath,"$work/thread" \
    -o "$work/thread/tests"
TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1" timeout -k 5 300 "$work/thread/tests" \
    --test-case="*threads*,*another thread*,*callback*"

echo "== valgrind"
# shellcheck disable=SC2086
c++ -std=c++17 -O1 -g -Icpp/include cpp/examples/eigen_matrices.cpp -I/usr/include/eigen3 "$work/libsolidmap.a" $libraries \
    -o "$work/example"
(cd "$work" && RAYON_NUM_THREADS=2 valgrind --error-exitcode=1 --leak-check=full \
    --show-leak-kinds=definite,indirect --errors-for-leak-kinds=definite,indirect ./example)
