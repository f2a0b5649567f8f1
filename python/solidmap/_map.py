"""Fitted maps, and factors of domains that serve many of them."""

from __future__ import annotations

import json
import math
import time
from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from . import boundary as boundaries
from ._errors import InvalidInputError, InvalidTypeError, UnsupportedError
from ._inputs import CellsLike, PathLike, SurfaceLike
from ._meshes import CarriedMesh, Mesh, Surface
from ._progress import Progress, shown
from ._reports import (
    BijectiveReport,
    CertificateReport,
    DistortionReport,
    EnergyReport,
    FitReport,
    InverseReport,
    TransferReport,
    WorstPlace,
)
from ._text import Rows, significant, table, two_columns
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import CellKind, MapKind, Method, MethodOptions, Placement, RepairOptions, Size, Up, Via


class Preimages(NamedTuple):
    """Preimages of points of the target, as :meth:`Map.inverse` finds them.

    Attributes
    ----------
    points : ndarray, shape (..., 3)
        The preimages, NaN where there is none.
    status : ndarray of uint8, shape (...)
        :data:`OK`, :data:`FOLDED` (several preimages, or one where the map is inverted), :data:`OUTSIDE` of the target,
        :data:`NOT_FOUND` or :data:`NOT_FINITE`.
    round_trip : ndarray, shape (...)
        The distance from the given point to the preimage's image, over the target's diagonal.
    preimages : ndarray of uint32, shape (...)
        How many preimages were found.
    report : InverseReport
        A summary.
    """

    points: NDArray[np.float64]
    status: NDArray[np.uint8]
    round_trip: NDArray[np.float64]
    preimages: NDArray[np.uint32]
    report: InverseReport


#: Values of :attr:`Preimages.status`.
OK, FOLDED, OUTSIDE, NOT_FOUND, NOT_FINITE = range(5)


class Densities(NamedTuple):
    """Energy densities at points, as :meth:`Map.densities` computes them."""

    harmonic: NDArray[np.float64]
    deformation: NDArray[np.float64]
    det_jacobian: NDArray[np.float64]


class Transferred(NamedTuple):
    """Fields at points of the target, as :meth:`Map.transfer` carries them.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Images of the given points, or the points of ``at``.
    cells : ndarray or None
        Cells between them, as given.
    point_data, cell_data : dict
        The fields, by name.
    status : ndarray of uint8 or None
        With ``at``: what was found for each point, as :attr:`Preimages.status`.
    report : TransferReport
        What was carried, with checks of volumes and distributions.
    """

    points: NDArray[np.float64]
    cells: Optional[NDArray[np.uint32]]
    point_data: Dict[str, NDArray[np.float64]]
    cell_data: Dict[str, NDArray[np.float64]]
    status: Optional[NDArray[np.uint8]]
    report: TransferReport

    def to_mesh(self) -> Mesh:
        """The points, cells and fields as a mesh."""
        if self.cells is None or self.cells.shape[1] == 3:
            raise UnsupportedError("the fields lie on points without cells between them")
        mesh = Mesh(self.points, self.cells)
        mesh.point_data, mesh.cell_data = dict(self.point_data), dict(self.cell_data)
        return mesh

    def to_pyvista(self) -> Any:
        """The same for pyvista: a grid, or points without cells."""
        if self.cells is not None and self.cells.shape[1] != 3:
            return self.to_mesh().to_pyvista()
        import pyvista

        cloud = pyvista.PolyData(self.points)
        for name, values in self.point_data.items():
            cloud.point_data[name] = values
        return cloud


def _kind(value: Optional[str]) -> Optional[str]:
    return None if value is None else options.choice("map", value, ["harmonic", "bijective"])


class Map:
    """A harmonic map of a solid, as :func:`solidmap.fit` makes it, and the one-to-one map that may be stored beside it.

    Call it on points. Where it has both maps, every method uses the one-to-one map unless ``map="harmonic"`` is asked for.

    Examples
    --------
    >>> import numpy as np, solidmap
    >>> ball = solidmap.shapes.sphere(levels=3)
    >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
    >>> bool(np.allclose(f([0.1, 0.2, 0.3]), [0.2, 0.2, 0.3], atol=1e-3))
    True
    """

    #: Whether the fit met its tolerance; ``None`` for a map that was read from a file.
    tolerance_met: Optional[bool]

    def __init__(self) -> None:
        raise InvalidTypeError("maps are made by solidmap.fit, Factor.solve or Map.load")

    @classmethod
    def _of(cls, found: native.Map, tolerance_met: Optional[bool] = None) -> Map:
        made = cls.__new__(cls)
        made._map = found
        made.tolerance_met = tolerance_met
        made._refinement = None
        return made

    _map: native.Map
    _refinement: Optional[Dict[str, Any]]

    @classmethod
    def load(cls, path: PathLike) -> Map:
        """Read a map file, as :meth:`save` and ``solidmap fit`` write it."""
        return cls._of(native.Map.read(inputs.path("path", path)))

    def save(self, path: PathLike) -> None:
        """Write a map file (.safetensors), the same as the program's.

        Examples
        --------
        >>> import os, tempfile, solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> name = os.path.join(tempfile.mkdtemp(), "map.safetensors")
        >>> solidmap.fit(ball, images=ball.points).save(name)
        >>> solidmap.Map.load(name).report.vertices
        162
        """
        self._map.write(inputs.path("path", path))

    def __call__(self, points: ArrayLike, *, map: Optional[MapKind] = None) -> NDArray[np.float64]:
        """Images of points.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            The points; doubles in C order are not copied. Outside of the domain values of the map mean nothing.
        map : {"harmonic", "bijective"}, optional
            Which map to use.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        array, shape = inputs.points("points", points)
        images = self._map.evaluate(array, _kind(map))
        return images if len(shape) == 1 else images.reshape(*shape, 3)

    def jacobian(self, points: ArrayLike, *, map: Optional[MapKind] = None) -> NDArray[np.float64]:
        """Jacobians at points: ``J[..., i, k]`` is the derivative of the ``i``-th coordinate along the ``k``-th.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            The points.
        map : {"harmonic", "bijective"}, optional
            Which map to use.

        Returns
        -------
        ndarray, shape (..., 3, 3)

        Examples
        --------
        >>> import numpy as np, solidmap
        >>> ball = solidmap.shapes.sphere(levels=3)
        >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
        >>> bool(np.allclose(f.jacobian([0, 0, 0]), np.diag([2, 1, 1]), atol=1e-2))
        True
        """
        array, shape = inputs.points("points", points)
        found = self._map.jacobian(array, _kind(map))
        return found if len(shape) == 1 else found.reshape(*shape, 3, 3)

    def inverse(
        self,
        points: ArrayLike,
        *,
        tolerance: float = 1e-10,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> Preimages:
        """Preimages of points of the target.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            Points of the target.
        tolerance : float
            Largest distance from the given point to the preimage's image, as a fraction of the target's diagonal.
        map : {"harmonic", "bijective"}, optional
            Which map to use.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Returns
        -------
        Preimages
            Points (NaN where there is none), and what was found for each.

        Examples
        --------
        >>> import numpy as np, solidmap
        >>> ball = solidmap.shapes.sphere(levels=3)
        >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
        >>> found = f.inverse([[0.4, 0.1, 0.2], [9, 9, 9]])
        >>> found.status.tolist() == [solidmap.OK, solidmap.OUTSIDE]
        True
        >>> bool(np.allclose(f(found.points[0]), [0.4, 0.1, 0.2]))
        True
        """
        array, shape = inputs.points("points", points)
        kind = _kind(map)
        with shown(progress) as callback:
            places, status, round_trip, count, report = self._map.preimages(
                array, options.number("tolerance", tolerance), kind, callback
            )
        return Preimages(
            places.reshape(*shape, 3),
            status.reshape(shape),
            round_trip.reshape(shape),
            count.reshape(shape),
            InverseReport._read(report),
        )

    def energy(
        self,
        *,
        resolution: int = 48,
        energy_tolerance: float = 0.01,
        mesh: Optional[CellsLike] = None,
        no_normalize: bool = False,
        lame: Tuple[float, float] = (0.0335, 0.0224),
        worst: int = 5,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> EnergyReport:
        """The harmonic and the deformation energy of the map, with their distributions.

        Parameters
        ----------
        resolution : int
            Cells of the integration grid along the longest side of the domain; they are divided where densities vary.
        energy_tolerance : float
            Largest error of the energies by integration, as a fraction of them.
        mesh : cells, optional
            Integrate over this mesh of the domain instead, without an estimate of the error.
        no_normalize : bool
            Do not scale both solids to unit volume.
        lame : (float, float)
            Lamé constants of the deformation energy.
        worst : int
            How many of the worst places are listed.
        map : {"harmonic", "bijective"}, optional
            Which map to use.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> energy = solidmap.fit(ball, images=ball.points).energy(resolution=16)
        >>> round(energy.harmonic_energy, 2), energy.folded.get("points")
        (3.0, 0)
        """
        arguments = _energy_arguments(resolution, energy_tolerance, no_normalize, lame, worst)
        over = None if mesh is None else inputs.cells("mesh", mesh)
        with shown(progress) as callback:
            return EnergyReport._read(native.energy(self._map, arguments, over, _kind(map), callback))

    def densities(
        self,
        points: ArrayLike,
        *,
        no_normalize: bool = False,
        lame: Tuple[float, float] = (0.0335, 0.0224),
        map: Optional[MapKind] = None,
    ) -> Densities:
        """Densities of both energies, and the determinant of the Jacobian, at points.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> found = solidmap.fit(ball, images=ball.points).densities([[0, 0, 0]])
        >>> round(float(found.harmonic[0]), 1), round(float(found.det_jacobian[0]), 1)
        (3.0, 1.0)
        """
        array, shape = inputs.points("points", points)
        arguments = _energy_arguments(48, 0.01, no_normalize, lame, 0)
        found = native.energy_densities(self._map, array, arguments, _kind(map))
        return Densities(*(each.reshape(shape) for each in found))

    def distortion(
        self,
        *,
        resolution: int = 48,
        mesh: Optional[CellsLike] = None,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> DistortionReport:
        """Means over the domain of the usual metrics of distortion: conformal, Dirichlet, symmetric Dirichlet, ARAP, MIPS.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> found = solidmap.fit(ball, images=ball.points).distortion(resolution=12)
        >>> round(found.mean["symmetric_dirichlet"], 2)
        6.0
        """
        over = None if mesh is None else inputs.cells("mesh", mesh)
        with shown(progress) as callback:
            return DistortionReport._read(
                native.distortions(self._map, options.count("resolution", resolution), over, _kind(map), callback)
            )

    def certify(
        self,
        *,
        finest: int = 4096,
        max_cells: int = 1_000_000,
        undecided: float = 0.0,
        worst: int = 5,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> CertificateReport:
        """Prove where the map is locally one to one, and where it folds.

        Parameters
        ----------
        finest : int
            Size of the smallest cells: how many along the longest side of the domain.
        max_cells : int
            Largest number of cells.
        undecided : float
            Stop when at most this fraction of the volume is undecided.
        worst : int
            How many of the worst places are listed.
        map : {"harmonic", "bijective"}, optional
            Which map to use; of a bijective one, all tetrahedra and the boundary are checked again.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> proof = solidmap.fit(ball, images=ball.points).certify(undecided=0.1)
        >>> proof.folded["cells"], proof.positive["fraction"] > 0.9
        (0, True)
        """
        numbers = (
            options.count("finest", finest),
            options.count("max_cells", max_cells),
            options.number("undecided", undecided),
            options.count("worst", worst),
        )
        with shown(progress) as callback:
            return CertificateReport._read(native.certificate(self._map, *numbers, _kind(map), callback))

    def remesh(
        self,
        *,
        kind: CellKind = "tet",
        mesh: Optional[CellsLike] = None,
        cells: int = 32,
        cell_size: Optional[float] = None,
        no_repair: bool = False,
        polish: Optional[int] = None,
        worst: int = 5,
        progress: Progress = None,
        **repair: Unpack[RepairOptions],
    ) -> CarriedMesh:
        """Carry a regular mesh of a polycube, or a given mesh, into the target, and repair inverted cells.

        Parameters
        ----------
        kind : {"tet", "hex"}
            Shape of the cells of a regular mesh.
        mesh : cells, optional
            Mesh of the domain to carry instead; without it, the domain has to be a polycube.
        cells : int
            Cells along the longest side of the domain.
        cell_size : float, optional
            Size of the cells, in the units of the domain.
        no_repair : bool
            Leave all nodes where the map puts them.
        polish : int, optional
            Iterations at most of each descent that improves the shapes of cells; given here, a mesh is polished too that
            needs no repair. 200 after a repair by default.
        worst : int
            How many of the worst places are listed.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.
        fix_boundary : bool
            Leave boundary nodes where the boundary map puts them.
        split_stuck : int or "off", optional
            Cells at most that are added where nodes are stuck.
        effort : float
            Iterations for each cell, in the mean, after which the repair ends (2000).
        max_cells : int
            Largest number of cells (20 million).
        memory : int or str, optional
            Limit on the memory, such as ``"4GiB"``.

        Examples
        --------
        >>> import solidmap
        >>> box = solidmap.shapes.cube(1.0, 6)
        >>> f = solidmap.fit(box, images=box.points + 0.1 * box.points[:, ::-1] ** 2)
        >>> hexes = f.remesh(kind="hex", cells=6)
        >>> hexes.kind, hexes.report.valid
        ('hexes', True)
        """
        arguments = options.carried(
            dict(repair),
            "remesh",
            kind=kind,
            cells=cells,
            cell_size=cell_size,
            no_repair=no_repair,
            polish=polish,
            worst=worst,
        )
        given = None if mesh is None else inputs.cells("mesh", mesh)
        with shown(progress) as callback:
            return CarriedMesh._carried(native.carry(self._map, arguments, given, callback))

    def make_bijective(
        self,
        *,
        mesh: Optional[CellsLike] = None,
        tolerance: Optional[float] = None,
        split_stuck: Union[int, str, None] = None,
        effort: float = 2000.0,
        memory: Optional[Size] = None,
        progress: Progress = None,
    ) -> Map:
        """The same map with a one-to-one map beside it that is linear over tetrahedra.

        Parameters
        ----------
        mesh : cells, optional
            Mesh of the domain by tetrahedra; by default TetGen makes one.
        tolerance : float, optional
            Largest distance of the boundary from the boundary map, as a fraction of the target's diagonal (1e-3).
        split_stuck : int or "off", optional
            Cells at most that are added where nodes are stuck.
        effort : float
            Iterations for each cell, in the mean, after which the repair ends.
        memory : int or str, optional
            Limit on the memory.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Raises
        ------
        NumericalError
            If tetrahedra stay inverted, or the boundary of the image meets itself.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
        >>> both = f.make_bijective()  # doctest: +NATIVE
        >>> both.certify().one_to_one  # doctest: +NATIVE
        True
        """
        arguments = {
            "tolerance": options.optional(options.number, "tolerance", tolerance),
            "split_stuck": options.off_or_count("split_stuck", split_stuck),
            "effort": options.number("effort", effort),
            "memory": options.optional(options.size, "memory", memory),
        }
        given = None if mesh is None else inputs.cells("mesh", mesh)
        with shown(progress) as callback:
            found, refinement = native.with_bijective(self._map, arguments, given, callback)
        made = Map._of(found, self.tolerance_met)
        made._refinement = json.loads(refinement)
        return made

    def transfer(
        self,
        field: Any = None,
        *,
        fields: Optional[Dict[str, ArrayLike]] = None,
        cell_fields: Optional[Dict[str, ArrayLike]] = None,
        at: Optional[ArrayLike] = None,
        label: Sequence[str] = (),
        plain_vectors: Union[bool, Sequence[str]] = (),
        distance: bool = False,
        resolution: int = 48,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> Transferred:
        """Carry fields from the domain to the target: scalars, vectors, labels, the distance field.

        Parameters
        ----------
        field : points, cells or path, optional
            What carries the fields: ``(n, 3)`` points, ``(points, cells)``, a mesh of pyvista or meshio with its data, a
            :class:`Mesh` with its data, or a file. Left out with ``distance``: a mesh of the domain is made then.
        fields, cell_fields : dict of arrays, optional
            More fields over the points and the cells, by name.
        at : array_like, shape (k, 3), optional
            Points of the target at which fields are evaluated, instead of at the images of the given points.
        label : sequence of names
            Fields whose values are labels, which are never averaged.
        plain_vectors : bool or sequence of names
            Fields of three components to carry as they are, ``True`` for all; others are pushed forward by the Jacobian.
        distance : bool
            Add the distance from the domain's boundary as the field ``distance``.
        resolution : int
            Cells of the grid on which volumes and distributions are checked.
        map : {"harmonic", "bijective"}, optional
            Which map to use.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Examples
        --------
        >>> import numpy as np, solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> f = solidmap.fit(ball, images=ball.points * 2)
        >>> carried = f.transfer(np.zeros((1, 3)), fields={"v": [[1.0, 0, 0]], "t": [7.0]})
        >>> bool(np.allclose(carried.point_data["v"], [[2, 0, 0]], atol=0.01)), carried.point_data["t"].tolist()
        (True, [7.0])
        """
        points, cells, over_points, over_cells = _carrier(field)
        over_points.update({name: np.asarray(values) for name, values in (fields or {}).items()})
        over_cells.update({name: np.asarray(values) for name, values in (cell_fields or {}).items()})
        if points is None and not distance:
            raise InvalidInputError("field is missing; it may only be left out with distance=True")
        names = [*over_points, *over_cells]
        wanted = [*label, *([] if isinstance(plain_vectors, bool) else plain_vectors)]
        for name in wanted:
            if name not in names:
                raise InvalidInputError(f"there is no field {name!r}; the fields are {names}")
        if not names and not distance:
            raise InvalidInputError("there are no fields to carry; give them as fields=, or ask for distance=True")
        arguments = {
            "points": points,
            "cells": cells,
            "point_fields": _fields(over_points, label, plain_vectors, 0 if points is None else len(points), "fields"),
            "cell_fields": _fields(over_cells, label, plain_vectors, 0 if cells is None else len(cells), "cell_fields"),
            "at": None if at is None else inputs.rows_of_points("at", at),
            "distance": options.flag("distance", distance),
            "resolution": options.count("resolution", resolution),
        }
        with shown(progress) as callback:
            images, found, point_data, cell_data, status, report = native.transfer(
                self._map, arguments, _kind(map), callback
            )
        return Transferred(
            images, found, _by_name(point_data), _by_name(cell_data), status, TransferReport._read(report)
        )

    def worst_places(self, worst: int = 5) -> List[WorstPlace]:
        """Where the boundary error is largest."""
        return [WorstPlace(place) for place in json.loads(self._map.worst_places(options.count("worst", worst)))]

    @property
    def report(self) -> FitReport:
        """How the map was made and how good it is."""
        found = self._map.report_json
        if found is None:
            raise UnsupportedError("the map's file has no report of a fit: another program wrote it")
        return FitReport._read(found)

    @property
    def bijective(self) -> Optional[BijectiveReport]:
        """How the one-to-one map was made, where there is one."""
        found = self._map.bijective_json
        if found is None:
            return None
        return BijectiveReport({**json.loads(found), "refinement": self._refinement})

    @property
    def bijective_tets(self) -> Tuple[Mesh, Mesh]:
        """The tetrahedra of the one-to-one map, in the domain and in the target."""
        domain, target = self._map.bijective_tets()
        return Mesh._of(domain), Mesh._of(target)

    @property
    def boundary(self) -> BoundaryMap:
        """The boundary map that was fitted."""
        return BoundaryMap._of(self._map.boundary)

    @property
    def domain(self) -> Surface:
        """The boundary of the domain."""
        return self.boundary.domain

    @property
    def target(self) -> Surface:
        """The boundary of the target: the domain's triangles at their images."""
        return self.boundary.target

    @property
    def sources(self) -> NDArray[np.float64]:
        """Positions of the sources, ``(n, 3)``."""
        return self._map.sources

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """Their coefficients, ``(n, 3)``."""
        return self._map.coefficients

    @property
    def affine(self) -> NDArray[np.float64]:
        """The affine part, ``(4, 3)``: rows for the functions 1, x, y, z."""
        return self._map.affine

    @property
    def metadata(self) -> Dict[str, Any]:
        """What the map's file says about it: format, program, report, and the files it was made from."""
        return json.loads(self._map.metadata_json)  # type: ignore[no-any-return]

    def plot(self, **settings: Any) -> Any:
        """Draw domain and target side by side, cut by one plane that is carried through the map.

        See :func:`solidmap.plot.map`.
        """
        from . import plot

        return plot.map(self, **settings)

    def _rows(self) -> Rows:
        if self._map.report_json is None:
            rows: List[Tuple[str, str]] = [("map", f"{len(self.sources)} sources")]
        else:
            rows = list(self.report._rows())
        if self.tolerance_met is not None:
            rows.append(("tolerance", "met" if self.tolerance_met else "missed"))
        found = self.bijective
        return rows if found is None else [*rows, *found._rows()]

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("Map", self._rows())

    def __reduce__(self) -> Any:
        seconds = None if self._map.report_json is None else json.loads(self._map.report_json).get("seconds")
        content = boundaries._bytes_of(self._map.write)
        return _restored, (content, json.dumps(seconds), self.tolerance_met, self._refinement)


def _restored(content: bytes, seconds: str, tolerance_met: Optional[bool], refinement: Any) -> Map:
    made = Map._of(boundaries._read_from(native.Map.read, content, seconds), tolerance_met)
    made._refinement = refinement
    return made


def _energy_arguments(
    resolution: int, energy_tolerance: float, no_normalize: bool, lame: Any, worst: int
) -> Dict[str, Any]:
    return {
        "resolution": options.count("resolution", resolution),
        "energy_tolerance": options.number("energy_tolerance", energy_tolerance),
        "no_normalize": options.flag("no_normalize", no_normalize),
        "lame": options.lame(lame),
        "worst": options.count("worst", worst),
    }


def _by_name(found: List[Tuple[str, int, NDArray[np.float64]]]) -> Dict[str, NDArray[np.float64]]:
    return {name: values if columns == 1 else values.reshape(-1, columns) for name, columns, values in found}


def _carrier(field: Any) -> Tuple[Any, Any, Dict[str, Any], Dict[str, Any]]:
    """Points, cells, and fields over both, of what carries fields."""
    if field is None:
        return None, None, {}, {}
    if inputs.is_path(field):
        points, cells, over_points, over_cells = native.read_fields(inputs.path("field", field))
        if cells is not None and cells.shape[1] == 3:
            cells = None
        return points, cells, dict(_by_name(over_points)), dict(_by_name(over_cells))
    if inputs._is_cells(field):
        mesh = inputs.cells("field", field)
        of_points, blocks = getattr(field, "point_data", {}), getattr(field, "cell_data", {})
        of_cells = {}
        for name in blocks.keys():
            values = blocks[name]
            # meshio has a list with an array for each block of cells.
            of_cells[str(name)] = np.concatenate(values) if isinstance(values, list) else np.asarray(values)
        return mesh.points, mesh.cells, {str(k): np.asarray(of_points[k]) for k in of_points.keys()}, of_cells
    if hasattr(field, "points") and hasattr(field, "point_data"):
        data = {str(name): np.asarray(field.point_data[name]) for name in field.point_data.keys()}
        return inputs.rows_of_points("the points of field", field.points), None, data, {}
    return inputs.rows_of_points("field", field), None, {}, {}


#: Names of fields of three components that are not pushed forward as vectors.
_NOT_VECTORS = ("rgb", "color", "colors", "colour", "colours", "normal", "normals")


def _fields(
    given: Dict[str, Any], label: Sequence[str], plain_vectors: Union[bool, Sequence[str]], rows: int, argument: str
) -> List[Tuple[str, int, NDArray[np.float64], str]]:
    found = []
    for name, values in given.items():
        array = inputs.real_array(f"{argument}[{name!r}]", values)
        if array.ndim not in (1, 2) or len(array) != rows:
            raise InvalidInputError(f"{argument}[{name!r}] has the shape {array.shape}, but must have {rows} rows")
        columns = 1 if array.ndim == 1 else array.shape[1]
        is_plain = plain_vectors is True or (not isinstance(plain_vectors, bool) and name in plain_vectors)
        if name in label:
            kind = "label"
        elif columns == 3 and not is_plain and name.lower() not in _NOT_VECTORS:
            kind = "vector"
        else:
            kind = "values"
        found.append((name, columns, np.require(array.ravel(), np.float64, ["C", "A"]), kind))
    return found


def fit(
    surface: Optional[SurfaceLike] = None,
    *,
    images: Any = None,
    boundary: Union[BoundaryMap, PathLike, None] = None,
    target: Optional[SurfaceLike] = None,
    tolerance: float = 1e-3,
    max_error: float = 20.0,
    max_local_error: float = math.inf,
    bijective: bool = False,
    landmarks: Any = None,
    landmarks_weight: Optional[float] = None,
    landmark_curves: Union[PathLike, Sequence[Tuple[Sequence[int], Sequence[int]]]] = (),
    start: Optional[BoundaryMap] = None,
    domain_up: Optional[Up] = None,
    target_up: Optional[Up] = None,
    max_stretched: float = 0.0075,
    via: Via = "targets",
    aligned: bool = False,
    no_improve: bool = False,
    paper: bool = False,
    placement: Optional[Placement] = None,
    alpha: Optional[float] = None,
    offset: Optional[float] = None,
    radius: Optional[float] = None,
    s_ratio: Optional[float] = None,
    c_ratio: Optional[float] = None,
    max_sources: Optional[int] = None,
    max_s_ratio: Optional[float] = None,
    memory: Optional[Size] = None,
    method: Optional[Method] = None,
    truncation: Optional[float] = None,
    no_affine: bool = False,
    no_refine: bool = False,
    held_out: int = 20_000,
    seed: int = 1,
    progress: Progress = None,
    time_limit: Optional[float] = None,
) -> Map:
    """Fit the harmonic map of a solid to a map of its boundary.

    One of ``images``, ``boundary`` and ``target`` says where the boundary goes. Options have the names and defaults of
    ``solidmap fit``.

    Parameters
    ----------
    surface : surface, optional
        The boundary of the solid to map, or a mesh of it by tetrahedra or hexahedra. May be left out with ``boundary``.
    images : array_like, shape (n, 3), surface or path, optional
        The image of every vertex; or the same mesh with its vertices at their images; or a text file with lines
        ``node x y z``.
    boundary : BoundaryMap or path, optional
        A boundary map, which says where every point goes and not only the vertices.
    target : surface or "sphere", optional
        Solid without handles to map onto: the boundary map is made first.
    tolerance : float
        Boundary error to reach over 99 % of the area, as a fraction of the target's diagonal. Sources are added where it
        is larger; if it cannot be reached, the best map is returned, and its ``tolerance_met`` is ``False``.
    max_error : float
        Largest boundary error to reach anywhere, as a multiple of ``tolerance``.
    max_local_error : float
        Largest boundary error to reach anywhere, as a multiple of the spacing of the image's vertices around.
    bijective : bool
        Also make the one-to-one map (:meth:`Map.make_bijective`), over the tetrahedra of ``surface`` if it has any.
    landmarks, landmarks_weight, landmark_curves, start, domain_up, target_up, max_stretched, via, aligned, no_improve
        With ``target``: as for :func:`solidmap.boundary.pair`.
    paper : bool
        Start from the settings of Li et al. 2007.
    placement : {"adaptive", "offset", "sphere"}, optional
        Where the sources are placed.
    alpha, offset, radius : float, optional
        Their distance: over their local spacing; over the domain's diagonal; radius of a sphere over the diagonal.
    s_ratio, c_ratio : float, optional
        Sources, and collocation points, per boundary vertex.
    max_sources : int, optional
        Largest number of sources, refinement included.
    max_s_ratio : float, optional
        Largest number of sources after refinement, per boundary vertex.
    memory : int or str, optional
        Limit on the memory, such as ``"4GiB"``; 9/10 of what is available by default.
    method : {"schwarz", "dense", "svd"}, optional
        Solver of the least-squares system.
    truncation : float, optional
        Dense methods: singular values or pivots below this fraction of the largest count as zero.
    no_affine : bool
        Leave the affine functions out of the basis.
    no_refine : bool
        Do not add sources where the tolerance is missed.
    held_out : int
        Number of boundary points at which the error is measured.
    seed : int
        Seed of all random choices.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    time_limit : float, optional
        Seconds after which the best map so far is returned, once there is one.

    Returns
    -------
    Map

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=3)
    >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
    >>> f.tolerance_met, f.report.boundary_error.p99 < 1e-3
    (True, True)
    """
    method_options: Dict[str, Any] = {name: value for name, value in locals().items() if name in options.METHOD_DEFAULTS}
    arguments = options.method(method_options, "fit", tolerance, max_error, max_local_error)
    pair_options = boundaries._pair_arguments(
        landmarks,
        landmarks_weight,
        landmark_curves,
        domain_up,
        target_up,
        max_stretched,
        via,
        aligned,
        no_improve,
        0,
    )
    limit = options.optional(options.seconds, "time_limit", time_limit)
    given = [name for name, value in (("images", images), ("boundary", boundary), ("target", target)) if value is not None]
    if len(given) != 1:
        raise InvalidInputError(
            f"give one of images, boundary and target, to say where the boundary goes; {' and '.join(given) or 'none'} "
            f"{'are' if len(given) > 1 else 'is'} given"
        )
    onto_sphere = isinstance(target, str) and target == "sphere"
    if given != ["target"] or onto_sphere:
        for name, value in (("landmarks", landmarks), ("start", start), ("domain_up", domain_up)):
            if value is not None:
                raise InvalidInputError(f"{name} says how a solid is mapped to another: it needs target=MODEL")
    if surface is None and boundary is None:
        raise InvalidInputError("surface is missing; it may only be left out with boundary")
    start_of_work = time.perf_counter()
    found, roles = _boundary(
        surface, images, boundary, target, onto_sphere, pair_options, start, progress, limit and 0.5 * limit
    )
    if limit is not None:
        limit = max(0.0, limit - (time.perf_counter() - start_of_work))
    with shown(progress) as callback:
        fitted, is_met = native.fit(found, arguments, roles, callback, limit)
    made = Map._of(fitted, is_met)
    if not options.flag("bijective", bijective):
        return made
    solid = None if surface is None else inputs.solid("surface", surface).cells
    tets = solid if solid is not None and solid.cells.shape[1] == 4 else None
    return made.make_bijective(mesh=tets, memory=memory, progress=progress)


def _boundary(
    surface: Optional[SurfaceLike],
    images: Any,
    boundary: Any,
    target: Any,
    onto_sphere: bool,
    pair_options: Dict[str, Any],
    start: Optional[BoundaryMap],
    progress: Progress,
    limit: Optional[float],
) -> Tuple[native.Boundary, boundaries.Roles]:
    """The boundary map to fit, and the files that it is from, by their roles."""
    if boundary is not None:
        file = inputs.path("boundary", boundary) if inputs.is_path(boundary) else None
        if file is None and not isinstance(boundary, BoundaryMap):
            raise InvalidTypeError(f"boundary is of type {type(boundary).__name__}, but must be a BoundaryMap or a path")
        found = native.Boundary.read(file) if file is not None else boundary._boundary
        roles: boundaries.Roles = [] if file is None else [("boundary", file)]
        if surface is not None:
            domain = inputs.surface("surface", surface)
            found = found.over(domain.surface)
            roles = roles if domain.path is None else [("domain", domain.path), *roles]
        return found, roles
    if inputs.is_path(surface) and inputs.is_path(images):
        names = (inputs.path("surface", surface), inputs.path("images", images))
        return native.Boundary.read_between(*names), list(zip(("domain", "image"), names))
    domain = inputs.surface("surface", surface)
    roles = [] if domain.path is None else [("domain", domain.path)]
    if images is not None:
        return BoundaryMap(domain.surface, images)._boundary, roles
    if onto_sphere:
        return boundaries._sphere(domain.surface, "balanced", "progressive", roles, progress, limit)._boundary, roles
    onto = inputs.surface("target", target)
    roles = roles if onto.path is None else [*roles, ("target", onto.path)]
    roles.extend(boundaries._files(pair_options))
    made = boundaries._pair(domain.surface, onto.surface, pair_options, start, roles, progress, limit)
    return made._boundary, roles


class Factor:
    """A domain, factored once for any number of boundary maps.

    Parameters
    ----------
    surface : surface
        The boundary of the solid.
    refined_for : array_like or BoundaryMap, optional
        Images of the vertices, or a boundary map, for which sources are added until the tolerance is met.
    tolerance, max_error, max_local_error : float
        As for :func:`solidmap.fit`.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    **method
        Options of the method, as for :func:`solidmap.fit`.

    Examples
    --------
    >>> import numpy as np, solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> factor = solidmap.Factor(ball)
    >>> frames = np.stack([ball.points * [1 + 0.1 * k, 1, 1] for k in range(3)])
    >>> [round(float(f([0.5, 0, 0])[0]), 2) for f in factor.solve_many(frames)]
    [0.5, 0.55, 0.6]
    """

    def __init__(
        self,
        surface: SurfaceLike,
        *,
        refined_for: Any = None,
        tolerance: float = 1e-3,
        max_error: float = 20.0,
        max_local_error: float = math.inf,
        progress: Progress = None,
        **method: Unpack[MethodOptions],
    ) -> None:
        self._settings: Dict[str, Any] = {
            "tolerance": tolerance,
            "max_error": max_error,
            "max_local_error": max_local_error,
            **method,
        }
        arguments = options.method(dict(method), "Factor", tolerance, max_error, max_local_error)
        self._domain = inputs.surface("surface", surface).surface
        self._refined_for = refined_for
        first = None if refined_for is None else self._boundary_map("refined_for", refined_for)
        with shown(progress) as callback:
            self._factor = native.Factor(self._domain, arguments, first, callback)

    def _boundary_map(self, name: str, images: Any) -> native.Boundary:
        if isinstance(images, BoundaryMap):
            return images._boundary
        given = inputs.images_or_surface(name, images, self._domain)
        if isinstance(given, np.ndarray):
            return native.Boundary(self._domain, given)
        return native.Boundary.between(self._domain, given)

    @property
    def domain(self) -> Surface:
        """The domain."""
        return Surface._of(self._domain)

    @property
    def warnings(self) -> List[str]:
        """What is unusual about the domain, and how it was repaired."""
        return self._factor.warnings

    def solve(self, images: Any, *, progress: Progress = None) -> Map:
        """The map for one boundary map: images of the vertices, a surface with the same faces, or a :class:`BoundaryMap`."""
        boundary = self._boundary_map("images", images)
        with shown(progress) as callback:
            return Map._of(*self._factor.solve(boundary, callback))

    def solve_many(self, frames: ArrayLike, *, progress: Progress = None) -> List[Map]:
        """The maps for several frames together, ``(k, n, 3)`` images of the vertices.

        Each kernel value is computed once for all, which takes less time than one after the other, and more memory.
        """
        array = inputs.real_array("frames", frames)
        if array.size == 0:
            return []
        if array.ndim != 3:
            raise InvalidInputError(f"frames has the shape {array.shape}, but must be (k, n, 3)")
        if not np.isfinite(array).all():
            frame = int(np.argmin(np.isfinite(array).all(axis=(1, 2))))
            raise InvalidInputError(f"frames[{frame}] has coordinates that are not finite")
        with shown(progress) as callback:
            return [Map._of(*found) for found in self._factor.solve_many(array, callback)]

    def __repr__(self) -> str:
        domain = self._domain
        rows = [("factor", f"of {len(domain.vertices)} vertices, {len(domain.triangles)} triangles")]
        rows.append(("tolerance", significant(self._settings["tolerance"])))
        return two_columns(rows)

    def __reduce__(self) -> Any:
        # The system is large, and is factored again where it arrives.
        return _restored_factor, (self.domain, self._refined_for, self._settings)


def _restored_factor(domain: Surface, refined_for: Any, settings: Dict[str, Any]) -> Factor:
    return Factor(domain, refined_for=refined_for, **settings)


def memory_estimate(surface: SurfaceLike, **method: Unpack[MethodOptions]) -> int:
    """Bytes that a fit of a domain needs at the start, by an estimate: refinement needs more.

    Parameters
    ----------
    surface : surface
        The boundary of the solid.
    **method
        Options of the method, as for :func:`solidmap.fit`.

    Examples
    --------
    >>> import solidmap
    >>> small, large = solidmap.shapes.sphere(levels=2), solidmap.shapes.sphere(levels=4)
    >>> solidmap.memory_estimate(small) < solidmap.memory_estimate(large)
    True
    """
    arguments = options.method(dict(method), "memory_estimate")
    return native.fit_memory(inputs.surface("surface", surface).surface, arguments)
