"""Surfaces and meshes of cells, as results and as arguments."""

from __future__ import annotations

import json
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from ._inputs import CellsLike, PathLike, SurfaceLike
from ._options import number
from ._progress import Progress, shown
from ._reports import CellQuality, CellReport, CheckReport, OffsetReport, RemeshReport
from ._text import Rows, significant, table, two_columns


class Surface:
    """A closed triangle mesh.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        Positions of the vertices.
    faces : array_like of integers, shape (m, 3)
        Corners of the triangles, counter-clockwise seen from outside, counted from 0.

    Examples
    --------
    >>> import solidmap
    >>> tetrahedron = solidmap.Surface(
    ...     [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    ... )
    >>> round(tetrahedron.volume, 6)
    0.166667
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self._surface = inputs.surface("the surface", (vertices, faces)).surface
        #: How good the surface is, where :func:`offset_surface` made it.
        self.report: Optional[OffsetReport] = None

    @classmethod
    def _of(cls, surface: native.Surface) -> Surface:
        made = cls.__new__(cls)
        made._surface = surface
        made.report = None
        return made

    @classmethod
    def load(cls, path: PathLike) -> Surface:
        """Read a surface, or the boundary of the cells in a file.

        Parameters
        ----------
        path : path-like
            OBJ, PLY, OFF or STL; or a mesh of cells, as :meth:`Mesh.load` reads it.

        Examples
        --------
        >>> import solidmap, tempfile, os
        >>> name = os.path.join(tempfile.mkdtemp(), "ball.obj")
        >>> solidmap.shapes.sphere(levels=1).save(name)
        >>> solidmap.Surface.load(name).points.shape
        (42, 3)
        """
        return cls._of(native.Surface.read(inputs.path("path", path)))

    @classmethod
    def of(cls, surface: SurfaceLike) -> Surface:
        """Take over whatever stands for a surface: a mesh of trimesh, pyvista or meshio, arrays, or a path.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=1)
        >>> solidmap.Surface.of((ball.points, ball.faces)).area == ball.area
        True
        """
        return cls._of(inputs.surface("surface", surface).surface)

    def save(self, path: PathLike) -> None:
        """Write the surface: .obj, .ply, .off, .stl, .mesh, .msh, .vtk or .vtu."""
        self._surface.write(inputs.path("path", path))

    @property
    def points(self) -> NDArray[np.float64]:
        """Positions of the vertices, ``(n, 3)``; a copy."""
        return self._surface.vertices

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The same as :attr:`points`."""
        return self._surface.vertices

    @property
    def faces(self) -> NDArray[np.uint32]:
        """Corners of the triangles, ``(m, 3)``; a copy."""
        return self._surface.triangles

    @property
    def area(self) -> float:
        """The area."""
        return self._surface.area

    @property
    def volume(self) -> float:
        """The volume that the surface encloses, negative where it faces inward."""
        return self._surface.volume

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box."""
        return self._surface.diagonal

    def to_trimesh(self) -> Any:
        """The surface as a ``trimesh.Trimesh``, with the same vertices in the same order."""
        import trimesh

        return trimesh.Trimesh(self.points, self.faces.astype(np.int64), process=False)

    def to_pyvista(self) -> Any:
        """The surface as a ``pyvista.PolyData``."""
        import pyvista

        faces = self.faces.astype(np.int64)
        return pyvista.PolyData(self.points, np.hstack([np.full((len(faces), 1), 3), faces]).ravel())

    def to_meshio(self) -> Any:
        """The surface as a ``meshio.Mesh``."""
        import meshio

        return meshio.Mesh(self.points, [("triangle", self.faces.astype(np.int64))])

    def _rows(self) -> Rows:
        return [
            ("surface", f"{len(self.points)} vertices, {len(self.faces)} triangles"),
            ("volume", significant(self.volume, 6)),
        ]

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("Surface", self._rows())

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Surface)
            and np.array_equal(self.points, other.points)
            and np.array_equal(self.faces, other.faces)
        )

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> Any:
        return Surface, (self.points, self.faces)


class Mesh:
    """A mesh of tetrahedra or of hexahedra.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Positions of the nodes.
    cells : array_like of integers, shape (m, 4) or (m, 8)
        Corners of the cells, in VTK's order, counted from 0.
    regions : array_like of integers, shape (m,), optional
        A number for each cell; 1 for all by default.

    Examples
    --------
    >>> import solidmap
    >>> mesh = solidmap.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    >>> mesh.kind, round(mesh.volume, 6), len(mesh.inverted)
    ('tets', 0.166667, 0)
    """

    def __init__(self, points: ArrayLike, cells: ArrayLike, regions: Optional[ArrayLike] = None) -> None:
        self._cells = inputs._of_cells("the mesh", points, cells, regions)
        self.point_data: Dict[str, NDArray[Any]] = {}
        self.cell_data: Dict[str, NDArray[Any]] = {}

    @classmethod
    def _of(cls, cells: native.Cells) -> Any:
        made = cls.__new__(cls)
        made._cells = cells
        made.point_data, made.cell_data = {}, {}
        return made

    @classmethod
    def load(cls, path: PathLike) -> Mesh:
        """Read tetrahedra or hexahedra: Medit .mesh, Gmsh .msh, .vtk or .vtu."""
        return Mesh._of(native.Cells.read(inputs.path("path", path)))  # type: ignore[no-any-return]

    @classmethod
    def of(cls, mesh: CellsLike) -> Mesh:
        """Take over whatever stands for cells: a grid of pyvista or meshio, arrays, or a path."""
        return Mesh._of(inputs.cells("mesh", mesh))  # type: ignore[no-any-return]

    def save(self, path: PathLike) -> None:
        """Write the mesh: .mesh, .msh, .vtk or .vtu, with the regions of its cells."""
        self._cells.write(inputs.path("path", path))

    @property
    def points(self) -> NDArray[np.float64]:
        """Positions of the nodes, ``(n, 3)``; a copy."""
        return self._cells.points

    @property
    def cells(self) -> NDArray[np.uint32]:
        """Corners of the cells, ``(m, 4)`` or ``(m, 8)``; a copy."""
        return self._cells.cells

    @property
    def regions(self) -> NDArray[np.int32]:
        """A number for each cell; a copy."""
        return self._cells.regions

    @property
    def kind(self) -> str:
        """``"tets"`` or ``"hexes"``."""
        return "tets" if self.cells.shape[1] == 4 else "hexes"

    @property
    def volume(self) -> float:
        """The volume of all cells."""
        return self._cells.volume

    @property
    def quality(self) -> Optional[CellQuality]:
        """The shape quality of all cells; ``None`` without any."""
        found = json.loads(self._cells.quality())
        return None if found is None else CellQuality(found)

    @property
    def scaled_jacobian(self) -> NDArray[np.float64]:
        """The scaled Jacobian of each cell: 1 at best, 0 or less where it is inverted."""
        return self._cells.scaled_jacobians()

    @property
    def inverted(self) -> NDArray[np.uint32]:
        """The cells that are inverted or flat, decided exactly."""
        return self._cells.inverted()

    @property
    def boundary(self) -> Surface:
        """The surface of the mesh."""
        return Surface._of(self._cells.boundary())

    def check(self) -> CellReport:
        """Examine the cells: inverted and flat ones, hanging nodes, what does not fit together."""
        report, text, _ = self._cells.check(None)
        return CellReport(json.loads(report), text)

    def _data(self) -> Tuple[Dict[str, NDArray[Any]], Dict[str, NDArray[Any]]]:
        regions = self.regions
        more = {"region": regions} if regions.size and (regions != 1).any() else {}
        return self.point_data, {**more, **self.cell_data}

    def to_pyvista(self) -> Any:
        """The mesh as a ``pyvista.UnstructuredGrid``, with its data and its regions."""
        import pyvista

        cells = self.cells.astype(np.int64)
        kind = 10 if cells.shape[1] == 4 else 12
        flat = np.hstack([np.full((len(cells), 1), cells.shape[1]), cells]).ravel()
        grid = pyvista.UnstructuredGrid(flat, np.full(len(cells), kind, np.uint8), self.points)
        for into, data in zip((grid.point_data, grid.cell_data), self._data()):
            for name, values in data.items():
                into[name] = values
        return grid

    def to_meshio(self) -> Any:
        """The mesh as a ``meshio.Mesh``, with its data and its regions."""
        import meshio

        name = "tetra" if self.kind == "tets" else "hexahedron"
        point_data, cell_data = self._data()
        return meshio.Mesh(
            self.points,
            [(name, self.cells.astype(np.int64))],
            point_data=dict(point_data),
            cell_data={key: [values] for key, values in cell_data.items()},
        )

    def plot(self, *, clip: Any = None, by: Optional[str] = "scaled_jacobian", **options: Any) -> Any:
        """Draw the mesh, cut open; see :func:`solidmap.plot.mesh`."""
        from . import plot

        return plot.mesh(self, clip=clip, by=by, **options)

    def _rows(self) -> Rows:
        cells = "tetrahedra" if self.kind == "tets" else "hexahedra"
        rows: List[Tuple[str, str]] = [("mesh", f"{len(self.cells)} {cells}, {len(self.points)} nodes")]
        rows.append(("inverted", str(len(self.inverted))))
        quality = self.quality
        if quality is not None:
            rows.extend(quality._rows())
        return rows

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("Mesh", self._rows())

    def __reduce__(self) -> Any:
        return _restored_mesh, (self.points, self.cells, self.regions, self.point_data, self.cell_data)


def _restored_mesh(points: Any, cells: Any, regions: Any, point_data: Any, cell_data: Any) -> Mesh:
    mesh = Mesh(points, cells, regions)
    mesh.point_data, mesh.cell_data = point_data, cell_data
    return mesh


class CarriedMesh(Mesh):
    """A mesh carried into the target of a map, and repaired.

    Attributes
    ----------
    report : RemeshReport
        What was done, and how good the mesh is.
    domain : Mesh
        The same cells with their nodes in the domain.
    as_mapped : ndarray, shape (n, 3)
        Nodes as the map puts them, before the repair.
    """

    report: RemeshReport
    domain: Mesh
    as_mapped: NDArray[np.float64]

    @classmethod
    def _carried(cls, found: native.CarriedMesh) -> CarriedMesh:
        made: CarriedMesh = cls._of(found.mesh())
        made.report = RemeshReport._read(found.report_json())
        made.domain = Mesh._of(found.domain_mesh())
        made.as_mapped = found.as_mapped()
        return made

    @property
    def determinants(self) -> NDArray[np.float64]:
        """The determinant of each cell's map from the domain."""
        return self.domain._cells.determinants(self.points)

    def _rows(self) -> Rows:
        return self.report._rows()

    def __reduce__(self) -> Any:
        parts = super().__reduce__()[1]
        return _restored_carried, (parts, self.report, self.domain, self.as_mapped)


def _restored_carried(parts: Any, report: RemeshReport, domain: Mesh, as_mapped: Any) -> CarriedMesh:
    plain = _restored_mesh(*parts)
    made: CarriedMesh = CarriedMesh._of(plain._cells)
    made.point_data, made.cell_data = plain.point_data, plain.cell_data
    made.report, made.domain, made.as_mapped = report, domain, as_mapped
    return made


def check(surface: Any, *, progress: Progress = None) -> CheckReport:
    """Say what is wrong with a surface, or with the cells of a mesh, where, and how to repair it.

    Parameters
    ----------
    surface : surface or cells
        ``(vertices, faces)``, a mesh of trimesh, pyvista or meshio, or a path. Vertices that are not finite are among
        what is found, and not refused.
    progress : bool or callable, optional
        ``True`` draws a bar; a callable is given the step, the share that is done or ``None``, and details.

    Returns
    -------
    CheckReport
        With ``solvable``, and ``findings`` that say what, where and what to do. Of a mesh of cells, ``cells`` is the
        report on these, and the rest is about its boundary.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> solidmap.check(ball).solvable
    True
    >>> opened = solidmap.check((ball.points, ball.faces[1:]))
    >>> opened.solvable, opened.findings[0].kind
    (False, 'open_edges')
    """
    file = inputs.path("surface", surface) if inputs.is_path(surface) else None
    if file is not None or inputs._is_cells(surface):
        solid = inputs.solid("surface", surface)
        found, cells = solid.surface, solid.cells
    else:
        found, cells = inputs.surface("surface", surface, finite=False).surface, None
    with shown(progress) as callback:
        of_cells = None if cells is None else cells.check(callback)
        found = cells.boundary() if found is None and cells is not None else found
        assert found is not None
        report, text, _ = found.check(callback)
    data = json.loads(report)
    made = CheckReport(data, text)
    if of_cells is not None:
        made.cells = CellReport(json.loads(of_cells[0]), of_cells[1])
    return made


def signed_distance(surface: SurfaceLike, points: ArrayLike) -> NDArray[np.float64]:
    """The distance of points from a surface, negative inside.

    Parameters
    ----------
    surface : surface
        Closed; it may overlap itself.
    points : array_like, shape (..., 3)
        The points.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> import solidmap
    >>> solidmap.signed_distance(solidmap.shapes.cube(2.0), [[0, 0, 0], [0, 0, 4]]).tolist()
    [-1.0, 3.0]
    """
    found, shape = inputs.points("points", points)
    return inputs.surface("surface", surface).surface.signed_distance(found).reshape(shape)


def tetrahedralise(
    surface: SurfaceLike,
    *,
    mesher: str = "tetgen",
    quality: float = 1.414,
    max_volume: Optional[float] = None,
    memory: Any = None,
    progress: Progress = None,
) -> Mesh:
    """Fill a closed surface with tetrahedra, by TetGen or CGAL.

    Parameters
    ----------
    surface : surface
        Closed, and without self-intersections.
    mesher : {"tetgen", "cgal"}
        TetGen keeps the boundary triangles; CGAL makes its own.
    quality : float
        TetGen: largest ratio of circumradius to shortest edge; 0 for no refinement inside.
    max_volume : float, optional
        Largest volume of a tetrahedron.
    memory : int or str, optional
        Limit on the memory, such as ``"4GiB"``; 9/10 of what is available by default.
    progress : bool or callable, optional
        As for :func:`check`.

    Returns
    -------
    Mesh

    Raises
    ------
    UnsupportedError
        In a build without CGAL and TetGen.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> mesh = solidmap.tetrahedralise(ball)  # doctest: +NATIVE
    >>> abs(mesh.volume / ball.volume - 1) < 1e-9  # doctest: +NATIVE
    True
    """
    arguments = {
        "mesher": options.choice("mesher", mesher, ["tetgen", "cgal"]),
        "quality": number("quality", quality),
        "max_volume": options.optional(number, "max_volume", max_volume),
        "memory": options.optional(options.size, "memory", memory),
    }
    with shown(progress) as callback:
        return Mesh._of(  # type: ignore[no-any-return]
            native.tetrahedralise(inputs.surface("surface", surface).surface, arguments, callback)
        )


def offset_surface(
    surface: SurfaceLike, distance: float, *, relative: bool = False, progress: Progress = None
) -> Surface:
    """The closed surface at a distance around a model, by CGAL.

    Parameters
    ----------
    surface : surface
        Closed; it may intersect itself.
    distance : float
        Distance from the model, in its units.
    relative : bool
        Take the distance as a fraction of the diagonal of the model's bounding box.
    progress : bool or callable, optional
        As for :func:`check`.

    Returns
    -------
    Surface
        With an attribute ``report`` that says how good it is.

    Examples
    --------
    >>> import solidmap
    >>> around = solidmap.offset_surface(solidmap.shapes.cube(1.0), 0.2, relative=True)  # doctest: +NATIVE
    >>> around.report.genus  # doctest: +NATIVE
    0
    """
    found = inputs.surface("surface", surface).surface
    length = number("distance", distance) * (found.diagonal if relative else 1.0)
    with shown(progress) as callback:
        around, report = native.offset_surface(found, length, callback)
    made = Surface._of(around)
    made.report = OffsetReport._read(report)
    return made

