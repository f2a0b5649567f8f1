"""Boundary maps: where every point of a solid's surface goes."""

from __future__ import annotations

import json
import os
import tempfile
from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from ._errors import InvalidInputError
from ._inputs import PathLike, SurfaceLike
from ._meshes import Surface
from ._progress import Progress, shown
from ._reports import BoundaryCheck, ImproveReport, PairReport, SphereReport
from ._text import Rows, significant, table, two_columns

if TYPE_CHECKING:
    from ._options import Up, Via

__all__ = ["BoundaryMap", "FundamentalDomain", "check", "improve", "pair", "sphere", "torus", "unfold"]

#: Files by their roles.
Roles = List[Tuple[str, str]]


class BoundaryMap:
    """Where every point of a solid's boundary goes.

    Parameters
    ----------
    domain : surface
        The boundary of the solid that is mapped.
    images : array_like, shape (n, 3), or surface
        The image of every vertex, or a surface with the same faces and its vertices at their images. Between vertices
        the map is linear.

    Examples
    --------
    >>> import solidmap
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> longer = solidmap.BoundaryMap(ball, ball.points * [2, 1, 1])
    >>> round(longer.target_volume / ball.volume, 6)
    2.0
    """

    #: How the map was made, where :func:`sphere`, :func:`pair` or :func:`improve` made it.
    report: Union[SphereReport, PairReport, ImproveReport, None]
    #: Other maps that :func:`pair` found.
    alternatives: List[BoundaryMap]

    def __init__(self, domain: SurfaceLike, images: Any) -> None:
        found = inputs.surface("domain", domain).surface
        given = inputs.images_or_surface("images", images, found)
        if isinstance(given, np.ndarray):
            self._boundary = native.Boundary(found, given)
        else:
            self._boundary = native.Boundary.between(found, given)
        self.report, self.alternatives = None, []

    @classmethod
    def _of(cls, boundary: native.Boundary, report: Union[SphereReport, PairReport, ImproveReport, None] = None) -> BoundaryMap:
        made = cls.__new__(cls)
        made._boundary, made.report, made.alternatives = boundary, report, []
        return made

    @classmethod
    def load(cls, path: PathLike) -> BoundaryMap:
        """Read a boundary file, as :meth:`save` and ``solidmap boundary pair --boundary`` write it."""
        return cls._of(native.Boundary.read(inputs.path("path", path)))

    def save(self, path: PathLike) -> None:
        """Write a boundary file (.safetensors).

        Examples
        --------
        >>> import solidmap, tempfile, os
        >>> name = os.path.join(tempfile.mkdtemp(), "boundary.safetensors")
        >>> solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4)).save(name)
        >>> round(solidmap.BoundaryMap.load(name).domain.volume, 9)
        1.0
        """
        self._boundary.write(inputs.path("path", path))

    def save_fields(self, path: PathLike) -> None:
        """Write the domain with the image of each vertex and the distortion of each triangle (.vtu or .vtk), for ParaView.

        Examples
        --------
        >>> import solidmap, tempfile, os
        >>> name = os.path.join(tempfile.mkdtemp(), "boundary.vtu")
        >>> solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4)).save_fields(name)
        >>> os.path.exists(name)
        True
        """
        self._boundary.write_fields(inputs.fields_path("path", path))

    @property
    def domain(self) -> Surface:
        """The surface that is mapped."""
        return Surface._of(self._boundary.domain)

    @property
    def target(self) -> Surface:
        """The domain's triangles at the images of their vertices, facing outward."""
        return Surface._of(self._boundary.target)

    @property
    def target_surface(self) -> Optional[Surface]:
        """The surface that was mapped to, of a map made by :func:`pair`."""
        found = self._boundary.target_surface
        return None if found is None else Surface._of(found)

    @property
    def images(self) -> NDArray[np.float64]:
        """Images of the domain's vertices; a copy."""
        return self._boundary.images

    @property
    def target_volume(self) -> float:
        """The volume of the target, negative where the map reflects."""
        return self._boundary.target_volume

    @property
    def target_diagonal(self) -> float:
        """The diagonal of the target's bounding box."""
        return self._boundary.target_diagonal

    @property
    def is_linear(self) -> bool:
        """Whether the map is linear over the domain's triangles."""
        return self._boundary.is_linear

    def __call__(self, triangles: ArrayLike, barycentric: ArrayLike) -> NDArray[np.float64]:
        """Images of points of the surface, given by their triangles and barycentric coordinates.

        Examples
        --------
        >>> import solidmap
        >>> ball = solidmap.shapes.sphere(levels=1)
        >>> boundary = solidmap.BoundaryMap(ball, 2 * ball.points)
        >>> boundary([0], [[1, 0, 0]]).shape
        (1, 3)
        """
        numbers = inputs.array_of("triangles", triangles)
        if numbers.dtype.kind not in "iu" or numbers.ndim != 1 or (numbers.size and numbers.min() < 0):
            raise InvalidInputError("triangles must be indices of triangles, counted from 0, in one dimension")
        weights = inputs.finite_points("barycentric", barycentric)
        return self._boundary.evaluate(np.require(numbers, np.uint32, ["C", "A"]), weights)

    def inverse(self) -> BoundaryMap:
        """The map the other way, of one made by :func:`pair`."""
        return BoundaryMap._of(self._boundary.inverse())

    def plot(self, **settings: Any) -> Any:
        """Draw domain and target with one pattern on both; see :func:`solidmap.plot.boundary`."""
        from . import plot

        return plot.boundary(self, **settings)

    def _rows(self) -> Rows:
        domain = self._boundary.domain
        rows = [("boundary map", f"of {len(domain.vertices)} vertices, {len(domain.triangles)} triangles")]
        rows.append(("volume", f"{significant(domain.volume, 6)} → {significant(self.target_volume, 6)}"))
        return rows if self.report is None else [*rows, *self.report._rows()]

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table("BoundaryMap", self._rows())

    def __reduce__(self) -> Any:
        return _restored, (_bytes_of(self._boundary.write), self.report, self.alternatives)


def _bytes_of(write: Any) -> bytes:
    """What a function writes to a file."""
    with tempfile.TemporaryDirectory() as folder:
        name = os.path.join(folder, "object.safetensors")
        write(name)
        with open(name, "rb") as file:
            return file.read()


def _read_from(read: Any, content: bytes, *more: Any) -> Any:
    """What a function reads from a file of this content."""
    with tempfile.TemporaryDirectory() as folder:
        name = os.path.join(folder, "object.safetensors")
        with open(name, "wb") as file:
            file.write(content)
        return read(name, *more)


def _restored(content: bytes, report: Any, alternatives: Any) -> BoundaryMap:
    made = BoundaryMap._of(_read_from(native.Boundary.read, content), report)
    made.alternatives = alternatives
    return made


def sphere(
    surface: SurfaceLike,
    *,
    energy: str = "balanced",
    start: str = "progressive",
    progress: Progress = None,
    time_limit: Optional[float] = None,
) -> BoundaryMap:
    """Map a closed surface without handles to the unit sphere, one to one.

    Parameters
    ----------
    surface : surface
        Closed, of genus 0.
    energy : {"balanced", "conformal"}
        What is preserved: angles, with the distortion of areas bounded; or angles alone, where limbs shrink to specks.
    start : {"progressive", "flow"}
        Where the optimisation starts: at an embedding made from coarse to fine, or at the end of the conformalised mean
        curvature flow.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    time_limit : float, optional
        Seconds after which the best map so far is taken, once there is one.

    Returns
    -------
    BoundaryMap
        With its ``report``.

    Examples
    --------
    >>> import numpy as np, solidmap
    >>> onto = solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4))
    >>> bool(np.allclose(np.linalg.norm(onto.images, axis=1), 1))
    True
    >>> onto.report.certificate["flipped"]
    0
    """
    found = inputs.surface("surface", surface)
    roles: Roles = [] if found.path is None else [("domain", found.path)]
    return _sphere(found.surface, energy, start, roles, progress, time_limit)


def _sphere(
    surface: native.Surface, energy: str, start: str, roles: Roles, progress: Progress, time_limit: Optional[float]
) -> BoundaryMap:
    chosen = (
        options.choice("energy", energy, ["balanced", "conformal"]),
        options.choice("start", start, ["progressive", "flow"]),
    )
    limit = options.optional(options.seconds, "time_limit", time_limit)
    with shown(progress) as callback:
        made, report = native.boundary_sphere(surface, *chosen, roles, callback, limit)
    return BoundaryMap._of(made, SphereReport._read(report))


def torus(surface: SurfaceLike, *, progress: Progress = None, time_limit: Optional[float] = None) -> BoundaryMap:
    """Map a closed surface with one handle to the torus of revolution that keeps its angles best, one to one.

    Parameters
    ----------
    surface : surface
        Closed, of genus 1, with a hole that is not knotted.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    time_limit : float, optional
        Seconds after which the best map so far is taken, once there is one.

    Returns
    -------
    BoundaryMap
        With its ``report``, whose ``fitting_torus`` has the torus' radii: it lies about the z axis, has its centre at the
        origin and the volume of the solid. Its ``modulus`` says how far the surface's flat torus leans, and how high it is,
        over the side that bounds a disk in the solid.

    Examples
    --------
    >>> import solidmap
    >>> onto = solidmap.boundary.torus(solidmap.shapes.torus(3.0, 1.0, 24, 12))
    >>> found = onto.report.fitting_torus
    >>> 2.8 < found["major"] / found["minor"] < 3.2, onto.report.looks_wrong
    (True, False)
    """
    found = inputs.surface("surface", surface)
    roles: Roles = [] if found.path is None else [("domain", found.path)]
    return _torus(found.surface, roles, progress, time_limit)


def _torus(surface: native.Surface, roles: Roles, progress: Progress, time_limit: Optional[float]) -> BoundaryMap:
    limit = options.optional(options.seconds, "time_limit", time_limit)
    with shown(progress) as callback:
        made, report, looks_wrong = native.boundary_torus(surface, roles, callback, limit)
    return BoundaryMap._of(made, PairReport({**json.loads(report), "looks_wrong": looks_wrong}))


class FundamentalDomain(NamedTuple):
    """A surface with handles laid out in a polygon of the plane, whose sides are glued in pairs."""

    #: Handles.
    genus: int
    #: Triangles, shape (m, 3), facing outward: vertices of the surface.
    faces: NDArray[np.uint32]
    #: Where their corners are, shape (m, 3, 2), counter-clockwise: in the plane, with the area 1 for all (one handle), or in Poincaré's
    #: disk. Triangles across a side stick out.
    corners: NDArray[np.float64]
    #: The sides of the polygon, counter-clockwise, each as points from its beginning to its end, shape (k, 2).
    sides: List[NDArray[np.float64]]


def unfold(surface: SurfaceLike) -> FundamentalDomain:
    """Lay a closed surface with handles out in the plane, one to one and with low distortion of angles.

    Parameters
    ----------
    surface : surface
        Closed, of genus 1 or more.

    Returns
    -------
    FundamentalDomain
        With one handle in a parallelogram, whose first side is a loop that bounds in the solid; with g handles in a polygon of 4g
        sides of the hyperbolic plane.

    Examples
    --------
    >>> import solidmap
    >>> flat = solidmap.boundary.unfold(solidmap.shapes.torus(3.0, 1.0, 24, 12))
    >>> flat.genus, flat.corners.shape, len(flat.sides)
    (1, (576, 3, 2), 4)
    """
    return FundamentalDomain(*native.boundary_unfold(inputs.surface("surface", surface).surface))


def _curves(name: str, given: Any) -> List[Tuple[List[int], List[int]]]:
    curves: List[Tuple[List[int], List[int]]] = []
    for index, curve in enumerate(() if inputs.is_path(given) else given):
        try:
            first, second = curve
        except (TypeError, ValueError):
            raise InvalidInputError(
                f"{name}[{index}] must be two paths, of vertices of the domain and of the target"
            ) from None
        at = f"{name}[{index}]"
        curves.append(([options.count(at, v) for v in first], [options.count(at, v) for v in second]))
    return curves


def _pair_arguments(
    landmarks: Any,
    landmarks_weight: Optional[float],
    landmark_curves: Any,
    loops: Any,
    components: Any,
    domain_up: Optional[str],
    target_up: Optional[str],
    max_stretched: float,
    via: str,
    aligned: bool,
    no_improve: bool,
    alternatives: int,
) -> Dict[str, Any]:
    if (domain_up is None) != (target_up is None):
        raise InvalidInputError("domain_up and target_up say what corresponds: give both or neither")
    if landmarks_weight is not None and landmarks is None:
        raise InvalidInputError("landmarks_weight has no meaning without landmarks")
    up = None
    if domain_up is not None:
        up = [list(options.direction("domain_up", domain_up)), list(options.direction("target_up", target_up))]
    is_file, are_named = inputs.is_path(landmarks), inputs.is_path(components)
    share = options.number("max_stretched", max_stretched)
    if not 0.0 <= share <= 1.0:
        raise InvalidInputError(f"max_stretched is {share}, but must be a share from 0 to 1")
    weight = options.optional(options.number, "landmarks_weight", landmarks_weight)
    if weight is not None and not 0.0 < weight < float("inf"):
        raise InvalidInputError(f"landmarks_weight is {weight}, but must be positive and finite")
    return {
        "landmarks": [] if is_file or landmarks is None else inputs.indices("landmarks", landmarks, (2,)).tolist(),
        "landmarks_file": inputs.path("landmarks", landmarks) if is_file else None,
        "landmarks_weight": weight,
        "landmark_curves": _curves("landmark_curves", landmark_curves),
        "landmark_curves_file": os.fspath(landmark_curves) if inputs.is_path(landmark_curves) else None,
        "loops": _curves("loops", loops),
        "loops_file": os.fspath(loops) if inputs.is_path(loops) else None,
        "components": [] if are_named or components is None else inputs.indices("components", components, (2,)).tolist(),
        "components_file": inputs.path("components", components) if are_named else None,
        "up": up,
        "max_stretched": share,
        "via": options.choice("via", via, ["targets", "conformal"]),
        "aligned": options.flag("aligned", aligned),
        "no_improve": options.flag("no_improve", no_improve),
        "alternatives": options.count("alternatives", alternatives),
    }


def _files(arguments: Dict[str, Any]) -> Roles:
    files = [(role, arguments[f"{role}_file"]) for role in ("landmarks", "landmark_curves", "loops", "components")]
    return [(role, file) for role, file in files if file is not None]


def pair(
    domain: SurfaceLike,
    target: SurfaceLike,
    *,
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
    alternatives: int = 0,
    progress: Progress = None,
    time_limit: Optional[float] = None,
) -> BoundaryMap:
    """Map the boundary of a solid one to one to that of another.

    Parameters
    ----------
    domain, target : surface
        Closed, with as many handles, components and cavities. With handles there are no landmarks, curves or starts, and with
        one no axes.
    landmarks : array_like of integers, shape (k, 2), or the name of a file, optional
        Vertices of the domain that go to vertices of the target.
    landmarks_weight : float, optional
        Landmarks need not be met exactly: one that is off by a tenth of the root of the target's area costs as much as a
        mean distortion that is higher by so many percent.
    landmark_curves : sequence of pairs of paths, or the name of a file, optional
        Paths along edges of the domain that are to go to paths on the target, as lists of vertices.
    loops : sequence of pairs of paths, or the name of a file, optional
        For solids with handles: loops of the domain that are to go to loops of the target, up to a deformation along the surface,
        as lists of vertices, of which the last one is joined to the first. They decide which handle goes to which, in which
        direction, and how often it is twisted. With several handles, give one around the hole of each, none of which meets itself
        or another.
    components : array_like of integers, shape (k, 2), or the name of a file, optional
        Components and cavities of the domain that go to given ones of the target, by their indices in
        ``solidmap.check(...).components``. Those that are not named find their partners by what they lie in, their handles, place
        and size.
    start : BoundaryMap, optional
        A map of the same domain to start from: it is improved, and nothing else is sought. Components and cavities go
        where it takes them.
    domain_up, target_up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axes that roughly correspond.
    max_stretched : float
        Share of the domain's area that may be stretched or compressed over 10 times, and four times as much of the target's; above it,
        ``report.looks_wrong``.
    via : {"targets", "conformal"}
        How the surfaces are matched.
    aligned : bool
        The solids lie in the same place, with the same size and pose.
    no_improve : bool
        Do not lower the distortion of the first map that is found.
    alternatives : int
        Up to so many other maps are returned in the result's ``alternatives``.
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    time_limit : float, optional
        Seconds after which the best map so far is taken, once there is one.

    Returns
    -------
    BoundaryMap
        With its ``report`` and ``alternatives``.

    Examples
    --------
    >>> import solidmap
    >>> box, ball = solidmap.shapes.cube(2.0, 4), solidmap.shapes.sphere(levels=2)
    >>> onto = solidmap.boundary.pair(box, ball)
    >>> onto.report.looks_wrong, onto.is_linear
    (False, False)
    """
    arguments = _pair_arguments(
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
        alternatives,
    )
    first, second = inputs.surface("domain", domain), inputs.surface("target", target)
    roles: Roles = [(role, at.path) for role, at in (("domain", first), ("target", second)) if at.path is not None]
    roles.extend(_files(arguments))
    return _pair(first.surface, second.surface, arguments, start, roles, progress, time_limit)


def _pair(
    domain: native.Surface,
    target: native.Surface,
    arguments: Dict[str, Any],
    start: Optional[BoundaryMap],
    roles: Roles,
    progress: Progress,
    time_limit: Optional[float],
) -> BoundaryMap:
    if arguments["aligned"] and arguments["via"] != "targets":
        raise InvalidInputError('aligned says where closest points are sought, and via="conformal" seeks none')
    limit = options.optional(options.seconds, "time_limit", time_limit)
    begin = None if start is None else start._boundary
    with shown(progress) as callback:
        made, report, looks_wrong, others = native.boundary_pair(
            domain, target, arguments, begin, roles, callback, limit
        )
    data = {**json.loads(report), "looks_wrong": looks_wrong}
    found = BoundaryMap._of(made, PairReport(data))
    found.alternatives = [BoundaryMap._of(other) for other in others]
    return found


def improve(
    boundary: BoundaryMap,
    *,
    max_distortion: float = 1.5,
    rounds: int = 30,
    tolerance: float = 2e-3,
    progress: Progress = None,
    time_limit: Optional[float] = None,
) -> BoundaryMap:
    """Move the images on the target so that the harmonic energy of the inside falls, one to one all the way.

    Parameters
    ----------
    boundary : BoundaryMap
        As :func:`pair` or :func:`sphere` makes it: maps given by images of vertices cannot slide.
    max_distortion : float
        How much the distortion of the surface may grow: its symmetric Dirichlet energy, in the mean and at 99.9 % of the
        area, over those of ``boundary``. At least 1.
    rounds : int
        Rounds at most; each fits a harmonic map.
    tolerance : float
        Boundary error that the fits are to reach (99 % of the area, as a fraction of the target's diagonal).
    progress : bool or callable, optional
        As for :func:`solidmap.check`.
    time_limit : float, optional
        Seconds after which the best map so far is taken.

    Returns
    -------
    BoundaryMap
        With its ``report``.

    Examples
    --------
    >>> import solidmap
    >>> onto = solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4))
    >>> better = solidmap.boundary.improve(onto, rounds=2)
    >>> better.report.energies[-1] <= better.report.energies[0]
    True
    """
    if not isinstance(boundary, BoundaryMap):
        raise options.InvalidTypeError(f"boundary is of type {type(boundary).__name__}, but must be a BoundaryMap")
    chosen = (
        options.number("max_distortion", max_distortion),
        options.count("rounds", rounds),
        options.number("tolerance", tolerance),
    )
    limit = options.optional(options.seconds, "time_limit", time_limit)
    with shown(progress) as callback:
        made, report = native.boundary_improve(boundary._boundary, *chosen, callback, limit)
    return BoundaryMap._of(made, ImproveReport._read(report))


def check(
    boundary: BoundaryMap,
    *,
    target: Optional[SurfaceLike] = None,
    tolerance: float = 0.01,
    seed: int = 1,
    worst: int = 5,
) -> BoundaryCheck:
    """Say whether a boundary map is one to one, how well it covers its target, and how far it distorts.

    Parameters
    ----------
    boundary : BoundaryMap
        The map.
    target : surface, optional
        What the image is to cover; by default the surface it was made for, or the sphere that the image lies on.
    tolerance : float
        Largest distance allowed between image and target, as a fraction of the target's diagonal.
    seed : int
        Seed of the sample points.
    worst : int
        How many of the worst places are listed.

    Examples
    --------
    >>> import solidmap
    >>> onto = solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4))
    >>> solidmap.boundary.check(onto).verdict
    'bijective'
    """
    if not isinstance(boundary, BoundaryMap):
        raise options.InvalidTypeError(f"boundary is of type {type(boundary).__name__}, but must be a BoundaryMap")
    allowed = options.number("tolerance", tolerance)
    if not 0.0 <= allowed < float("inf"):
        raise InvalidInputError(f"tolerance is {allowed}, but must be a fraction of the target's diagonal, such as 0.01")
    against = None if target is None else inputs.surface("target", target).surface
    report, text = boundary._boundary.check(
        against, allowed, options.count("seed", seed), options.count("worst", worst)
    )
    return BoundaryCheck(json.loads(report), text)
