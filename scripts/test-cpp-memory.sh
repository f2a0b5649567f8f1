#!/bin/sh
# The C++ side under the sanitizers and valgrind:
#
#   scripts/test-cpp-memory.sh            without CGAL and TetGen: address and undefined, thread, valgrind
#   scripts/test-cpp-memory.sh native     with them: address and undefined, also in src/cgal_tetgen/cpp (15 minutes
#                                         and 6 GB)
#
# Rust is not instrumented: the static library is the ordinary one, and the C++ in it is replaced by instrumented C++,
# which the linker meets first.
set -eu
cd "$(dirname "$0")/.."
root=$(pwd)
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$root/target}"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
features=
libraries="-lpthread -ldl -lm"
[ "${1:-}" != native ] || {
    features="--features native"
    libraries="-ltet -lmpfr -lgmp $libraries"
}

echo "== static library ${features:-without CGAL and TetGen}"
# shellcheck disable=SC2086 # split into words on purpose
cargo rustc --locked --release --package solidmap-cpp --lib --crate-type staticlib --no-default-features $features \
    --message-format json >"$work/messages"
# bridge FOLDER: prints where cxx has generated the headers of the package in this folder.
bridge() {
    echo "$(grep '"build-script-executed"' "$work/messages" | grep "\"package_id\":\"path+file://$1#" |
        sed 's/.*"out_dir":"\([^"]*\)".*/\1/' | tail -n 1)/cxxbridge"
}
generated=$(bridge "$root/cpp")
library_bridge=$(bridge "$root")
archive=$CARGO_TARGET_DIR/release/libsolidmap_cpp.a
cp "$archive" "$work/libsolidmap.a"

# compile FOLDER FLAGS...: compiles the sources that standard input lists, on all cores.
compile() {
    into=$1
    shift
    # shellcheck disable=SC2016 # the inner shell expands it
    xargs -P "$(nproc 2>/dev/null || echo 2)" -I SOURCE sh -c '
        source=$1
        into=$2
        shift 2
        c++ "$@" -c "$source" -o "$into/$(echo "$source" | tr / _).o"' compile SOURCE "$into" "$@"
}

# objects FOLDER FLAGS...: compiles the C++ side with these flags.
objects() {
    folder=$work/$1
    shift
    mkdir -p "$folder"
    set -- -std=c++17 -O0 -g1 -fno-omit-frame-pointer "$@" -Icpp/include -Icpp/src -Isrc/cgal_tetgen/cpp \
        -I"$generated/include" -I"$generated/crate" -I"$library_bridge/include" -I"$library_bridge/crate"
    glue=""
    [ -z "$features" ] || glue="src/cgal_tetgen/cpp/glue.cpp $library_bridge/sources/solidmap/src/cgal_tetgen/bridge.rs.cc"
    # shellcheck disable=SC2086 # split into words on purpose
    printf '%s\n' cpp/src/*.cpp cpp/tests/unit/*.cpp "$generated"/sources/solidmap-cpp/bridge/bridge.rs.cc $glue |
        compile "$folder" "$@" -DEXPECTED_NATIVE="$(echo "$features" | grep -c native)" -DEXPECTED_VERSION="\"$version\""
    # CGAL is too slow unoptimised, and the names of its templates alone would fill gigabytes.
    [ -z "$features" ] || for source in distance mesh3 remesh self_intersections tetgen wrap; do
        echo "src/cgal_tetgen/cpp/$source.cpp"
    done | compile "$folder" "$@" -O1 -g0 -frounding-math -DTETLIBRARY -I/usr/include/eigen3
}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)

if [ -z "$features" ]; then
    echo "== valgrind"
    # shellcheck disable=SC2086
    c++ -std=c++17 -O1 -g -Icpp/include cpp/examples/eigen_matrices.cpp -I/usr/include/eigen3 "$work/libsolidmap.a" $libraries \
        -o "$work/example"
    (cd "$work" && RAYON_NUM_THREADS=2 valgrind --error-exitcode=1 --leak-check=full \
        --show-leak-kinds=definite,indirect --errors-for-leak-kinds=definite,indirect ./example)
fi

echo "== address and undefined behaviour"
objects address -fsanitize=address,undefined -fno-sanitize-recover=all
# shellcheck disable=SC2086 # split into words on purpose
c++ -fsanitize=address,undefined "$work"/address/*.o "$work/libsolidmap.a" $libraries -o "$work/address/tests"
# The self-test of TetGen's error handling asks for more memory than can be granted.
ASAN_OPTIONS=allocator_may_return_null=1 timeout -k 5 600 "$work/address/tests"

[ -z "$features" ] || exit 0

echo "== threads"
objects thread -fsanitize=thread
# The sanitizer intercepts memcpy and free in Rust, but not what synchronises them, and would report false races.
# So all Rust code goes into a shared library that is not instrumented, whose calls the sanitizer can ignore.
# shellcheck disable=SC2086
c++ -shared -Wl,-z,now -Wl,--whole-archive "$work/libsolidmap.a" -Wl,--no-whole-archive $libraries \
    -o "$work/thread/libunchecked.so"
c++ -fsanitize=thread -rdynamic "$work"/thread/*.o -L"$work/thread" -lunchecked -Wl,-rpath,"$work/thread" \
    -o "$work/thread/tests"
TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1" timeout -k 5 300 "$work/thread/tests" \
    --test-case="*threads*,*another thread*,*callback*"
