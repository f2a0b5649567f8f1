"""Runs the commands of the gallery, and writes it: see gallery.sh."""

import glob
import hashlib
import json
import math
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import textwrap

from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[1]
PROGRAM = os.environ.get("SOLIDMAP_PROGRAM", str(ROOT / "target/release/solidmap"))
# Larger pictures are halved.
LARGEST = 700_000
# Names in the commands, and where the models are.
MODELS = {
    "bird_polycube.vtk": "maps/bird_polycube.vtk",
    "bird.vtk": "maps/bird_object.vtk",
    "cube.mesh": "maps/max_planck_cube.mesh",
    "max_planck.mesh": "maps/max_planck_object.mesh",
    "max_planck.obj": "surfaces/max_planck_27k.obj",
    "igea.obj": "surfaces/igea_15k.obj",
    "igea_134k.ply": "surfaces/igea_134k.ply",
    "spot.obj": "surfaces/spot_uv_2k9.obj",
    "kitten.obj": "surfaces/kitten_g1_9k.obj",
    "cup.mesh": "volumes/cup_g1_tet.mesh",
    "cat.obj": "pairs/cat.obj",
    "horse.obj": "pairs/horse.obj",
    "horse_ref.obj": "sequences/horse_poses/horse_ref.obj",
    **{f"horse-{k:02}.obj": f"sequences/horse_poses/horse-{k:02}.obj" for k in range(1, 11)},
}

# What the commands read besides models: made by the functions below, and said in the gallery.
EXTRAS = {"radial.obj": "write_radial", "checker.vtk": "write_checker"}


class Entry:
    """A picture: what it shows, the commands that make it, and a caption from their reports."""

    def __init__(self, picture, title, commands, caption, page=None):
        self.picture, self.title, self.commands, self.caption, self.page = picture, title, commands, caption, page


def e(value):
    """A number with two significant digits."""
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def fitted(report):
    error = report["boundary_error"]
    return (
        f"{report['vertices']} vertices, {report['sources']} sources; boundary error {e(error['rms'])} rms, {e(error['p99'])} over "
        "99 % of the area, as fractions of the target's diagonal"
    )


def distances(fit, carried):
    volume = carried["volume"]
    return f"{fitted(fit)}. {100 * volume['folded_share']:.2g} % of the volume is folded"


def stretched(report):
    after = report["after"] if "after" in report else report["distortion"]
    return f"angle distortion σ₁/σ₂: median {after['angle']['median']:.2f}, 99 % {after['angle']['p99']:.2f}"


def remeshed(mesh):
    return f"{mesh['cells']} {'hexahedra' if mesh['kind'] == 'hexes' else 'tetrahedra'}; scaled Jacobian at least {mesh['min_scaled_jacobian']:.3f}; {mesh['inverted_cells']} inverted"


PAPER = [
    Entry(
        "bird_distance.png",
        "A polycube and a free-form solid: the distance field, on a section of both",
        ["fit bird_polycube.vtk --image bird.vtk -o bird.map", "transfer bird.map --distance -o bird_distance.vtu --png bird_distance.png --up y"],
        lambda fit, carried: f"{distances(fit, carried)}.",
    ),
    Entry(
        "igea_sphere.png",
        "Igea to the sphere: the boundary map",
        ["boundary sphere igea_134k.ply -o igea_sphere.ply --png igea_sphere.png --up y"],
        lambda sphere: f"134 345 vertices; {stretched(sphere)}; one to one by construction.",
    ),
    Entry(
        "igea_sphere_energy.png",
        "Igea to the sphere: the energy densities inside",
        ["fit igea.obj --target sphere -o igea_sphere.map", "energy igea_sphere.map --png igea_sphere_energy.png --axis x --up y"],
        lambda fit, energy: f"{fitted(fit)}. Harmonic energy {energy['harmonic_energy']:.4f} (3 for a rigid motion), deformation energy "
        f"{energy['deformation_energy']:.4f}.",
    ),
    Entry(
        "max_planck_sphere_distance.png",
        "A model to the sphere, with its distance field",
        [
            "fit max_planck.obj --target sphere -o max_planck_sphere.map",
            "transfer max_planck_sphere.map --distance -o sphere_distance.vtu --png max_planck_sphere_distance.png --axis x --up y",
        ],
        lambda fit, carried: f"{distances(fit, carried)}.",
    ),
    Entry(
        "view_sequence.png",
        "A sequence: energies of the frames, and where they are deformed",
        ["sequence horse_ref.obj horse-*.obj -o poses --close-holes --up y --html poses.html"],
        lambda run: (
            f"The page, with the frame of most energy: {len(run['frames'])} frames of {run['vertices']} vertices, energies from "
            f"{min(f['deformation_energy'] for f in run['frames']):.4f} to {max(f['deformation_energy'] for f in run['frames']):.4f}. "
            "[sequence.md](sequence.md) has the sections and the curve as pictures."
        ),
        page=(
            "poses.html",
            "solidmapPage.go(6); document.querySelector('.controls input[type=checkbox]').click()",
        ),
    ),
    Entry(
        "spot_texture.png",
        "A solid texture",
        ["texture spot.obj --checker --png spot_texture.png --up y --position 0.45"],
        lambda texture: f"Colours of the surface extended inside; on the surface they are off by "
        f"{e(texture['surface_error']['rms'])} rms (1 is from black to white) ([texture.md](texture.md)).",
    ),
    Entry(
        "cup_kitten.png",
        "Solids with a handle: a cup and a kitten",
        ["boundary pair cup.mesh kitten.obj -o cup_kitten.ply --boundary cup_kitten.safetensors --png cup_kitten.png --up y"],
        lambda pair: f"5 000 vertices; {stretched(pair)}; one to one by construction.",
    ),
    Entry(
        "cup_kitten_distance.png",
        "The cup's distance field in the kitten",
        [
            "fit cup.mesh --boundary cup_kitten.safetensors -o cup_kitten.map",
            "transfer cup_kitten.map --distance -o cup_distance.vtu --png cup_kitten_distance.png --axis y --up z",
        ],
        lambda fit, carried: f"{distances(fit, carried)}: a thin wall that becomes a thick body folds, and where it does the "
        "section shows one of several preimages.",
    ),
    Entry(
        "igea_comparison.png",
        "Against other methods",
        ["compare igea.obj --image radial.obj --out comparison"],
        lambda compared: "Harmonic energy densities of four maps in one colour scale, and their distances to the reference, rms: "
        + ", ".join(f"{m['name']} {e(m['interior_difference']['rms'])}" for m in compared["methods"])
        + ". `radial.obj` is Igea projected to a sphere from the centre of its box.",
    ),
]

BEYOND = [
    Entry(
        "igea_max_planck_certificate.png",
        "What is proved of a map",
        ["fit igea.obj --target max_planck.obj -o igea_max_planck.map", "certify igea_max_planck.map --png igea_max_planck_certificate.png --axis x --up y"],
        lambda fit, proof: f"Of the volume {100 * proof['positive']['fraction']:.2f} % is proved one to one locally, "
        f"{100 * proof['folded']['fraction']:.2g} % proved folded, {100 * proof['undecided']['fraction']:.2g} % undecided, in {proof['cells']} "
        "cells ([certificate.md](certificate.md)).",
    ),
    Entry(
        "remesh_max_planck.png",
        "Folds repaired",
        ["fit cube.mesh --image max_planck.mesh -o max.map", "remesh max.map --cells 16 --kind hex -o max_hexes.vtu --up y --png remesh_max_planck.png"],
        lambda fit, mesh: f"The cells in the cube, where the map puts them, and after the repair: {remeshed(mesh)} "
        "([remeshing.md](remeshing.md)).",
    ),
    Entry(
        "hexmesh_spot.png",
        "Hexahedra of a model",
        ["hexmesh spot.obj -o spot_hexes.vtu --cells 20 --png hexmesh_spot.png --up y"],
        lambda made: f"{remeshed(made['mesh'])} ([polycubes.md](polycubes.md)).",
    ),
    Entry(
        "cat_horse.png",
        "A boundary map of two models without a given correspondence",
        ["boundary pair cat.obj horse.obj -o cat_horse.ply --png cat_horse.png --up -y"],
        lambda pair: f"8 377 vertices; {stretched(pair)}; one to one by construction ([boundary_maps.md](boundary_maps.md)).",
    ),
    Entry(
        "max_planck_inverse.png",
        "The inverse: every point of the target's section is taken back to the domain",
        [
            "transfer max.map checker.vtk --label checker -o checker_carried.vtu --png max_planck_inverse.png --axis x --up y",
            "eval max.map max_planck.mesh --inverse -o preimages.vtu",
        ],
        lambda carried, inverse: "`checker.vtk` is a checker of 7 × 7 × 7 cubes in the cube; at the nape, where the map folds, two sheets of it overlap. "
        f"Of {inverse['points']} nodes in Max Planck's head {inverse['ok']} have one "
        f"preimage, {inverse['folded']} are in folds, and {inverse['outside']} beside the image of the cube; round trips are exact to "
        f"{e(inverse['round_trip_max'])} of the diagonal ([inverse.md](inverse.md)).",
    ),
]


def write_radial(work):
    lines = (work / "igea.obj").read_text().splitlines()
    points = [list(map(float, line.split()[1:4])) for line in lines if line.startswith("v ")]
    ends = [(min(p[k] for p in points), max(p[k] for p in points)) for k in range(3)]
    centre = [(low + high) / 2 for low, high in ends]
    placed = iter([[(x - c) / math.dist(p, centre) for x, c in zip(p, centre)] for p in points])
    moved = ["v " + " ".join(map(repr, next(placed))) if line.startswith("v ") else line for line in lines]
    (work / "radial.obj").write_text("\n".join(moved) + "\n")


def write_checker(work, cells=63, dice=7):
    """Structured points over the unit cube with 0 and 1 by turns."""
    axis = range(cells + 1)
    rows = [
        " ".join(str((i * dice // (cells + 1) + j * dice // (cells + 1) + k * dice // (cells + 1)) % 2) for i in axis)
        for k in axis for j in axis
    ]
    count, step = cells + 1, 1 / cells
    head = [
        "# vtk DataFile Version 3.0", "checker", "ASCII", "DATASET STRUCTURED_POINTS", f"DIMENSIONS {count} {count} {count}",
        "ORIGIN -0.5 -0.5 -0.5", f"SPACING {step} {step} {step}", f"POINT_DATA {count ** 3}", "SCALARS checker double 1", "LOOKUP_TABLE default",
    ]
    (work / "checker.vtk").write_text("\n".join(head + rows) + "\n")


def run(work, command):
    """The report of a command, which is not run again where it is there."""
    report = work / (hashlib.sha256(command.encode()).hexdigest()[:16] + ".json")
    if not report.exists():
        print(f"solidmap {command}", file=sys.stderr, flush=True)
        words = [name for word in shlex.split(command) for name in (sorted(glob.glob(word, root_dir=work)) if "*" in word else [word])]
        ran = subprocess.run([PROGRAM, *words, "--json"], cwd=work, capture_output=True, text=True)
        # 1: it ran, and a check failed, such as that a map does not fold.
        if ran.returncode not in (0, 1):
            sys.exit(f"solidmap {command}: {ran.stderr}")
        report.write_text(ran.stdout)
    return json.loads(report.read_text())


def photograph(work, entry):
    from playwright.sync_api import sync_playwright

    name, script = entry.page
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=flags)
        page = browser.new_page(viewport={"width": 1280, "height": 860}, color_scheme="light")
        page.goto((work / name).as_uri())
        page.wait_for_selector("body[data-ready=yes]")
        page.evaluate(script)
        page.wait_for_timeout(500)
        page.screenshot(path=work / entry.picture)
        browser.close()


def made(folder, work, entry):
    """Makes an entry; its part of the gallery."""
    reports = [run(work, command) for command in entry.commands]
    if entry.page:
        photograph(work, entry)
    found = work / entry.picture
    if not found.exists():
        found = work / "comparison" / "comparison.png"
    target = folder / "images" / entry.picture
    picture = Image.open(found).convert("RGB")
    if found.stat().st_size > LARGEST:
        picture = picture.resize((picture.width // 2, picture.height // 2), Image.LANCZOS)
    if not target.exists() or Image.open(target).convert("RGB").tobytes() != picture.tobytes():
        picture.save(target, optimize=True)
    commands = "\n".join(f"solidmap {command}" for command in entry.commands)
    caption = textwrap.fill(entry.caption(*reports), 120, break_long_words=False, break_on_hyphens=False)
    return f"### {entry.title}\n\n![{entry.title}](images/{entry.picture})\n\n```sh\n{commands}\n```\n\n{caption}\n"


def main(folder, work):
    models = pathlib.Path(os.environ.get("SOLIDMAP_MODELS") or sys.exit("set SOLIDMAP_MODELS to the folder of the models"))
    (folder / "images").mkdir(parents=True, exist_ok=True)
    work.mkdir(parents=True, exist_ok=True)
    for name, path in MODELS.items():
        if not (models / path).exists():
            sys.exit(f"there is no {models / path}")
        if not (work / name).exists():
            (work / name).symlink_to((models / path).resolve())
    for name, maker in EXTRAS.items():
        if not (work / name).exists():
            globals()[maker](work)
    parts = [HEAD, "## Figures of the paper, with other models\n", *(made(folder, work, entry) for entry in PAPER),
             "## What the paper has not\n", *(made(folder, work, entry) for entry in BEYOND), TAIL]
    (folder / "gallery.md").write_text("\n".join(parts))


HEAD = """# Gallery

Every picture is made by the commands beneath it, and the numbers are from their reports (`--json`). `scripts/gallery.sh` makes
this page again from the models of [results.md](results.md), in the folder that `SOLIDMAP_MODELS` names. Large pictures are halved.
"""

TAIL = """## Pages to look into

`solidmap demo` writes pages of built-in models that a browser opens without a network: `map.html`, both solids to turn, cut and colour, and one to
move into the other; and `hexahedra.html`, a mesh to peel by quality, by depth or by a plane.

The pages of maps, meshes and sequences are in [viewer.md](viewer.md), the curves and sections of sequences in
[sequence.md](sequence.md), the experiments on the placement and the number of sources (figures 3 and 5 of the paper) in
[study.md](study.md).
"""

if __name__ == "__main__":
    given = [pathlib.Path(argument).resolve() for argument in sys.argv[1:]]
    if len(given) == 2:
        main(*given)
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(given[0], pathlib.Path(temporary))
