#!/bin/sh
# Installs what the build needs from Debian (12 or later) and is not there yet. Rust comes from https://rustup.rs.
set -eu

missing=""
for package in cmake g++ libcgal-dev libtet1.5-dev libeigen3-dev doctest-dev; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing="$missing $package"
done
if [ -n "$missing" ]; then
    echo "installing from Debian:$missing" >&2
    as_root=""
    [ "$(id -u)" -eq 0 ] || as_root="sudo"
    $as_root apt-get update -qq
    # shellcheck disable=SC2086 # split into words on purpose
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >&2
fi
command -v cargo >/dev/null || {
    echo "cargo is not on the PATH; install Rust 1.89 or later from https://rustup.rs" >&2
    exit 1
}
