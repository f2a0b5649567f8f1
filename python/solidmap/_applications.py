"""Sequences, textures and comparisons of methods."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from . import boundary as boundaries
from ._errors import InvalidInputError, InvalidTypeError, SolidmapError
from ._fields import Transferred, by_name, carrier, fields
from ._inputs import CellsLike, PathLike, SurfaceLike
from ._map import Map, _kind
from ._meshes import Surface
from ._progress import Progress, shown
from ._reports import Comparison, MeshMetrics, SequenceReport, TextureReport
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import MapKind, Mesher, MethodOptions, Size


def _frames_in_blocks(frames: Iterable[Any], size: int) -> Iterator[List[Tuple[int, Any]]]:
    block: List[Tuple[int, Any]] = []
    for frame in enumerate(frames):
        block.append(frame)
        if len(block) == size:
            yield block
            block = []
    if block:
        yield block


def _frame(value: Any, reference: native.Surface) -> native.Surface:
    given = inputs.images_or_surface("frame", value, reference)
    if isinstance(given, np.ndarray):
        return native.Surface("frame", given, reference.triangles)
    return given


def sequence(
    reference: Any,
    frames: Iterable[Any],
    *,
    tolerance: float = 1e-3,
    map: MapKind = "harmonic",
    effort: float = 2000.0,
    resolution: int = 48,
    energy_tolerance: float = 0.01,
    lame: Tuple[float, float] = (0.0335, 0.0224),
    own_volume: bool = False,
    close_holes: Optional[int] = None,
    material: Any = None,
    fps: float = 1.0,
    frames_per_block: Optional[int] = None,
    progress: Progress = None,
    **method: Unpack[MethodOptions],
) -> SequenceReport:
    """Measure how far each frame of an animation is deformed, and count the cycles.

    Parameters
    ----------
    reference : surface or tetrahedra
        What frames are compared with.
    frames : iterable of array_like, surfaces or paths
        Positions of the reference's vertices in each frame, ``(n, 3)``, or its mesh with them, in the order of time. They
        are taken block by block, so that a generator need not hold all.
    tolerance : float
        Boundary error to reach over 99 % of the area, as a fraction of each frame's diagonal.
    map : {"harmonic", "bijective"}
        Map that frames are measured of.
    effort : float
        With ``map="bijective"``: iterations for each tetrahedron after which the repair of a frame ends.
    resolution, energy_tolerance, lame
        As for :meth:`Map.energy`.
    own_volume : bool
        Scale each frame to the reference's volume first, so that change of size has no energy.
    close_holes : int, optional
        Close holes of the reference of up to so many edges, in all frames alike.
    material : points, cells or path, optional
        What each frame carries along, with its fields, as for :meth:`Map.transfer`: fibres, a mesh of organs. The report's
        ``material`` has it for each frame.
    fps : float
        Frames per second.
    frames_per_block : int, optional
        Frames that are solved for together: 32, fewer where memory is short.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    **method
        Options of the method, as for :func:`solidmap.fit`.

    Returns
    -------
    SequenceReport
        With a row for each frame, also for those that were skipped, and the cycles.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> frames = [ball.points * [1 + 0.1 * k, 1, 1] for k in range(3)]
    >>> found = solidmap.sequence(ball, frames, resolution=12)
    >>> [round(energy, 4) for energy in found.energies]
    [0.0, 0.0017, 0.0076]
    """
    solid = inputs.solid("reference", reference)
    surface = solid.surface
    if surface is None:
        assert solid.cells is not None
        surface = solid.cells.boundary()
    if not 0.0 < options.number("fps", fps) < float("inf"):
        raise InvalidInputError(f"fps is {fps}, but must be positive")
    of_method, arguments = _sequence_options(
        tolerance=tolerance,
        map=map,
        effort=effort,
        resolution=resolution,
        energy_tolerance=energy_tolerance,
        lame=lame,
        own_volume=own_volume,
        close_holes=close_holes,
        frames_per_block=frames_per_block,
        **method,
    )
    tets = solid.cells if solid.cells is not None and solid.cells.cells.shape[1] == 4 else None
    moving = None if material is None else _material(material)
    rows: List[Dict[str, Any]] = []
    carried: List[Any] = []
    with shown(progress) as callback:
        prepared = native.Sequence(surface, of_method, arguments, tets, callback)
        for block in _frames_in_blocks(frames, prepared.frames_per_block):
            measured, moved = _block(prepared, surface, block, fps, callback, moving)
            rows.extend(measured)
            carried.extend(moved)
    energies = [row["deformation_energy"] for row in rows]
    cycles, no_cycles = prepared.cycles([float("nan") if energy is None else energy for energy in energies])
    allowed = of_method["tolerance"]
    is_met = all(row["boundary_error"] is None or row["boundary_error"]["p99"] <= allowed for row in rows)
    report = SequenceReport(
        {
            **json.loads(prepared.report_json),
            "frames": rows,
            "skipped": sum(row["skipped"] is not None for row in rows),
            "tolerance": allowed,
            "tolerance_met": is_met,
            "cycles": None if cycles is None else json.loads(cycles),
            "no_cycles": no_cycles,
            "warnings": prepared.warnings,
        }
    )
    report.material = None if material is None else carried
    return report


def _sequence_options(
    *,
    tolerance: float,
    map: MapKind,
    effort: float,
    resolution: int,
    energy_tolerance: float,
    lame: Tuple[float, float],
    own_volume: bool,
    close_holes: Optional[int],
    frames_per_block: Optional[int],
    **method: Any,
) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """The options of the method and those of the sequence, for the native module."""
    arguments = {
        "map": options.choice("map", map, ["harmonic", "bijective"]),
        "effort": options.number("effort", effort),
        "resolution": options.count("resolution", resolution),
        "energy_tolerance": options.number("energy_tolerance", energy_tolerance),
        "lame": options.lame(lame),
        "own_volume": options.flag("own_volume", own_volume),
        "close_holes": options.optional(options.count, "close_holes", close_holes),
        "frames_per_block": options.optional(options.count, "frames_per_block", frames_per_block, 1),
    }
    return options.method(method, "sequence", tolerance), arguments


def _material(material: Any) -> Dict[str, Any]:
    points, cells, over_points, over_cells = carrier(material, "material")
    return {
        "points": points,
        "cells": cells,
        "point_fields": fields(over_points, (), (), len(points), "the points of material"),
        "cell_fields": fields(over_cells, (), (), 0 if cells is None else len(cells), "the cells of material"),
    }


_NOT_MEASURED = {
    "deformation_energy": None,
    "harmonic_energy": None,
    "errors": None,
    "deformation_density": None,
    "boundary_error": None,
    "folded_fraction": None,
    "inverted_as_mapped": None,
    "volume": None,
    "skipped": None,
}


def _block(
    prepared: native.Sequence,
    reference: native.Surface,
    block: List[Tuple[int, Any]],
    fps: float,
    callback: Any,
    material: Optional[Dict[str, Any]] = None,
) -> Tuple[List[Dict[str, Any]], List[Optional[Transferred]]]:
    """The rows of frames, and the material in each."""
    rows, surfaces, usable = [], [], []
    moved: List[Optional[Transferred]] = [None] * len(block)
    for index, (frame, value) in enumerate(block):
        file = os.fspath(value) if inputs.is_path(value) else None
        row = {"frame": frame, "time": frame / fps, "file": file, **_NOT_MEASURED}
        try:
            surfaces.append(_frame(value, reference))
            usable.append((index, row))
        except SolidmapError as error:
            row["skipped"] = str(error)
        rows.append(row)
    if usable:
        report, carried = prepared.measure(surfaces, material, callback)
        for (index, row), found, parts in zip(usable, json.loads(report), carried):
            row.update(found)
            if parts is not None and material is not None:
                points, over_points, over_cells = parts
                fields = dict(by_name(over_points)), dict(by_name(over_cells))
                moved[index] = Transferred(points, material["cells"], *fields, None, None)
    return rows, moved


class TextureVolume(NamedTuple):
    """Colours of voxels, as :meth:`Texture.volume` samples them.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        Centre of the first voxel.
    spacing : float
        Side of a voxel.
    rgba : ndarray of uint8, shape (nz, ny, nx, 4)
        8-bit sRGB, and 255 in the solid or 0, with black, outside.
    inside : int
        Voxels in the solid.
    """

    origin: NDArray[np.float64]
    spacing: float
    rgba: NDArray[np.uint8]
    inside: int

    def save(self, path: PathLike) -> None:
        """Write the volume (.vti), the same as the program's, for ParaView."""
        file = inputs.path("path", path)
        if not file.lower().endswith(".vti"):
            raise InvalidInputError(f"path is {file!r}, but must end in .vti")
        native.write_volume(file, self.origin.tolist(), self.spacing, np.ascontiguousarray(self.rgba))

    def to_pyvista(self) -> Any:
        """The voxels as cells of a ``pyvista.ImageData``, with ``rgba``."""
        import pyvista

        size = np.array(self.rgba.shape[2::-1])
        grid = pyvista.ImageData(
            dimensions=size + 1, spacing=[self.spacing] * 3, origin=self.origin - 0.5 * self.spacing
        )
        grid.cell_data["rgba"] = self.rgba.reshape(-1, 4)
        return grid


class Texture:
    """A colour at every point of a solid, on its surface that of the picture.

    Call it on points. :func:`solidmap.texture` makes it.
    """

    def __init__(self) -> None:
        raise InvalidTypeError("textures are made by solidmap.texture or Texture.load")

    _texture: native.Texture
    _report: Optional[TextureReport]

    @classmethod
    def _of(cls, found: native.Texture) -> Texture:
        made = cls.__new__(cls)
        made._texture, made._report = found, None
        return made

    @classmethod
    def load(cls, path: PathLike) -> Texture:
        """Read a texture file, as :meth:`save` and ``solidmap texture --map`` write it."""
        return cls._of(native.Texture.read(inputs.path("path", path)))

    def save(self, path: PathLike) -> None:
        """Write a texture file (.safetensors)."""
        self._texture.write(inputs.path("path", path))

    @property
    def surface(self) -> Surface:
        """The surface whose colours are extended."""
        return Surface._of(self._texture.surface)

    @property
    def report(self) -> TextureReport:
        """How the texture was made, and how well it meets the picture."""
        if self._report is None:
            self._report = TextureReport._read(self._texture.report_json)
        return self._report

    def __call__(
        self, points: ArrayLike, *, through: Optional[Map] = None, map: Optional[MapKind] = None
    ) -> Tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Colours of points in 8-bit sRGB, and whether each has one: black and ``False`` outside of the solid.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            Points of the solid; with ``through``, of the target of that map, each with the colour of its preimage.
        through : Map, optional
            A map whose domain is the solid.
        map : {"harmonic", "bijective"}, optional
            Which map of ``through`` to use.

        Returns
        -------
        colours : ndarray of uint8, shape (..., 3)
        has_colour : ndarray of bool, shape (...)
        """
        array, shape = inputs.points("points", points)
        if through is not None and not isinstance(through, Map):
            raise InvalidTypeError(f"through is of type {type(through).__name__}, but must be a Map")
        colours, has_colour = self._texture.colours(array, None if through is None else through._map, _kind(map))
        return colours.reshape(*shape, 3), has_colour.reshape(shape)

    def volume(
        self,
        *,
        resolution: int = 128,
        through: Optional[Map] = None,
        map: Optional[MapKind] = None,
        progress: Progress = None,
    ) -> TextureVolume:
        """The colours of voxels over the solid's box.

        Parameters
        ----------
        resolution : int
            Voxels along the longest side.
        through : Map, optional
            A map whose domain is the solid: the volume is then that of its target, each voxel with the colour of its
            preimage.
        map : {"harmonic", "bijective"}, optional
            Which map of ``through`` to use.
        progress : bool or callable, optional
            As for :func:`solidmap.check`.

        Returns
        -------
        TextureVolume

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=2)
        >>> made = solidmap.texture(ball, colours=(ball.points + 1) / 2, sources=100)
        >>> made.volume(resolution=8).rgba.shape
        (8, 8, 8, 4)
        """
        if through is not None and not isinstance(through, Map):
            raise InvalidTypeError(f"through is of type {type(through).__name__}, but must be a Map")
        with shown(progress) as callback:
            origin, spacing, rgba, inside = self._texture.volume(
                options.count("resolution", resolution, 1),
                None if through is None else through._map,
                _kind(map),
                callback,
            )
        return TextureVolume(np.array(origin), spacing, rgba, inside)

    def plot(self, *, clip: Any = "y", **options: Any) -> Any:
        """Draw the solid, cut open; see :func:`solidmap.plot.texture`."""
        from . import plot

        return plot.texture(self, clip=clip, **options)

    def __repr__(self) -> str:
        return repr(self.report.fit)

    def __reduce__(self) -> Any:
        return _restored_texture, (boundaries._bytes_of(self._texture.write),)


def _restored_texture(content: bytes) -> Texture:
    return Texture._of(boundaries._read_from(native.Texture.read, content))


def texture(
    surface: SurfaceLike,
    *,
    colours: Optional[ArrayLike] = None,
    coordinates: Optional[ArrayLike] = None,
    image: Any = None,
    checker: Optional[int] = None,
    wrap: str = "repeat",
    uv: bool = False,
    across_seams: bool = False,
    sources: Optional[int] = None,
    tolerance: Optional[float] = None,
    max_sources: Optional[int] = None,
    progress: Progress = None,
) -> Texture:
    """Extend the colours of a surface into the solid.

    Parameters
    ----------
    surface : surface
        Closed. The texture coordinates or colours of an OBJ file are read with it.
    colours : array_like, shape (n, 3), optional
        Red, green and blue of each vertex: sRGB from 0 to 1, or bytes.
    coordinates : array_like, shape (m, 3, 2), optional
        Texture coordinates at the corners of each triangle.
    image : array_like of bytes, shape (h, w, 3), optional
        Picture for the coordinates, its rows from top to bottom.
    checker : int, optional
        Chequered pattern instead, with so many squares along each side.
    wrap : {"repeat", "clamp"}
        Which colour coordinates outside the picture have.
    uv : bool
        Extend the texture coordinates, and look up the picture inside, instead of extending colours.
    across_seams : bool
        With ``uv``: extend coordinates that jump at seams all the same.
    sources : int, optional
        Smallest number of sources (2000).
    tolerance : float, optional
        Add sources until the error of the harmonic part is at most this on 99 % of the surface.
    max_sources : int, optional
        Largest number of sources (100 000).
    progress : bool or callable, optional
        As for :func:`solidmap.check`.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> made = solidmap.texture(ball, colours=(ball.points + 1) / 2, sources=100)
    >>> colours, has_colour = made([[0, 0, 0], [2, 0, 0]])
    >>> colours.shape, has_colour.tolist()
    ((2, 3), [True, False])
    """
    roles: boundaries.Roles = []
    if inputs.is_path(surface):
        file = inputs.path("surface", surface)
        found, own_coordinates, own_colours = native.read_textured_surface(file)
        roles = [("model", file)]
        coordinates = own_coordinates if coordinates is None else coordinates
        is_pictured = image is not None or checker is not None
        colours = own_colours if colours is None and not is_pictured else colours
    else:
        found = inputs.surface("surface", surface).surface
    arguments = {
        "checker": options.optional(options.count, "checker", checker, 1),
        "wrap": options.choice("wrap", wrap, ["repeat", "clamp"]),
        "uv": options.flag("uv", uv),
        "across_seams": options.flag("across_seams", across_seams),
        "sources": options.optional(options.count, "sources", sources),
        "tolerance": options.optional(options.number, "tolerance", tolerance),
        "max_sources": options.optional(options.count, "max_sources", max_sources),
    }
    given = None if coordinates is None else inputs.real_array("coordinates", coordinates)
    triangles = len(found.triangles)
    if given is not None and given.shape != (triangles, 3, 2):
        raise InvalidInputError(f"coordinates has the shape {given.shape}, but must be ({triangles}, 3, 2)")
    pixels = None
    if image is not None:
        pixels = inputs.array_of("image", image)
        if pixels.dtype != np.uint8 or pixels.ndim != 3:
            raise InvalidInputError(
                f"image has the dtype {pixels.dtype} and the shape {pixels.shape}, but must have bytes, (h, w, 3)"
            )
        pixels = np.ascontiguousarray(pixels[..., :3])
    codes = None
    if colours is not None:
        array = inputs.array_of("colours", colours)
        codes = inputs.finite_points("colours", array / 255.0 if array.dtype == np.uint8 else array)
        if codes.size and not (codes.min() >= -1e-3 and codes.max() <= 1.0 + 1e-3):
            raise InvalidInputError("colours must be from 0 to 1, or bytes")
    with shown(progress) as callback:
        return Texture._of(native.texture(found, arguments, roles, given, pixels, codes, callback))


def compare(
    boundary: Union[BoundaryMap, PathLike],
    *,
    methods: Sequence[str] = ("mfs", "fem", "variational", "mean_value"),
    mesh: Optional[CellsLike] = None,
    mesh_size: Optional[float] = None,
    quality: float = 1.414,
    mesher: Mesher = "tetgen",
    tolerance: float = 1e-3,
    resolution: int = 40,
    interior: int = 5000,
    threshold: float = 1e-6,
    seed: int = 1,
    max_tets: int = 5_000_000,
    memory: Optional[Size] = None,
    no_reference: bool = False,
    equal_accuracy: bool = False,
    mesh_study: bool = False,
    frames: Iterable[Any] = (),
    progress: Progress = None,
) -> Comparison:
    """Extend one boundary map by several methods, and measure all maps alike.

    The program's ``compare`` runs each method in a process of its own, and so has their peak memory and a limit on their
    time; here they run one after the other in this process.

    Parameters
    ----------
    boundary : BoundaryMap or path
        The boundary map.
    methods : sequence of {"mfs", "fem", "variational", "mean_value", "bijective"}
        Methods to compare.
    mesh : tetrahedra, optional
        Mesh of the domain for methods that need one; by default it is made.
    mesh_size : float, optional
        Edge length inside, as a fraction of the domain's diagonal.
    quality : float
        TetGen: largest ratio of circumradius to shortest edge.
    mesher : {"tetgen", "cgal"}
        Program that makes the tetrahedra.
    tolerance : float
        Boundary error that ``mfs`` aims at over 99 % of the area.
    resolution : int
        Cells of the integration grid along the longest side of the domain.
    interior : int
        Points inside at which maps are compared.
    threshold : float
        The variational method stops when a step lowers the energy by less than this fraction of it.
    seed : int
        Seed of all random choices.
    max_tets : int
        Largest number of tetrahedra, estimated before they are made.
    memory : int or str, optional
        Limit on the memory of ``mfs``.
    no_reference : bool
        Leave out the reference, a map by ``mfs`` on a finer surface, and the ``interior_difference`` of all maps to it.
    equal_accuracy : bool
        Refine the finite elements until their difference to the reference inside is no larger than that of ``mfs``.
    mesh_study : bool
        Also map on four meshes, and by ``mfs`` with four source distances, to see how much maps depend on these choices.
    frames : iterable of array_like, surfaces or paths
        Images of the domain, as the frames of a sequence: also measure the time that each frame takes.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> boundary = solidmap.BoundaryMap(ball, ball.points * [2, 1, 1])
    >>> found = solidmap.compare(boundary, methods=["mfs", "mean_value"], resolution=8, interior=100)
    >>> [row.name for row in found.methods], found["mfs"].folded_fraction
    (['mfs', 'mean_value'], 0.0)
    >>> found["mfs"].interior_difference["rms"] < 1e-3
    True
    """
    if inputs.is_path(boundary):
        given = native.Boundary.read(inputs.path("boundary", boundary))
    elif isinstance(boundary, BoundaryMap):
        given = boundary._boundary
    else:
        raise InvalidTypeError(f"boundary is of type {type(boundary).__name__}, but must be a BoundaryMap or a path")
    arguments = {
        "methods": [methods] if isinstance(methods, str) else [str(name) for name in methods],
        "mesh_size": options.optional(options.number, "mesh_size", mesh_size),
        "quality": options.number("quality", quality),
        "mesher": options.choice("mesher", mesher, ["tetgen", "cgal"]),
        "tolerance": options.number("tolerance", tolerance),
        "resolution": options.count("resolution", resolution),
        "interior": options.count("interior", interior, 1),
        "threshold": options.number("threshold", threshold),
        "seed": options.count("seed", seed),
        "max_tets": options.count("max_tets", max_tets),
        "memory": options.optional(options.size, "memory", memory),
        "no_reference": options.flag("no_reference", no_reference),
        "equal_accuracy": options.flag("equal_accuracy", equal_accuracy),
        "mesh_study": options.flag("mesh_study", mesh_study),
    }
    if equal_accuracy and (no_reference or "mfs" not in arguments["methods"]):
        raise InvalidInputError(
            "equal_accuracy compares finite elements with mfs: it needs mfs among methods, and a reference"
        )
    own = None if mesh is None else inputs.cells("mesh", mesh)
    images = [_frame(frame, given.domain) for frame in frames]
    with shown(progress) as callback:
        return Comparison._read(native.compare(given, arguments, own, images, callback))


def mesh_metrics(domain: CellsLike, image: CellsLike) -> MeshMetrics:
    """The metrics of VOLMAP's program for the map from one mesh of tetrahedra to another (``solidmap compare --metrics``).

    Parameters
    ----------
    domain, image : tetrahedra
        Meshes of the same tetrahedra in the same order.

    Examples
    --------
    >>> import solidmap
    >>> tet = solidmap.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    >>> found = solidmap.mesh_metrics(tet, (2 * tet.points, tet.cells))
    >>> found.tets, found.inverted
    (1, 0)
    """
    return MeshMetrics._read(native.mesh_metrics(inputs.cells("domain", domain), inputs.cells("image", image)))
