#!/bin/sh
# Tests the pages of `solidmap view` in Chromium, which is installed where it is missing:
#
#   scripts/test-view.sh [PYTEST ARGUMENT...]
#
# The program is that of cargo's target folder (`cargo test` and `cargo build --release` leave it), or SOLIDMAP_PROGRAM.
set -eu
cd "$(dirname "$0")/.."
program=${SOLIDMAP_PROGRAM:-target/release/solidmap}
[ -x "$program" ] || {
    echo "there is no $program: cargo build --release" >&2
    exit 2
}
command -v "${CHROMIUM:-/usr/bin/chromium}" >/dev/null || {
    as_root=""
    [ "$(id -u)" -eq 0 ] || as_root="sudo"
    $as_root apt-get update -qq
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium >&2
}
environment=${SOLIDMAP_VIEW_ENVIRONMENT:-target/view}
[ -x "$environment/bin/python" ] || {
    python3 -m venv "$environment" || {
        echo "there is no python3 with venv: apt-get install python3-venv" >&2
        exit 2
    }
}
# Playwright drives the browser of the system, and need not bring its own.
"$environment/bin/python" -m pip install --quiet 'playwright>=1.49,<2' 'pytest>=8,<10'
"$environment/bin/python" -m pytest -q -p no:cacheprovider cli/tests/view "$@"
