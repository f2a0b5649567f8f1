"""The maps of solidmap against libigl's `harmonic` on tetrahedra that the TetGen of the registries made.

Nothing is shared with solidmap but the boundary map and the points where the maps are compared. The surface is meshed
twice, without new points on it, up to the size of solidmap's own tetrahedra and up to twice that: the difference of the
two is what such meshes err by, and the maps of solidmap may differ by a stated multiple of it.
"""

import argparse
from pathlib import Path

import igl
import numpy as np
import tetgen

from common import BadInput, Table, TetMap, diagonal, interpolate, read_boundary_map, read_images, read_points
from common import read_tet_map, run

HARMONIC = ["fem", "mfs"]
OTHERS = ["variational", "mean_value"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("domain", type=Path)
    parser.add_argument("image", type=Path)
    parser.add_argument("folder", type=Path, help="what `solidmap compare --out` wrote")
    parser.add_argument("--multiple", type=float, default=4.0, help="of the error of the tets, allowed (rms)")
    parser.add_argument("--max-tets", type=int, default=200_000, help="of the finer mesh, about")
    options = parser.parse_args()
    run(lambda: check(options))


def check(options):
    vertices, triangles, images = read_boundary_map(options.domain, options.image)
    points = read_points(options.folder)
    own = read_tet_map(options.folder / "fem.vtu")
    solid = np.abs(igl.volume(own.vertices, own.tets)).sum()
    # TetGen's tetrahedra have half of the largest volume that they may have, in the mean.
    largest = max(solid / len(own.tets), 2 * solid / options.max_tets)
    coarse = harmonic_map(vertices, triangles, images, 8 * largest)
    fine = harmonic_map(vertices, triangles, images, largest)
    (by_coarse, in_coarse), (by_fine, in_fine) = interpolate(coarse, points), interpolate(fine, points)
    known = in_coarse & in_fine
    table = Table(
        f"Maps on TetGen's {len(coarse.tets)} and {len(fine.tets)} tets by libigl; solidmap has {len(own.tets)}",
        diagonal(images[np.unique(triangles)]),
    )
    table.require(f"libigl finds {known.sum()} of the {len(points)} points in a tet of both", known.any())
    own_error = table.compare("libigl on coarse tets - libigl on fine tets", by_coarse[known], by_fine[known])["rms"]
    for method in HARMONIC + OTHERS:
        found = read_images(options.folder, method, points)
        if found is None:
            table.note(f"{method}: no {method}.csv")
            continue
        # A descent ends before it arrives, and mean value coordinates are not harmonic: their rows say by how much.
        bound = options.multiple * own_error if method in HARMONIC else None
        table.compare(f"solidmap {method} - libigl on fine tets", found[known], by_fine[known], bound, by="rms")
    return table.passed


def harmonic_map(vertices, triangles, images, largest_volume):
    """libigl's map on TetGen's mesh of the surface. The vertices of the surface stay the first ones of the mesh."""
    used, compact = np.unique(triangles, return_inverse=True)
    mesher = tetgen.TetGen(vertices[used], compact.reshape(triangles.shape))
    try:
        nodes, tets = mesher.tetrahedralize(
            nobisect=True, minratio=1.414, mindihedral=0.0, fixedvolume=True, maxvolume=largest_volume
        )[:2]
    except RuntimeError as error:
        raise BadInput(f"TetGen cannot mesh the domain: {error}") from error
    fixed = np.arange(len(used))
    if not np.array_equal(nodes[fixed], vertices[used]):
        raise BadInput("TetGen has moved or reordered the vertices of the surface")
    mesh = TetMap(nodes, tets[:, :4].astype(np.int64), np.zeros_like(nodes))
    if len(mesh.boundary_vertices()) != len(used):
        raise BadInput("TetGen has put new vertices on the surface, although it was asked not to")
    mesh.image = igl.harmonic(mesh.vertices, mesh.tets, fixed, images[used], 1)
    return mesh


if __name__ == "__main__":
    main()
