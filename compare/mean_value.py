"""The mean value coordinates of solidmap against those of VTK, at the same points.

VTK's `vtkMeanValueCoordinatesInterpolator` has the formulas of Ju, Schaefer & Warren (2005) as they are printed, which
lose digits near triangles: one distance h away, in units of the triangle, about 1e-19 / h² and, where it takes a point for
one in the plane of the triangle, h. Points are therefore held to two bounds.
"""

import argparse
import time
from pathlib import Path

import igl
import numpy as np
from vtkmodules.vtkCommonCore import vtkIdList
from vtkmodules.vtkCommonDataModel import vtkMeanValueCoordinatesInterpolator

from common import Table, diagonal, read_boundary_map, read_images, read_points, read_seconds, run, vtk_points


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("domain", type=Path)
    parser.add_argument("image", type=Path)
    parser.add_argument("folder", type=Path, help="what `solidmap compare --out` wrote")
    parser.add_argument("--bound", type=float, default=1e-9, help="largest difference far from the surface")
    parser.add_argument("--bound-near", type=float, default=1e-6, help="largest difference anywhere")
    parser.add_argument("--near", type=float, default=1e-4, help="what is near, as a fraction of the domain's diagonal")
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
    weights = vtk_weights(vertices, triangles, points)
    wall = time.perf_counter() - start
    theirs, reproduced = weights @ images, weights @ vertices
    distances = np.sqrt(igl.point_mesh_squared_distance(points, vertices, triangles)[0])
    far = distances > options.near * diagonal(vertices)
    table.compare("solidmap - VTK, far from the surface", ours[far], theirs[far], options.bound)
    table.compare("solidmap - VTK, all points", ours, theirs, options.bound_near)
    # Coordinates of this kind reproduce positions, so this is an error of VTK's that needs no second opinion.
    table.compare("VTK's coordinates applied to the domain", points + (reproduced - points) * table.diagonal /
                  diagonal(vertices), points)
    table.note(f"VTK: {wall:.3f} s on one core")
    seconds = read_seconds(options.folder, "mean_value")
    if seconds is not None:
        table.note(f"solidmap: {sum(seconds.values()):.3f} s")
    return table.passed


def vtk_weights(vertices, triangles, points):
    """Mean value coordinates, points x vertices."""
    corners = vtkIdList()
    corners.SetNumberOfIds(triangles.size)
    for slot, vertex in enumerate(triangles.ravel().tolist()):
        corners.SetId(slot, vertex)
    positions = vtk_points(vertices)
    row = [0.0] * len(vertices)
    weights = np.empty((len(points), len(vertices)))
    for i, point in enumerate(points.tolist()):
        vtkMeanValueCoordinatesInterpolator.ComputeInterpolationWeights(point, positions, corners, row)
        weights[i] = row
    return weights


if __name__ == "__main__":
    main()
