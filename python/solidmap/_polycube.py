"""Polycubes, and hexahedra of models by them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from ._errors import InvalidInputError, NumericalError
from ._inputs import PathLike
from ._map import Map
from ._meshes import CarriedMesh, Mesh, Surface
from ._progress import Progress, shown
from ._reports import PolycubeReport, SimplifiedReport, VoxelReport
from ._text import Rows, table, two_columns
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import CellKind, Orient, RepairOptions


class Polycube:
    """A polycube of a model, and the map from its boundary to the model's.

    Attributes
    ----------
    surface, image : Surface
        The polycube, and the same triangles with every vertex where it is on the model. Where it is the model itself that was
        deformed these are its own triangles, some of them split.
    boundary : BoundaryMap
        Where every point of the polycube's surface is on the model's: ``fit(boundary=p.boundary)`` maps the insides.
    tets, image_tets : Mesh or None
        The tetrahedra of the polycube, and those of the model, or the simplified one, that was deformed. Voxels have none.
    labels : ndarray of uint8, shape (m,)
        For each triangle of ``surface`` the direction that it faces along: 0 to 5 for -x, +x, -y, +y, -z, +z.
    report : PolycubeReport or None
        How the model was deformed.
    simplified : SimplifiedReport or None
        The simplified surface, where it is not the model itself that was deformed.
    voxels : VoxelReport or None
        The voxels, where the polycube consists of some.
    """

    def __init__(self, found: native.Polycube) -> None:
        polycube, model = found.surfaces()
        self.surface, self.image = Surface._of(polycube), Surface._of(model)
        self.boundary = BoundaryMap._of(found.boundary())
        self.tets: Optional[Mesh] = None
        self.image_tets: Optional[Mesh] = None
        tets = found.tets()
        if tets is not None:
            self.tets, self.image_tets = (Mesh._of(mesh) for mesh in tets)
        self.labels: NDArray[np.uint8] = found.labels
        report, simplified, voxels = found.report_json, found.simplified_json, found.voxels_json
        self.report = None if report is None else PolycubeReport._read(report)
        self.simplified = None if simplified is None else SimplifiedReport._read(simplified)
        self.voxels = None if voxels is None else VoxelReport._read(voxels)
        self._given_labels = found.given_labels

    def labels_of(self, triangles: ArrayLike) -> NDArray[np.uint8]:
        """The labels of the model's own triangles, for ``polycube(model, labels=...)``: of all parts of each where the model itself
        was deformed, else of the face of the polycube that its middle goes to.

        Parameters
        ----------
        triangles : array_like of integers, shape (k, 3)
            Triangles of the model's surface, by its vertices; of a mesh of tetrahedra by its nodes. Those that are none of
            the boundary have the label 0.

        Returns
        -------
        ndarray of uint8, shape (k,)
        """
        asked = np.sort(inputs.indices("triangles", triangles, (3,)), axis=1)
        known, labels = self._given_labels
        of = dict(zip(map(tuple, np.sort(known, axis=1).tolist()), labels.tolist()))
        return np.array([of.get(tuple(corners), 0) for corners in asked.tolist()], np.uint8)

    def save_labels(self, path: PathLike, triangles: Optional[ArrayLike] = None) -> None:
        """Write labels, one a line, which ``labels=`` and the program take: of ``triangles``, as for :meth:`labels_of`, or of
        those of :attr:`surface`."""
        labels = self.labels if triangles is None else self.labels_of(triangles)
        native.write_labels(inputs.path("path", path), labels)

    def _rows(self) -> Rows:
        parts = (self.report, self.simplified, self.voxels)
        return [row for part in parts if part is not None for row in part._rows()]

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("Polycube", self._rows())


class BestAttempt:
    """How far an attempt at a polycube came: ``best_attempt`` of the :class:`NumericalError` that says that none was found.

    Attributes
    ----------
    polycube, model : Mesh
        The tetrahedra as they were given up, and those of the model. Both have as ``cell_data`` whether a cell is ``bad``
        (inverted, or at a triangle that faces against its direction or passes through another), and the ``label`` of its
        boundary triangle, -1 inside.
    report : PolycubeReport
        What was done.
    places : list of dict
        Connected groups of bad tetrahedra, the largest first.
    """

    def __init__(
        self, polycube: native.Cells, model: native.Cells, fields: List[Tuple[str, NDArray[np.float64]]], report: str
    ) -> None:
        self.polycube: Mesh = Mesh._of(polycube)
        self.model: Mesh = Mesh._of(model)
        for mesh in (self.polycube, self.model):
            mesh.cell_data.update(fields)
        found = json.loads(report)
        self.report = PolycubeReport(found["report"])
        self.places: List[Dict[str, Any]] = found["places"]

    def __repr__(self) -> str:
        return two_columns([*self.report._rows(), ("bad places", str(len(self.places)))])


class Hexmesh:
    """A mesh of a model, and what led to it.

    Attributes
    ----------
    mesh : CarriedMesh
        The mesh, with its ``report`` and the cells in the polycube as ``mesh.domain``.
    map : Map
        The map from the polycube to the model.
    polycube : Polycube
        The polycube.
    """

    def __init__(self, found: native.Hexmesh, max_distance: float) -> None:
        map_, mesh, polycube = found.take()
        self.map = Map._of(map_, found.tolerance_met)
        self.mesh = CarriedMesh._carried(mesh)
        self.polycube = Polycube(polycube)
        self._max_distance = max_distance

    @property
    def valid(self) -> bool:
        """Whether no cell is inverted, the boundary does not pass through itself, and mesh and model are close to each other."""
        report = self.mesh.report
        farthest = max(report.target_to_mesh["max"], report.mesh_to_target["max"])
        return report.valid and farthest <= self._max_distance

    def _rows(self) -> Rows:
        return [*self.polycube._rows(), *self.mesh.report._rows()]

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("Hexmesh", self._rows())


def _model(model: Any) -> Tuple[Optional[native.Surface], Optional[native.Cells], Optional[str]]:
    found = inputs.solid("model", model)
    return found.surface, found.cells, found.path


def polycube(
    model: Any,
    *,
    polycube: str = "auto",
    max_vertices: int = 6000,
    smoothness: float = 0.02,
    features: Optional[float] = None,
    orient: Orient = "given",
    lattice: Optional[float] = None,
    labels: Union[ArrayLike, PathLike, None] = None,
    progress: Progress = None,
) -> Polycube:
    """Make a polycube of a model of any genus, for :func:`solidmap.fit` and :meth:`Map.remesh`.

    Parameters
    ----------
    model : surface or tetrahedra
        Closed surface, which TetGen fills; or a mesh of tetrahedra, which is used as it is.
    polycube : {"auto", "deformed", "voxels"}
        Where the polycube comes from: the model, deformed; or voxels, if one attempt fails (with two handles or more: if all do).
        ``"deformed"`` makes up to five attempts.
    max_vertices : int
        Largest surface that is deformed as it is; one with handles or long sharp edges may have 2.5 times as many vertices. Larger
        ones are simplified first.
    smoothness : float
        How much borders between charts count against directions: 0.005 gives many charts, 0.04 few.
    features : float, optional
        Edges with at least this angle, in degrees, between the normals beside them become edges of the polycube where the directions
        of their sides allow it; ``report.features`` says how many did.
    orient : {"given", "principal", "best"}
        How the model is turned first.
    lattice : float, optional
        Put the planes of the polycube on a lattice with cells of this size.
    labels : array_like of integers, shape (m,), or path, optional
        Use these directions of the model's triangles instead of seeking some: 0 to 5 for -x, +x, -y, +y, -z, +z. The model is
        deformed as it is, in one attempt.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.

    Raises
    ------
    NumericalError
        If no polycube was found; it has a ``best_attempt`` where one came to tetrahedra.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> made = solidmap.polycube(ball)  # doctest: +NATIVE
    >>> made.report.inverted, len(made.labels) == len(made.surface.faces)  # doctest: +NATIVE
    (0, True)
    >>> again = solidmap.polycube(ball, labels=made.labels_of(ball.faces))  # doctest: +NATIVE
    >>> again.report.charts == made.report.charts  # doctest: +NATIVE
    True
    """
    surface, cells, path = _model(model)
    arguments: Dict[str, Any] = {
        "polycube": options.choice("polycube", polycube, ["auto", "deformed", "voxels"]),
        "max_vertices": options.count("max_vertices", max_vertices),
        "smoothness": options.number("smoothness", smoothness),
        "features": options.optional(options.number, "features", features),
        "orient": options.choice("orient", orient, ["given", "principal", "best"]),
        "lattice": options.optional(options.number, "lattice", lattice),
    }
    given = None
    if labels is not None:
        if surface is not None:
            # TetGen keeps all triangles, and the numbers of their vertices.
            triangles = surface.triangles
        else:
            assert cells is not None
            triangles = _boundary_triangles(cells)
        if inputs.is_path(labels):
            labels = native.read_labels(inputs.path("labels", labels), len(triangles))
        numbers = inputs.array_of("labels", labels)
        if numbers.dtype.kind not in "iu" or numbers.shape != (len(triangles),):
            raise InvalidInputError(
                f"labels has the dtype {numbers.dtype} and the shape {numbers.shape}, but must have {len(triangles)} "
                "integers, one for each triangle of the model"
            )
        if numbers.size and not (numbers.min() >= 0 and numbers.max() <= 5):
            raise InvalidInputError("labels must be from 0 to 5, for -x, +x, -y, +y, -z, +z")
        given = (triangles, np.require(numbers, np.uint8, ["C", "A"]))
    roles = [] if path is None else [("model", path)]
    with shown(progress) as callback:
        made, best = native.polycube_of(surface, cells, arguments, roles, given, callback)
    if made is None:
        assert best is not None
        error = NumericalError(best[0])
        error.best_attempt = BestAttempt(*best[1:])
        raise error
    return Polycube(made)


def _boundary_triangles(cells: native.Cells) -> NDArray[np.uint32]:
    """Triangles of the boundary of tetrahedra, by the nodes of these, in the order of :attr:`Mesh.boundary`."""
    boundary, nodes = cells.boundary(), cells.points
    # The boundary keeps the order of the nodes that it has.
    corners = np.unique(cells.cells)
    order = {tuple(point): index for index, point in zip(corners[::-1], nodes[corners[::-1]].tolist())}
    ids = np.array([order[tuple(point)] for point in boundary.vertices.tolist()], np.uint32)
    return ids[boundary.triangles]


def hexmesh(
    model: Any,
    *,
    kind: CellKind = "hex",
    cells: int = 32,
    cell_size: Optional[float] = None,
    polycube: str = "auto",
    smoothness: float = 0.02,
    features: Optional[float] = None,
    orient: Orient = "given",
    tolerance: float = 0.002,
    polish: int = 200,
    max_distance: float = 0.05,
    max_vertices: int = 6000,
    worst: int = 5,
    progress: Progress = None,
    **repair: Unpack[RepairOptions],
) -> Hexmesh:
    """Mesh a model with hexahedra, by a polycube: :func:`polycube`, :func:`fit` and :meth:`Map.remesh` in one.

    Parameters
    ----------
    model : surface or tetrahedra
        Closed surface, or a mesh of tetrahedra. Any genus.
    kind : {"hex", "tet"}
        Shape of the cells.
    cells : int
        Cells along the longest side of the polycube.
    cell_size : float, optional
        Size of the cells in the polycube.
    polycube : {"auto", "deformed", "voxels"}
        As for :func:`polycube`; ``"auto"`` takes voxels, too, if the deformed model leads to no valid mesh, or, with one handle at
        most, if its cells are poor and those by voxels better.
    smoothness, features, orient
        As for :func:`polycube`.
    tolerance : float
        Boundary error of the map over 99 % of the area, as a fraction of the model's diagonal.
    polish : int
        Iterations at most of each descent that improves the shapes of cells.
    max_distance : float
        Farthest that the model may be from the mesh, or the mesh's boundary from the model, as a fraction of the model's diagonal.
    max_vertices : int
        Largest surface that is deformed as it is; one with handles or long sharp edges may have 2.5 times as many vertices. Larger
        ones are simplified first.
    worst : int
        How many of the worst places are listed.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    **repair
        ``fix_boundary``, ``split_stuck``, ``effort``, ``max_cells`` and ``memory``, as for :meth:`Map.remesh`.

    Examples
    --------
    >>> import solidmap
    >>> made = solidmap.hexmesh(solidmap.shapes.sphere(levels=2), cells=6)  # doctest: +NATIVE
    >>> made.valid, made.mesh.kind  # doctest: +NATIVE
    (True, 'hexes')
    """
    surface, tets, path = _model(model)
    carried = options.carried(
        dict(repair),
        "hexmesh",
        kind=kind,
        cells=cells,
        cell_size=cell_size,
        no_repair=False,
        polish=None,
        worst=worst,
    )
    distance = options.number("max_distance", max_distance)
    arguments = {
        "polycube": options.choice("polycube", polycube, ["auto", "deformed", "voxels"]),
        "smoothness": options.number("smoothness", smoothness),
        "features": options.optional(options.number, "features", features),
        "orient": options.choice("orient", orient, ["given", "principal", "best"]),
        "tolerance": options.number("tolerance", tolerance),
        "polish": options.count("polish", polish),
        "max_distance": distance,
        "max_vertices": options.count("max_vertices", max_vertices),
    }
    roles = [] if path is None else [("model", path)]
    with shown(progress) as callback:
        return Hexmesh(native.hexmesh(surface, tets, arguments, carried, roles, callback), distance)
