"""Fits, and factors of domains that serve many of them."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from . import boundary as boundaries
from ._errors import InvalidInputError, InvalidTypeError
from ._inputs import PathLike, SurfaceLike
from ._map import Map
from ._meshes import Surface
from ._progress import Progress, shown
from ._text import significant, two_columns
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ._options import Method, MethodOptions, Placement, Size, Up, Via


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
    loops: Union[PathLike, Sequence[Tuple[Sequence[int], Sequence[int]]]] = (),
    components: Any = None,
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
    free_sources: bool = False,
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
    target : surface, "sphere" or "torus", optional
        Solid to map onto, with as many handles, components and cavities as ``surface``, or what
        :func:`solidmap.boundary.sphere` or :func:`solidmap.boundary.torus` maps to: the boundary map is made first.
    tolerance : float
        Boundary error to reach over 99 % of the area, as a fraction of the target's diagonal. Sources are added where it
        is larger; if it cannot be reached, the best map is returned, and its ``tolerance_met`` is ``False``.
    max_error : float
        Largest boundary error to reach anywhere, as a multiple of ``tolerance``.
    max_local_error : float
        Largest boundary error to reach anywhere, as a multiple of the spacing of the image's vertices around.
    bijective : bool
        Also make the one-to-one map (:meth:`Map.make_bijective`), over the tetrahedra of ``surface`` if it has any.
    landmarks, landmarks_weight, landmark_curves, loops, components, start, domain_up, target_up, max_stretched, via, aligned, no_improve
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
    free_sources : bool
        Move the sources, from where they are placed to where the residual is least, for maps of few sources: at most 1000
        (``max_sources``). Takes some hundred times as long as with fixed ones. Implies a dense method, and a ``c_ratio`` of
        16 times ``s_ratio``, unless others are given.
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
        loops,
        components,
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
    onto = target if isinstance(target, str) and target in ("sphere", "torus") else None
    if given != ["target"] or onto is not None:
        for name, value in (
            ("landmarks", landmarks),
            ("landmark_curves", pair_options["landmark_curves"] or pair_options["landmark_curves_file"]),
            ("loops", pair_options["loops"] or pair_options["loops_file"]),
            ("components", components),
            ("start", start),
            ("domain_up", domain_up),
        ):
            if value is not None:
                raise InvalidInputError(f"{name} says how a solid is mapped to another: it needs target=MODEL")
    if surface is None and boundary is None:
        raise InvalidInputError("surface is missing; it may only be left out with boundary")
    start_of_work = time.perf_counter()
    found, roles = _boundary(
        surface, images, boundary, target, onto, pair_options, start, progress, limit and 0.5 * limit
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
    onto: Optional[str],
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
    if onto == "torus":
        return boundaries._torus(domain.surface, roles, progress, limit)._boundary, roles
    if onto == "sphere":
        return boundaries._sphere(domain.surface, "balanced", "progressive", roles, progress, limit)._boundary, roles
    solid = inputs.surface("target", target)
    roles = roles if solid.path is None else [*roles, ("target", solid.path)]
    roles.extend(boundaries._files(pair_options))
    made = boundaries._pair(domain.surface, solid.surface, pair_options, start, roles, progress, limit)
    return made._boundary, roles


class Factor:
    """A domain, factored once for any number of boundary maps.

    Parameters
    ----------
    surface : surface
        The boundary of the solid.
    refined_for : array_like or BoundaryMap, optional
        Images of the vertices, or a boundary map, for which sources are added until the tolerance is met, or moved with
        ``free_sources``.
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


@dataclass(frozen=True)
class FrameImages:
    """Images of fixed points in one frame, and how far they can be trusted."""

    images: NDArray[np.float64]
    """Where the points go: an image for each, ``(m, 3)``."""
    boundary_rms: float
    """Root mean square of the map's distance from the frame at held-out points of the boundary, over the diagonal of the frame's
    bounding box: at most that."""
    left_out: float
    """The largest distance between the frame and what was solved for in its place, over the same diagonal. By the maximum
    principle, it changes no image inside by more."""
    solved: int
    """Modes that were solved for, up to three; with none, the frame was a combination of earlier ones."""


class FrameEvaluator:
    """Images of fixed points inside a domain for one frame after the other.

    What frames have in common is solved for once: the first cost as much as :meth:`Factor.solve`, those that move as combinations
    of earlier ones some milliseconds for 20 000 points.

    Parameters
    ----------
    factor : Factor
        The domain.
    points : array_like
        ``(m, 3)`` points inside it.
    most_modes : int
        At most so many modes are kept, each 8 bytes per vertex, point and held-out point; frames that need others are solved for
        one by one. Four are the affine functions, which are kept in any case.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> frames = solidmap.FrameEvaluator(solidmap.Factor(ball), [[0.5, 0, 0], [0, 0, 0.5]])
    >>> x, y, z = ball.points.T
    >>> bent = lambda by: ball.points + [[by, 0, 0]] * (y * y - z * z)[:, None]
    >>> frames(bent(0.4))[:, 0].round(2).tolist()
    [0.5, -0.1]
    >>> frames.evaluate(bent(0.2)).solved
    0
    """

    def __init__(self, factor: Factor, points: ArrayLike, *, most_modes: int = 300) -> None:
        if not isinstance(factor, Factor):
            raise InvalidTypeError(f"factor is a {type(factor).__name__}, but must be a solidmap.Factor")
        if isinstance(most_modes, bool) or not isinstance(most_modes, (int, np.integer)) or most_modes < 0:
            raise InvalidInputError(f"most_modes is {most_modes}, but must be a whole number, and not negative")
        self._factor = factor
        self._points = inputs.finite_points("points", points)
        self._most_modes = int(most_modes)
        self._frames = native.FrameEvaluator(factor._factor, self._points, self._most_modes)

    @property
    def modes(self) -> int:
        """How many modes are kept."""
        return self._frames.modes

    def evaluate(self, images: ArrayLike, *, progress: Progress = None) -> FrameImages:
        """The images of the points under the map that carries the domain's vertices to ``images``, ``(n, 3)``."""
        array = inputs.finite_points("images", images)
        with shown(progress) as callback:
            return FrameImages(*self._frames.evaluate(array, callback))

    def __call__(self, images: ArrayLike) -> NDArray[np.float64]:
        """The images alone, ``(m, 3)``."""
        return self.evaluate(images).images

    def __repr__(self) -> str:
        rows = [("frames", f"of {len(self._points)} points"), ("modes", f"{self.modes} of at most {self._most_modes}")]
        return two_columns(rows)

    def __reduce__(self) -> Any:
        # Modes are solved for again where it arrives.
        return _restored_frames, (self._factor, self._points, self._most_modes)


def _restored_frames(factor: Factor, points: NDArray[np.float64], most_modes: int) -> FrameEvaluator:
    return FrameEvaluator(factor, points, most_modes=most_modes)


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
