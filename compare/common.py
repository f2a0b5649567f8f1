"""Reading what `solidmap compare` wrote, and the table that every check prints."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import VTK_TETRA
from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

COULD_NOT_RUN = 2


class BadInput(Exception):
    """What is wrong with an input, where, and what to do."""


@dataclass
class TetMap:
    """A map that is linear over tetrahedra: `vertices` and `image` are n x 3, `tets` m x 4."""

    vertices: np.ndarray
    tets: np.ndarray
    image: np.ndarray

    def boundary_vertices(self):
        """Indices, ascending, of the vertices on faces of one tetrahedron only."""
        return np.unique(igl.boundary_facets(self.tets)[0])

    def without_unused_vertices(self):
        used, tets = np.unique(self.tets, return_inverse=True)
        return TetMap(self.vertices[used], tets.reshape(self.tets.shape), self.image[used])

    def energy(self, image):
        """Harmonic energy of other images of the same vertices: the integral of the squared norm of the Jacobian."""
        return -float(np.sum(image * (igl.cotmatrix(self.vertices, self.tets) @ image)))


def read_tet_map(path):
    """The map in a .vtu file: points of the domain with the point array `image`."""
    grid = _read_grid(path, vtkXMLUnstructuredGridReader())
    image = grid.GetPointData().GetArray("image")
    if image is None or image.GetNumberOfComponents() != 3:
        raise BadInput(f"{path} has no point array `image` with 3 components")
    mesh = TetMap(_points(grid), _tets(grid, path), vtk_to_numpy(image).astype(float))
    return mesh.without_unused_vertices()


def read_surface(path):
    """Vertices and triangles of a closed surface, or of the boundary of a tetrahedral mesh (.mesh, .vtk, .vtu).

    Vertices keep the order and number that they have in the file: files of the same connectivity correspond.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path} does not exist")
    suffix = path.suffix.lower()
    if suffix in (".vtk", ".vtu"):
        reader = vtkXMLUnstructuredGridReader() if suffix == ".vtu" else vtkUnstructuredGridReader()
        grid = _read_grid(path, reader)
        return _points(grid), igl.boundary_facets(_tets(grid, path))[0]
    if suffix == ".mesh":
        vertices, tets, triangles = igl.readMESH(path)
        return vertices, igl.boundary_facets(tets)[0] if len(tets) else triangles
    vertices, triangles = igl.read_triangle_mesh(path)
    if len(triangles) == 0:
        raise BadInput(f"{path} has no triangles that libigl can read; give .obj, .off, .ply, .stl, .mesh or .vtu")
    return vertices, triangles


def read_boundary_map(domain, image):
    """Vertices and triangles of the domain, and the image of every vertex."""
    vertices, triangles = read_surface(domain)
    images, image_triangles = read_surface(image)
    if len(images) != len(vertices) or len(image_triangles) != len(triangles):
        raise BadInput(
            f"{image} has {len(images)} vertices and {len(image_triangles)} triangles, {domain} has {len(vertices)} "
            f"and {len(triangles)}; they must have the same connectivity"
        )
    return vertices, triangles, images


def read_table(path, columns):
    """The columns of a .csv file, n x len(columns); they are found by the names in its first line."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path} does not exist; run `solidmap compare ... --out {path.parent}` first")
    with open(path) as file:
        names = [name.strip() for name in file.readline().split(",")]
        try:
            values = np.loadtxt(file, delimiter=",", ndmin=2)
        except ValueError as error:
            raise BadInput(f"{path} is not a table of numbers: {error}") from None
    if values.size == 0 or values.shape[1] != len(names):
        raise BadInput(f"{path} has no rows of {len(names)} numbers under its first line")
    if missing := [column for column in columns if column not in names]:
        raise BadInput(f"{path} has no column {', '.join(missing)}; its columns are {', '.join(names)}")
    return values[:, [names.index(column) for column in columns]]


def read_images(folder, method, points):
    """The images of `points` under a method of `solidmap compare`; `None` when the folder has none of that method."""
    path = Path(folder) / f"{method}.csv"
    if not path.is_file():
        return None
    table = read_table(path, ["x", "y", "z", "fx", "fy", "fz"])
    if table.shape[0] != len(points) or not np.array_equal(table[:, :3], points):
        raise BadInput(f"the points in {path} are not those in {path.parent / 'points.csv'}")
    return table[:, 3:]


def read_points(folder):
    return read_table(Path(folder) / "points.csv", ["x", "y", "z"])


def read_seconds(folder, method):
    """Seconds by phase that `solidmap compare` took for a method, from times.json; `None` when it does not say."""
    path = Path(folder) / "times.json"
    return json.loads(path.read_text()).get(method) if path.is_file() else None


def interpolate(mesh, points):
    """The map at points of its domain, by libigl, and which of the points are in a tetrahedron."""
    # vtkProbeFilter takes points near a face to be in either of its tetrahedra, and errs by 1e-7 there.
    tree = igl.AABB()
    tree.init(mesh.vertices, mesh.tets)
    tet_of_point = igl.in_element(mesh.vertices, mesh.tets, points, tree)
    found = tet_of_point >= 0
    corners = mesh.tets[tet_of_point[found]]
    positions = [np.ascontiguousarray(mesh.vertices[corners[:, k]]) for k in range(4)]
    weights = igl.barycentric_coordinates(np.ascontiguousarray(points[found]), *positions)
    images = np.full(points.shape, np.nan)
    images[found] = np.einsum("pk,pkx->px", weights, mesh.image[corners])
    return images, found


def diagonal(points):
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def vtk_points(points):
    """The same points in double precision for VTK."""
    array = vtkPoints()
    array.SetDataTypeToDouble()
    array.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=float), deep=True))
    return array


class Table:
    """Differences as fractions of the diagonal of the target's bounding box, against stated bounds."""

    def __init__(self, title, target_diagonal):
        self.diagonal = target_diagonal
        self.passed = True
        print(f"\n{title}; differences are fractions of the target's diagonal, {target_diagonal:.6g}")
        print(f"{'':44} {'points':>8} {'max':>10} {'rms':>10} {'bound':>10}")

    def compare(self, name, a, b, bound=None, by="max"):
        """One row: the differences of two lists of points; checked when there is a bound, on their `by`."""
        lengths = np.linalg.norm(a - b, axis=1) / self.diagonal
        found = {"max": lengths.max(initial=0.0), "rms": float(np.sqrt(np.mean(lengths**2))) if len(lengths) else 0.0}
        said = f"{by} {bound:.0e}" if bound else "-"
        row = f"{name:44} {len(lengths):8} {found['max']:10.2e} {found['rms']:10.2e} {said:>10}"
        # In this form of the comparison NaN fails.
        self._row(row, bound is None or found[by] <= bound)
        return found

    def require(self, claim, holds):
        self._row(claim, holds)

    def note(self, text):
        print(text)

    def _row(self, text, holds):
        self.passed &= bool(holds)
        print(text + ("" if holds else "  FAILED"))


def run(check):
    """Ends the program with 0 when a check passed, 1 when it failed, 2 when it could not run."""
    try:
        passed = check()
    except (BadInput, OSError, RuntimeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(COULD_NOT_RUN)
    sys.exit(0 if passed else 1)


def _read_grid(path, reader):
    if not Path(path).is_file():
        raise BadInput(f"{path} does not exist")
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    if grid is None or grid.GetNumberOfCells() == 0:
        raise BadInput(f"{path} is not an unstructured grid with cells")
    return grid


def _points(grid):
    return vtk_to_numpy(grid.GetPoints().GetData()).astype(float)


def _tets(grid, path):
    types = vtk_to_numpy(grid.GetCellTypesArray())
    if not (types == VTK_TETRA).any():
        raise BadInput(f"{path} has no tetrahedra")
    offsets = vtk_to_numpy(grid.GetCells().GetOffsetsArray())[:-1][types == VTK_TETRA]
    connectivity = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    return connectivity[offsets[:, None] + np.arange(4)].astype(np.int64)
