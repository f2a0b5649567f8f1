"""Built-in surfaces, for examples and tests."""

from __future__ import annotations

from typing import Sequence

from . import _solidmap as native
from ._errors import InvalidInputError
from ._inputs import array_of
from ._meshes import Surface
from ._options import count, number

__all__ = ["cube", "polycube", "sphere", "torus"]

#: More divisions can only be a mistake.
_MOST_DIVISIONS = 1024
_MOST_LEVELS = 9


def _length(name: str, value: float) -> float:
    found = number(name, value)
    if not 0.0 < found < float("inf"):
        raise InvalidInputError(f"{name} is {found}, but must be positive and finite")
    return found


def _divisions(name: str, value: int, least: int = 1) -> int:
    found = count(name, value, least)
    if found > _MOST_DIVISIONS:
        raise InvalidInputError(f"{name} is {found}, but must be at most {_MOST_DIVISIONS}")
    return found


def sphere(radius: float = 1.0, levels: int = 3) -> Surface:
    """A sphere about the origin: an icosahedron whose triangles are cut into four ``levels`` times.

    Examples
    --------
    >>> import solidmap
    >>> solidmap.shapes.sphere(levels=3).points.shape
    (642, 3)
    """
    if count("levels", levels) > _MOST_LEVELS:
        raise InvalidInputError(f"levels is {levels}, but must be at most {_MOST_LEVELS} (2.6 million vertices)")
    return Surface._of(native.Surface.sphere(_length("radius", radius), levels))


def cube(size: float = 1.0, divisions: int = 1) -> Surface:
    """The cube of this size about the origin, with so many squares along each edge.

    Examples
    --------
    >>> import solidmap
    >>> round(solidmap.shapes.cube(2.0, 4).volume, 9)
    8.0
    """
    return Surface._of(native.Surface.cube(_length("size", size), _divisions("divisions", divisions)))


def torus(major: float = 1.0, minor: float = 0.3, around: int = 48, across: int = 24) -> Surface:
    """A torus about the z axis.

    Examples
    --------
    >>> import solidmap
    >>> solidmap.check(solidmap.shapes.torus()).genus
    1
    """
    if _length("minor", minor) >= _length("major", major):
        raise InvalidInputError(f"minor is {minor}, but must be less than major, {major}")
    return Surface._of(native.Surface.torus(major, minor, _divisions("around", around, 3), _divisions("across", across, 3)))


def polycube(cubes: Sequence[Sequence[int]], divisions: int = 4) -> Surface:
    """The surface of unit cubes at integer positions.

    Examples
    --------
    >>> import solidmap
    >>> round(solidmap.shapes.polycube([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 2).volume, 9)
    3.0
    """
    array = array_of("cubes", cubes)
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise InvalidInputError(f"cubes has the dtype {array.dtype} and the shape {array.shape}, but must be integers (n, 3)")
    if int(array.max()) > _MOST_DIVISIONS or int(array.min()) < -_MOST_DIVISIONS:
        raise InvalidInputError(f"cubes has positions beyond {_MOST_DIVISIONS}")
    places = array.tolist()
    found = _divisions("divisions", divisions)
    if 12.0 * len(places) * found**2 > 3e7:
        raise InvalidInputError(f"{len(places)} cubes of {found} divisions have more than 30 million triangles")
    return Surface._of(native.Surface.polycube(places, found))
