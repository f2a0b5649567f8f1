#!/bin/sh
# The C++ package as its users meet it: built, installed, moved, used by a project that finds it and by one that has it
# as a subfolder; unit tests and examples. With CGAL and TetGen (`on`) and without (`off`), unless one of them is given.
#
# Uses cargo's target folder of the clone (or CARGO_TARGET_DIR), so that what is built already is not built again.
set -eu
cd "$(dirname "$0")/.."
root=$(pwd)
target=${CARGO_TARGET_DIR:-$root/target}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
jobs=$(nproc 2>/dev/null || echo 2)

run() { # shows what a command prints only when it fails
    "$@" >"$work/log" 2>&1 || {
        cat "$work/log" >&2
        echo "failed: $*" >&2
        exit 1
    }
}

headers_pass=
for native in ${1:-on off}; do
    echo "== C++ package, native $native"
    build=$work/build-$native
    # The C++ side in both kinds of build; the library from cargo is always a release build.
    case $native in on) type=Release ;; *) type=Debug ;; esac
    run cmake -S . -B "$build" -DSOLIDMAP_NATIVE="$native" -DSOLIDMAP_CARGO_TARGET_DIR="$target" \
        -DCMAKE_BUILD_TYPE="$type"
    run cmake --build "$build" --parallel "$jobs"
    run env CTEST_OUTPUT_ON_FAILURE=1 ctest --test-dir "$build"

    # Installed, and moved: nothing in it may remember where it was.
    run cmake --install "$build" --prefix "$work/first-$native"
    mv "$work/first-$native" "$work/prefix-$native"
    package=$(dirname "$(find "$work/prefix-$native" -name solidmapConfig.cmake)")
    if grep -rn -e "$work" -e "$root" "$package" "$work/prefix-$native/include"; then
        echo "the installed package names folders of this build (see above)" >&2
        exit 1
    fi
    if grep -rnE '#include[^/]*rust|rust::' "$work/prefix-$native/include"; then
        echo "an installed header names Rust (see above)" >&2
        exit 1
    fi
    # Every header by itself; they are the same with and without CGAL and TetGen.
    [ -n "$headers_pass" ] || for standard in 17 20; do
        for header in "$work/prefix-$native"/include/solidmap/*.hpp; do
            case $header in */cgal.hpp | */eigen.hpp) continue ;; esac
            echo "$standard $header"
        done
    done | run xargs -P "$jobs" -L 1 sh -c 'echo "#include \"$2\"" |
        c++ "-std=c++$1" -fsyntax-only -Wall -Wextra -Wpedantic -Werror -I"$0" -x c++ -' "$work/prefix-$native/include"
    headers_pass=yes
    # A program whose vectors have another layout must not link, and be told why.
    archive=$(find "$work/prefix-$native" -name libsolidmap.a)
    printf '#include <solidmap/solidmap.hpp>\nint main() { return solidmap::version().empty(); }\n' >"$work/debug.cpp"
    if c++ -std=c++17 -D_GLIBCXX_DEBUG -I"$work/prefix-$native/include" "$work/debug.cpp" "$archive" -o "$work/debug" \
        >"$work/log" 2>&1 || ! grep -q built_with_libstdcxx_in_debug_mode "$work/log"; then
        cat "$work/log" >&2
        echo "a program in debug mode links, or is not told why it does not (see above)" >&2
        exit 1
    fi
    consumer=$work/consumer-$native
    run cmake -S cpp/tests/consumer -B "$consumer" -DCMAKE_PREFIX_PATH="$work/prefix-$native" -DCMAKE_BUILD_TYPE="$type"
    run cmake --build "$consumer" --parallel "$jobs"
    run env CTEST_OUTPUT_ON_FAILURE=1 ctest --test-dir "$consumer"
    # A version that does not exist must not be found.
    if cmake -S cpp/tests/consumer -B "$work/none" -DCMAKE_PREFIX_PATH="$work/prefix-$native" \
        -DCONSUMER_VERSION=9.0 >"$work/log" 2>&1; then
        echo "find_package accepted version 9.0, which does not exist" >&2
        exit 1
    fi

    sub=$work/subproject-$native
    run cmake -S cpp/tests/subproject -B "$sub" -DSOLIDMAP_NATIVE="$native" -DSOLIDMAP_CARGO_TARGET_DIR="$target"
    run cmake --build "$sub" --parallel "$jobs"
    run env CTEST_OUTPUT_ON_FAILURE=1 ctest --test-dir "$sub"
    echo "unit tests, examples, installed consumer, plug-in, subproject: all pass"
done
