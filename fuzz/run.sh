#!/usr/bin/env bash
# Runs the fuzz targets, each for SECONDS (60 by default): fuzz/run.sh [SECONDS [TARGET...]]
# Needs a nightly toolchain and `cargo install cargo-fuzz`. Inputs that fail are written to fuzz/artifacts.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-60}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cargo +nightly fuzz list)

# The seeds of the corpus are written by a test.
SOLIDMAP_SEEDS=$PWD/corpus cargo test --manifest-path ../Cargo.toml --release --no-default-features -p solidmap-cli \
    --test program seeds_for_the_fuzzer -- --ignored
# The targets write each input to a file, so keep these in memory if possible.
scratch=$(mktemp -d -p "$([ -d /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")")
trap 'rm -rf "$scratch"' EXIT
status=0
for target in "${targets[@]}"; do
    dictionary=dictionaries/$target.dict
    case $target in *_file) dictionary=dictionaries/tensor_file.dict ;; esac
    options=(-max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -print_final_stats=1)
    [ ! -f "$dictionary" ] || options+=(-dict="$dictionary")
    TMPDIR=$scratch cargo +nightly fuzz run "$target" -- "${options[@]}" 2>"$scratch/log" || status=1
    executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$scratch/log")
    echo "$target: ${executions:-no} executions$(grep -m1 '^SUMMARY' "$scratch/log" | sed 's/^/, /')"
done
exit $status
