"""The mean value coordinates of solidmap against those of VTK, at the same points.

VTK's `vtkMeanValueCoordinatesInterpolator` has the formulas of Ju, Schaefer & Warren (2005) as they are printed, and
loses digits near the surface: against 40-digit arithmetic it errs by 2e-11 of the diagonal or less down to a distance
of 1e-6 of it, and by up to 1.5e-7 at 1e-7, where it takes a point to be on the triangle. Points almost in the plane of
a far triangle cost it up to 1e-9. Points are therefore held to two bounds.
"""

import argparse
import time
from pathlib import Path

import igl
import numpy as np
from vtkmodules.vtkCommonCore import vtkIdList
from vtkmodules.vtkCommonDataModel import vtkMeanValueCoordinatesInterpolator

from common import Table, diagonal, read_boundary_map, read_images, read_points, run, vtk_points


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("domain", type=Path)
    parser.add_argument("image", type=Path)
    parser.add_argument("folder", type=Path, help="what `solidmap compare --out` wrote")
    parser.add_argument("--bound", type=float, default=1e-8, help="largest difference far from the surface")
    parser.add_argument("--bound-near", type=float, default=1e-6, help="largest difference anywhere")
    parser.add_argument("--near", type=float, default=2e-6, help="what is near, as a fraction of the domain's diagonal")
    options = parser.parse_args()
    run(lambda: check(options))


def check(options):
    vertices, triangles, images = read_boundary_map(options.domain, options.image)
    points = read_points(options.folder)
    ours = read_images(options.folder, "mean_value", points)
    table = Table(
        f"Mean value coordinates of {len(triangles)} triangles at {len(points)} points",
        diagonal(images[np.unique(triangles)]),
    )
    table.require("mean_value.csv is there", ours is not None)
    if ours is None:
        return False

    start = time.perf_counter()
    theirs, reproduced = vtk_mean_values(vertices, triangles, points, [images, vertices])
    wall = time.perf_counter() - start
    distances = np.sqrt(igl.point_mesh_squared_distance(points, vertices, triangles)[0])
    far = distances > options.near * diagonal(vertices)
    table.compare("solidmap - VTK, far from the surface", ours[far], theirs[far], options.bound)
    table.compare("solidmap - VTK, all points", ours, theirs, options.bound_near)
    # Coordinates of this kind reproduce positions, so this is an error of VTK's that needs no second opinion.
    scale = table.diagonal / diagonal(vertices)
    table.compare("VTK's coordinates applied to the domain", reproduced * scale, points * scale)
    table.note(f"VTK: {wall:.3f} s on one core")
    return table.passed


def vtk_mean_values(vertices, triangles, points, values):
    """Each of `values`, lists of a point for every vertex, interpolated at the points."""
    corners = vtkIdList()
    corners.SetNumberOfIds(triangles.size)
    for slot, vertex in enumerate(triangles.ravel().tolist()):
        corners.SetId(slot, vertex)
    positions = vtk_points(vertices)
    row = [0.0] * len(vertices)
    found = [np.empty((len(points), 3)) for _ in values]
    for i, point in enumerate(points.tolist()):
        vtkMeanValueCoordinatesInterpolator.ComputeInterpolationWeights(point, positions, corners, row)
        for interpolated, value in zip(found, values):
            interpolated[i] = row @ value
    return found


if __name__ == "__main__":
    main()
