"""Fitted maps, and what is done with them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _fields as carriers
from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from . import boundary as boundaries
from ._errors import InvalidInputError, InvalidTypeError, UnsupportedError
from ._fields import Transferred
from ._inputs import CellsLike, PathLike
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
from ._text import Rows, table, two_columns
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import CellKind, MapKind, RepairOptions, Size


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
            The points; doubles in C order are not copied. Outside of the domain values of the map mean nothing. Those in a
            Dask array are mapped block by block when the result, a Dask array too, is computed.
        map : {"harmonic", "bijective"}, optional
            Which map to use.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        if not isinstance(points, np.ndarray) and inputs.is_dask_array(points):
            return cast("NDArray[np.float64]", inputs.by_blocks("points", points, self, 0, map=map))
        array, shape = inputs.points("points", points)
        images = self._map.evaluate(array, _kind(map))
        return images if len(shape) == 1 else images.reshape(*shape, 3)

    def jacobian(self, points: ArrayLike, *, map: Optional[MapKind] = None) -> NDArray[np.float64]:
        """Jacobians at points: ``J[..., i, k]`` is the derivative of the ``i``-th coordinate along the ``k``-th.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            The points; a Dask array gives a Dask array.
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
        if not isinstance(points, np.ndarray) and inputs.is_dask_array(points):
            return cast("NDArray[np.float64]", inputs.by_blocks("points", points, self.jacobian, 1, map=map))
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
        vtu: Optional[PathLike] = None,
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
        vtu : path, optional
            Write the densities, and the target's distance field pulled back by the map, cell by cell (.vtu or .vtk).
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
            file = options.optional(inputs.fields_path, "vtu", vtu)
            return EnergyReport._read(native.energy(self._map, arguments, over, _kind(map), file, callback))

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
        cells: bool = False,
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
        cells : bool
            Also keep the cells, as ``mesh`` of the report: hexahedra with ``verdict`` (1 regular, 0 undecided, -1 folded) and
            the bounds as ``cell_data``, to save or :func:`plot <solidmap.plot.certificate>`.
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
        numbers: Tuple[int, int, float, int] = (
            options.count("finest", finest),
            options.count("max_cells", max_cells),
            options.number("undecided", undecided),
            options.count("worst", worst),
        )
        with shown(progress) as callback:
            report, found = native.certificate(
                self._map, *numbers, options.flag("cells", cells), _kind(map), callback
            )
        made = CertificateReport._read(report)
        if found is not None:
            made.mesh = Mesh._of(found[0])
            made.mesh.cell_data.update(found[1])
        return made

    def remesh(
        self,
        *,
        kind: CellKind = "tet",
        mesh: Optional[CellsLike] = None,
        cells: int = 32,
        cell_size: Optional[float] = None,
        keep_boundary_map: bool = False,
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
        keep_boundary_map : bool
            Stay on the boundary map of the map. Otherwise, where a regular mesh cannot be repaired under it, one of less
            distortion is sought, and taken if the mesh is better under it (``report.other_boundary``).
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
            keep_boundary_map=keep_boundary_map,
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
        points, cells, over_points, over_cells = carriers.carrier(field)
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
        rows, cell_rows = (0 if each is None else len(each) for each in (points, cells))
        arguments = {
            "points": points,
            "cells": cells,
            "point_fields": carriers.fields(over_points, label, plain_vectors, rows, "fields"),
            "cell_fields": carriers.fields(over_cells, label, plain_vectors, cell_rows, "cell_fields"),
            "at": None if at is None else inputs.rows_of_points("at", at),
            "distance": options.flag("distance", distance),
            "resolution": options.count("resolution", resolution),
        }
        with shown(progress) as callback:
            images, found, point_data, cell_data, status, report = native.transfer(
                self._map, arguments, _kind(map), callback
            )
        return Transferred(
            images, found, carriers.by_name(point_data), carriers.by_name(cell_data), status, TransferReport._read(report)
        )

    def save_fields(self, path: PathLike, *, map: Optional[MapKind] = None) -> None:
        """Write the domain's surface with the image of each vertex, by the boundary map and by the map, and their distance.

        Parameters
        ----------
        path : path
            The file, .vtu or .vtk, for ParaView.
        map : {"harmonic", "bijective"}, optional
            Which map to use.

        Examples
        --------
        >>> import os, tempfile, solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> name = os.path.join(tempfile.mkdtemp(), "fit.vtu")
        >>> solidmap.fit(ball, images=ball.points).save_fields(name)
        >>> os.path.exists(name)
        True
        """
        self._map.write_fields(inputs.fields_path("path", path), _kind(map))

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
