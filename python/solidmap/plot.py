"""Pictures of maps, meshes, boundary maps, certificates, textures and sequences.

They need the extra ``plot``: pyvista, and matplotlib for curves and histograms.

Each function returns a ``pyvista.Plotter`` that shows itself: call its ``show()``, or its ``screenshot(file)`` with
``off_screen=True``. In notebooks pyvista draws it where it is shown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _solidmap as native
from ._errors import InvalidInputError, UnsupportedError
from ._options import choice, count

if TYPE_CHECKING:
    from ._applications import Texture
    from ._map import Map
    from ._meshes import Mesh
    from ._reports import CertificateReport, SequenceReport
    from .boundary import BoundaryMap

__all__ = ["boundary", "certificate", "histogram", "map", "mesh", "sequence", "texture"]

#: A plane: an axis, an axis and its position from 0 to 1 across the box, or a normal and a point.
Plane = Union[str, Tuple[str, float], Tuple[Sequence[float], Sequence[float]]]

_AXES = "xyz"
_SIDE = "#c9c5b8"


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError:
        raise UnsupportedError("drawing needs pyvista: pip install solidmap[plot]") from None
    return pyvista


def _plane(clip: Plane, bounds: Sequence[float]) -> Tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The normal and a point of a plane."""
    low, high = np.asarray(bounds[::2], float), np.asarray(bounds[1::2], float)
    position = 0.5
    axis: Any = clip
    if not isinstance(clip, str):
        first, second = clip
        if not isinstance(first, str):
            return np.asarray(first, float), np.asarray(second, float)
        axis, position = first, float(second)  # type: ignore[arg-type]
    number = _AXES.index(choice("clip", axis, list(_AXES)))
    if not 0.0 <= position <= 1.0:
        raise InvalidInputError(f"clip has the position {position}, but must have one from 0 to 1")
    normal = np.zeros(3)
    normal[number] = 1.0
    return normal, low + position * (high - low)


def _plotter(shape: Tuple[int, int], off_screen: Optional[bool], size: Optional[Tuple[int, int]]) -> Any:
    settings: Dict[str, Any] = {"shape": shape, "off_screen": off_screen, "border": False}
    if size is not None:
        settings["window_size"] = size
    return _pyvista().Plotter(**settings)


def map(
    f: Map,
    *,
    clip: Plane = "y",
    by: Union[str, ArrayLike, Any] = "energy",
    cells: int = 32,
    log: bool = True,
    cmap: str = "viridis",
    off_screen: Optional[bool] = None,
    window_size: Optional[Tuple[int, int]] = None,
) -> Any:
    """Domain and target side by side, cut by one plane of the domain that is carried through the map.

    Parameters
    ----------
    f : Map
        The map.
    clip : {"x", "y", "z"}, (axis, position), or (normal, point)
        The plane; positions go from 0 to 1 across the domain's box.
    by : {"energy", "det_jacobian"} or callable
        What the cut is coloured by: the density of the harmonic energy, the determinant of the Jacobian, or a function of
        ``(n, 3)`` points of the domain.
    cells : int
        Squares of the cut along the longest side of the domain.
    log : bool
        Colour the energy by its logarithm.
    cmap : str
        The colours.
    off_screen : bool, optional
        Draw without a window.
    window_size : (int, int), optional
        Pixels across and down.

    Returns
    -------
    pyvista.Plotter

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
    >>> picture = f.plot(off_screen=True, cells=8).screenshot(return_img=True)  # doctest: +PLOT
    >>> picture.ndim  # doctest: +PLOT
    3
    """
    pyvista = _pyvista()
    domain, target = f.domain.to_pyvista(), f.target.to_pyvista()
    normal, point = _plane(clip, domain.bounds)
    section = _section(f, domain, normal, point, count("cells", cells, 1))
    if isinstance(by, str):
        densities = f.densities(section.points)
        name = choice("by", by, ["energy", "det_jacobian"])
        values = densities.harmonic if name == "energy" else densities.det_jacobian
        name = {"energy": "harmonic energy density", "det_jacobian": "det J"}[name]
        is_log = log and by == "energy" and bool(values.size and values.min() > 0)
    elif callable(by):
        name, values, is_log = "field", np.asarray(by(section.points)), False
    else:
        raise InvalidInputError(f'by is {by!r}, but must be "energy", "det_jacobian" or a function of points')
    section.point_data[name] = values
    carried = section.copy()
    carried.points = f(section.points)
    finite = values[np.isfinite(values)]
    limits = [float(finite.min()), float(finite.max())] if finite.size else [0.0, 1.0]
    plotter = _plotter((1, 2), off_screen, window_size)
    behind = domain.clip(normal=normal, origin=point, invert=True)
    for column, (title, surface, cut) in enumerate(
        (("domain", behind, section), ("target", _carried_half(behind, f, pyvista), carried))
    ):
        plotter.subplot(0, column)
        plotter.add_text(title, font_size=10)
        if surface.n_points:
            plotter.add_mesh(surface, color=_SIDE, opacity=0.55, smooth_shading=False)
        plotter.add_mesh(cut, scalars=name, clim=limits, log_scale=is_log, cmap=cmap, show_edges=True, lighting=False)
        plotter.camera.focal_point = cut.center
        plotter.camera.position = np.asarray(cut.center) + 3.0 * target.length * (normal + [0.25, -0.35, 0.3])
        plotter.camera.up = (0, 0, 1) if abs(normal[2]) < 0.9 else (0, 1, 0)
        plotter.reset_camera()
    return plotter


def _section(f: Map, domain: Any, normal: NDArray[np.float64], point: NDArray[np.float64], cells: int) -> Any:
    """A grid on the plane, inside of the domain."""
    pyvista = _pyvista()
    step = max(domain.bounds[1::2][k] - domain.bounds[::2][k] for k in range(3)) / cells
    size = 1.05 * domain.length
    squares = max(1, int(np.ceil(size / step)))
    grid = pyvista.Plane(center=point, direction=normal, i_size=size, j_size=size, i_resolution=squares, j_resolution=squares).triangulate()
    distances = f._map.boundary.domain.signed_distance(np.ascontiguousarray(grid.points, np.float64))
    grid.point_data["distance"] = distances
    inside = grid.clip_scalar(scalars="distance", value=0.0)
    if not inside.n_points:
        raise InvalidInputError("clip is a plane that does not meet the domain")
    return inside


def _carried_half(half: Any, f: Map, pyvista: Any) -> Any:
    """A part of the domain's surface, its points at their images."""
    moved = half.copy()
    if moved.n_points:
        moved.points = f(np.ascontiguousarray(half.points, np.float64))
    return moved


def mesh(
    grid: Mesh,
    *,
    clip: Optional[Plane] = None,
    by: Optional[str] = "scaled_jacobian",
    cmap: str = "RdYlBu",
    show_edges: bool = True,
    off_screen: Optional[bool] = None,
    window_size: Optional[Tuple[int, int]] = None,
) -> Any:
    """A mesh, cut open: whole cells behind a plane, coloured by their quality or a field.

    Parameters
    ----------
    grid : Mesh
        The mesh.
    clip : {"x", "y", "z"}, (axis, position), or (normal, point), optional
        The plane.
    by : str, optional
        ``"scaled_jacobian"``, or the name of a field of the mesh's ``point_data`` or ``cell_data``.
    cmap : str
        The colours.
    show_edges : bool
        Draw the edges of cells.
    off_screen, window_size
        As for :func:`map`.

    Returns
    -------
    pyvista.Plotter

    Examples
    --------
    >>> import solidmap
    >>> box = solidmap.shapes.cube(1.0, 4)
    >>> hexes = solidmap.fit(box, images=box.points).remesh(kind="hex", cells=4)
    >>> hexes.plot(clip="x", off_screen=True).screenshot(return_img=True).ndim  # doctest: +PLOT
    3
    """
    drawn = grid.to_pyvista()
    if by == "scaled_jacobian":
        drawn.cell_data[by] = grid.scaled_jacobian
    elif by is not None and by not in drawn.point_data and by not in drawn.cell_data:
        raise InvalidInputError(f'by is {by!r}, but must be "scaled_jacobian" or a field of the mesh')
    limits = [0.0, 1.0] if by == "scaled_jacobian" else None
    settings = {"scalars": by, "clim": limits, "cmap": cmap, "show_edges": show_edges}
    return _cut_open(drawn, clip, off_screen, window_size, settings)


def _cut_open(
    cells: Any,
    clip: Optional[Plane],
    off_screen: Optional[bool],
    window_size: Optional[Tuple[int, int]],
    settings: Dict[str, Any],
) -> Any:
    """Whole cells behind a plane, seen from before it."""
    drawn = cells
    if clip is not None:
        normal, point = _plane(clip, cells.bounds)
        behind = (cells.cell_centers().points - point) @ normal <= 0
        drawn = cells.extract_cells(np.flatnonzero(behind))
    plotter = _plotter((1, 1), off_screen, window_size)
    if not drawn.n_cells:
        raise InvalidInputError("clip leaves no cells to draw")
    plotter.add_mesh(drawn, **settings)
    if clip is not None:
        plotter.camera.focal_point = drawn.center
        plotter.camera.position = np.asarray(drawn.center) + 3.0 * drawn.length * (normal + [0.25, -0.35, 0.3])
        plotter.camera.up = (0, 0, 1) if abs(normal[2]) < 0.9 else (0, 1, 0)
    plotter.reset_camera()
    return plotter


def certificate(
    proof: CertificateReport,
    *,
    clip: Optional[Plane] = "y",
    by: str = "verdict",
    show_edges: bool = True,
    off_screen: Optional[bool] = None,
    window_size: Optional[Tuple[int, int]] = None,
) -> Any:
    """What a certificate proves, cut open: blue where the map is locally one to one, red where it folds, grey undecided.

    Parameters
    ----------
    proof : CertificateReport
        From ``f.certify(cells=True)``.
    clip : {"x", "y", "z"}, (axis, position), or (normal, point), optional
        The plane.
    by : str
        ``"verdict"``, or another field of the certificate's cells, such as ``"sigma_min_bound"``.
    show_edges : bool
        Draw the edges of cells.
    off_screen, window_size
        As for :func:`map`.

    Returns
    -------
    pyvista.Plotter

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> proof = solidmap.fit(ball, images=ball.points).certify(undecided=0.2, cells=True)
    >>> proof.plot(off_screen=True).screenshot(return_img=True).ndim  # doctest: +PLOT
    3
    """
    if proof.mesh is None:
        raise InvalidInputError("the certificate has no cells: ask for certify(cells=True)")
    drawn = proof.mesh.to_pyvista()
    choice("by", by, list(proof.mesh.cell_data))
    settings: Dict[str, Any] = {"scalars": by, "show_edges": show_edges}
    if by == "verdict":
        colours = ["#c0392b", "#b5b5b5", "#3b6ea5"]
        settings.update({"cmap": colours, "clim": [-1.5, 1.5], "n_colors": 3, "lighting": True})
    return _cut_open(drawn, clip, off_screen, window_size, settings)


def texture(
    colours: Texture,
    *,
    clip: Optional[Plane] = "y",
    resolution: int = 64,
    through: Optional[Map] = None,
    off_screen: Optional[bool] = None,
    window_size: Optional[Tuple[int, int]] = None,
) -> Any:
    """A solid with its colours, cut open, as voxels.

    Parameters
    ----------
    colours : Texture
        The texture.
    clip : {"x", "y", "z"}, (axis, position), or (normal, point), optional
        The plane.
    resolution : int
        Voxels along the longest side.
    through : Map, optional
        A map whose domain is the solid, to draw its target instead.
    off_screen, window_size
        As for :func:`map`.

    Returns
    -------
    pyvista.Plotter

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> made = solidmap.texture(ball, colours=(ball.points + 1) / 2, sources=100)
    >>> made.plot(off_screen=True, resolution=16).screenshot(return_img=True).ndim  # doctest: +PLOT
    3
    """
    _pyvista()
    volume = colours.volume(resolution=resolution, through=through)
    voxels = volume.to_pyvista()
    inside = voxels.extract_cells(np.flatnonzero(volume.rgba[..., 3].ravel()))
    if not inside.n_cells:
        raise InvalidInputError(f"resolution is {resolution}, at which no voxel's centre is in the solid")
    inside.cell_data["rgb"] = np.ascontiguousarray(inside.cell_data["rgba"][:, :3])
    settings = {"scalars": "rgb", "rgb": True, "show_edges": False}
    return _cut_open(inside, clip, off_screen, window_size, settings)


def sequence(report: SequenceReport, *, by: str = "deformation_energy", axes: Any = None) -> Any:
    """The energy of the frames of a sequence over time, with its estimated errors, as a curve of matplotlib's.

    Parameters
    ----------
    report : SequenceReport
        From :func:`solidmap.sequence`.
    by : {"deformation_energy", "harmonic_energy"}
        Which energy.
    axes : matplotlib axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib axes

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> found = solidmap.sequence(ball, [ball.points * [1 + 0.1 * k, 1, 1] for k in range(3)], resolution=12)
    >>> found.plot().get_ylabel()  # doctest: +PLOT
    'deformation energy'
    """
    name = choice("by", by, ["deformation_energy", "harmonic_energy"])
    axes = _axes() if axes is None else axes
    times = [row.time for row in report.frames]
    # Frames that were skipped leave a gap.
    energies = np.array([_or_nan(getattr(row, name)) for row in report.frames])
    errors = np.array([_or_nan((row.errors or {}).get(name.split("_")[0])) for row in report.frames])
    axes.plot(times, energies, color="#3b6ea5", marker="o", markersize=3)
    axes.fill_between(times, energies - errors, energies + errors, color="#3b6ea5", alpha=0.25, linewidth=0)
    axes.set_xlabel("time")
    axes.set_ylabel(name.replace("_", " "))
    if report.cycles:
        axes.set_title(f"{report.cycles['count']:.3g} cycles, of {report.cycles['period']:.3g} frames each", fontsize=10)
    return axes


def _or_nan(value: Optional[float]) -> float:
    return float("nan") if value is None else value


def _axes() -> Any:
    """Axes of a new figure."""
    try:
        from matplotlib import figure
    except ImportError:
        raise UnsupportedError("curves and histograms need matplotlib: pip install solidmap[plot]") from None
    return figure.Figure(figsize=(5, 3.2), layout="constrained").subplots()


def boundary(
    b: BoundaryMap,
    *,
    squares: int = 10,
    off_screen: Optional[bool] = None,
    window_size: Optional[Tuple[int, int]] = None,
) -> Any:
    """Domain and target of a boundary map, with one pattern on both.

    The pattern is the domain's position, as colours, broken by a chequerboard in space, so that what corresponds looks alike.

    Parameters
    ----------
    b : BoundaryMap
        The boundary map.
    squares : int
        Cubes of the chequerboard along the longest side of the domain.
    off_screen, window_size
        As for :func:`map`.

    Returns
    -------
    pyvista.Plotter

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> b = solidmap.BoundaryMap(ball, ball.points * [2, 1, 1])
    >>> b.plot(off_screen=True).screenshot(return_img=True).ndim  # doctest: +PLOT
    3
    """
    domain = b._boundary.domain
    # Fine enough that the edges of the pattern do not follow the triangles.
    refined, images = _subdivided(b, domain)
    low, high = refined.min(axis=0), refined.max(axis=0)
    colours = (refined - low) / np.where(high > low, high - low, 1.0)
    step = float((high - low).max()) / count("squares", squares, 1)
    dark = np.floor((refined - low) / step + 1e-9).astype(int).sum(axis=1) % 2
    rgb = (255 * (0.25 + 0.75 * colours) * np.where(dark, 0.72, 1.0)[:, None]).astype(np.uint8)
    plotter = _plotter((1, 2), off_screen, window_size)
    triangles = np.arange(len(refined)).reshape(-1, 3)
    pyvista = _pyvista()
    faces = np.hstack([np.full((len(triangles), 1), 3), triangles]).ravel()
    for column, (title, points) in enumerate((("domain", refined), ("target", images))):
        surface = pyvista.PolyData(points, faces)
        # A colour for each triangle: that of its middle.
        surface.cell_data["pattern"] = rgb.reshape(-1, 3, 3).mean(axis=1).astype(np.uint8)
        plotter.subplot(0, column)
        plotter.add_text(title, font_size=10)
        plotter.add_mesh(surface, scalars="pattern", rgb=True)
        plotter.reset_camera()
    return plotter


def _subdivided(b: BoundaryMap, domain: native.Surface) -> Tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of small triangles of the domain, three in a row, and their images."""
    triangles, vertices = domain.triangles, domain.vertices
    parts = 4 if len(triangles) < 20_000 else 1
    corners = []
    for i in range(parts):
        for j in range(parts - i):
            corners.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < parts - 1:
                corners.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    grid = np.array(corners, float).reshape(-1, 2) / parts
    weights = np.column_stack([1.0 - grid.sum(axis=1), grid])
    each = np.repeat(np.arange(len(triangles), dtype=np.uint32), len(weights))
    barycentric = np.tile(weights, (len(triangles), 1))
    points = np.einsum("nk,nkc->nc", barycentric, vertices[triangles[each]])
    return points, b._boundary.evaluate(each, np.ascontiguousarray(barycentric))


def histogram(
    f: Union[Map, Mesh],
    *,
    by: Optional[str] = None,
    bins: int = 60,
    samples: int = 20_000,
    seed: int = 1,
    axes: Any = None,
) -> Any:
    """How a measure of distortion is distributed, as a histogram of matplotlib's.

    Parameters
    ----------
    f : Map or Mesh
        A map, sampled at points that are even by volume; or a mesh, each cell counting alike.
    by : str, optional
        Of a map ``"det_jacobian"`` (the default), ``"harmonic"`` or ``"deformation"``; of a mesh ``"scaled_jacobian"``.
    bins : int
        Bars.
    samples : int
        Points at which a map is sampled, at most.
    seed : int
        Seed of these points.
    axes : matplotlib axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib axes

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
    >>> solidmap.plot.histogram(f).get_xlabel()  # doctest: +PLOT
    'det J'
    """
    axes = _axes() if axes is None else axes
    from ._map import Map
    from ._meshes import Mesh

    if isinstance(f, Mesh):
        name = choice("by", by or "scaled_jacobian", ["scaled_jacobian"])
        values, label = f.scaled_jacobian, "scaled Jacobian"
    elif isinstance(f, Map):
        name = choice("by", by or "det_jacobian", ["det_jacobian", "harmonic", "deformation"])
        found = f.densities(_inside(f, count("samples", samples, 1), seed))
        values = getattr(found, name)
        label = {"det_jacobian": "det J"}.get(name, f"{name} energy density")
    else:
        raise InvalidInputError(f"f is of type {type(f).__name__}, but must be a Map or a Mesh")
    axes.hist(values[np.isfinite(values)], bins=count("bins", bins, 1), color="#3b6ea5")
    axes.set_xlabel(label)
    axes.set_ylabel("share" if isinstance(f, Map) else "cells")
    if isinstance(f, Map):
        axes.yaxis.set_major_formatter(lambda y, _: f"{100 * y / len(values):.3g} %")
    return axes


def _inside(f: Map, samples: int, seed: int) -> NDArray[np.float64]:
    """Points of the domain, even by volume."""
    domain = f._map.boundary.domain
    low, high = domain.vertices.min(axis=0), domain.vertices.max(axis=0)
    random = np.random.default_rng(seed)
    found = np.empty((0, 3))
    for _ in range(50):
        tried = low + random.random((2 * samples, 3)) * (high - low)
        found = np.vstack([found, tried[domain.signed_distance(tried) <= 0]])
        if len(found) >= samples:
            break
    return found[:samples]
