"""The finite-element map of solidmap against libigl's `harmonic` on the same tetrahedra and boundary values.

Both minimise the same energy over the same piecewise linear maps, so they differ by rounding only. The variational map
descends to that minimum and stops before; how far from it, and how much energy it has left, is printed.
"""

import argparse
import time
from pathlib import Path

import igl
import numpy as np

from common import Table, diagonal, interpolate, read_images, read_points, read_seconds, read_tet_map, run


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what `solidmap compare --out` wrote")
    parser.add_argument("--bound", type=float, default=1e-8, help="largest difference, as a fraction of the diagonal")
    options = parser.parse_args()
    run(lambda: check(options.folder, options.bound))


def check(folder, bound):
    fem = read_tet_map(folder / "fem.vtu")
    fixed = fem.boundary_vertices()
    start = time.perf_counter(), time.process_time()
    image = igl.harmonic(fem.vertices, fem.tets, fixed, fem.image[fixed], 1)
    wall, cpu = time.perf_counter() - start[0], time.process_time() - start[1]

    table = Table(
        f"Harmonic maps on {len(fem.tets)} tets, {len(fem.vertices)} vertices, {len(fixed)} of them fixed",
        diagonal(fem.image[fixed]),
    )
    table.compare("solidmap fem - libigl harmonic, vertices", fem.image, image, bound)
    points = read_points(folder)
    compare_interpolation(table, folder, fem, points, bound)
    energies = {"libigl": fem.energy(image), "fem": fem.energy(fem.image)}

    if (folder / "variational.vtu").is_file():
        variational = read_tet_map(folder / "variational.vtu")
        if np.array_equal(variational.tets, fem.tets) and np.array_equal(variational.vertices, fem.vertices):
            table.compare("solidmap variational - libigl harmonic", variational.image, image)
            energies["variational"] = fem.energy(variational.image)
        else:
            table.note("variational.vtu has other tetrahedra than fem.vtu and is left out")
    for method, energy in energies.items():
        table.note(f"energy of {method:12} {energy:.12g}  ({energy / energies['libigl'] - 1:+.1e})")
    print_times(table, wall, cpu, read_seconds(folder, "fem"))
    return table.passed


def compare_interpolation(table, folder, fem, points, bound):
    """Finding the tetrahedron of a point is code of its own on both sides."""
    images = read_images(folder, "fem", points)
    if images is None:
        return
    by_libigl, found = interpolate(fem, points)
    table.compare("solidmap fem - libigl's interpolation", images[found], by_libigl[found], bound)
    table.require(f"libigl finds {found.sum()} of the {len(points)} points in a tet", found.any())


def print_times(table, libigl, cpu, solidmap):
    table.note(f"libigl assembly and solve: {libigl:.3f} s, of the processors {cpu:.3f} s")
    if solidmap is None:
        table.note("solidmap: the folder has no times.json that names `fem`")
        return
    # Assembling is part of `factor`; meshing and evaluating are not what libigl does here.
    own = solidmap["factor"] + solidmap["solve"]
    table.note(f"solidmap fem, the same: {own:.3f} s, {own / libigl:.2f} of libigl's time")


if __name__ == "__main__":
    main()
