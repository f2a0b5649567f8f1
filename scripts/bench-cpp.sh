#!/bin/sh
# Compares the CPU time of evaluating a map from C++ and from Rust: the same map file and a million points, the two
# programs in turn.
#
#   scripts/bench-cpp.sh MAP [ROUNDS]
#
# Needs a build folder with the tests of the C++ package: BUILD, or `build`.
set -eu
cd "$(dirname "$0")/.."
map=$1
rounds=${2:-5}
build=${BUILD:-build}
[ -x "$build/cpp/tests/solidmap_bench_evaluate" ] || {
    echo "\`$build\` does not hold solidmap_bench_evaluate; build it: cmake -S . -B $build && cmake --build $build" >&2
    exit 2
}
target=${CARGO_TARGET_DIR:-$(pwd)/target}
cargo build --release --no-default-features --features io --example bench_evaluate
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
round=0
while [ "$round" -lt "$rounds" ]; do
    "$build/cpp/tests/solidmap_bench_evaluate" "$map" 1000000 5 >>"$work/cpp"
    "$target/release/examples/bench_evaluate" "$map" 1000000 5 >>"$work/rust"
    round=$((round + 1))
done
for what in evaluate evaluate_with_jacobian; do
    for side in cpp rust; do
        sed "s/.*\"$what\": \([0-9.]*\).*/\1/" "$work/$side" | sort -n |
            awk -v what="$what" -v side="$side" '{ t[NR] = $1 } END {
                printf "%-24s %-5s median %.4f s, min %.4f s\n", what, side, t[int((NR + 1) / 2)], t[1] }'
    done
done
