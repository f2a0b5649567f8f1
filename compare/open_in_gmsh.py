"""Opens every .msh and .mesh file of a folder in Gmsh (pip install gmsh).

    python open_in_gmsh.py FOLDER

Prints nodes, elements and their least signed inverse condition number (1 for regular elements). Ends with 1 when a file cannot be opened, has
no triangles, tetrahedra or hexahedra, or has one that Gmsh finds inverted.
"""

import sys
from pathlib import Path

import gmsh

CELLS = {2: "triangles", 4: "tetrahedra", 5: "hexahedra"}


def problems(path):
    """What is wrong with a file as Gmsh sees it, and a line about what it holds: a surface has triangles alone."""
    gmsh.clear()
    try:
        gmsh.open(str(path))
    except Exception as error:
        return [str(error)], ""
    nodes = len(gmsh.model.mesh.getNodes()[0])
    types, tags, _ = gmsh.model.mesh.getElements(3)
    if not len(types):
        types, tags, _ = gmsh.model.mesh.getElements(2)
    counted = [f"{len(own)} {CELLS.get(kind, f'elements of type {kind}')}" for kind, own in zip(types, tags)]
    found = [] if any(kind in CELLS for kind in types) else ["no elements that solidmap writes"]
    qualities = [gmsh.model.mesh.getElementQualities(own, "minSICN") for own in tags]
    least = min((min(quality) for quality in qualities if len(quality)), default=float("nan"))
    if least <= 0:
        found.append("inverted elements")
    return found, f"{nodes} nodes, {', '.join(counted)}, least signed inverse condition number {least:.3g}"


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: python open_in_gmsh.py FOLDER")
    gmsh.initialize(["gmsh", "-v", "1"])
    folder = Path(sys.argv[1]).resolve()
    paths = sorted(path for path in folder.rglob("*") if path.suffix in (".msh", ".mesh"))
    failed = 0
    for path in paths:
        found, what = problems(path)
        failed += bool(found)
        print(f"{'FAILED ' if found else 'ok     '}{path.relative_to(folder)}: {'; '.join(found + [what])}")
    print(f"{len(paths) - failed} of {len(paths)} files opened")
    gmsh.finalize()
    sys.exit(failed > 0 or not paths)


main()
