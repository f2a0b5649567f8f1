#!/bin/sh
# Makes docs/gallery.md and its pictures, from the models in the folder that SOLIDMAP_MODELS names:
#
#   scripts/gallery.sh FOLDER [WORK]
#
# FOLDER gets `gallery.md` and `images`; `docs` replaces those of the repository. Maps and reports are left in WORK, where that is
# given, and what is there already is not made again. The program is target/release/solidmap, or SOLIDMAP_PROGRAM; Chromium
# takes the picture of a page.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
[ $# -ge 1 ] || {
    echo "usage: scripts/gallery.sh FOLDER [WORK]" >&2
    exit 2
}
environment=${SOLIDMAP_VIEW_ENVIRONMENT:-$here/target/view}
[ -x "$environment/bin/python" ] || python3 -m venv "$environment"
"$environment/bin/python" -m pip install --quiet 'playwright>=1.49,<2' 'pillow>=10'
exec "$environment/bin/python" "$here/scripts/gallery.py" "$@"
