"""Options: their types, and their names in errors."""

from __future__ import annotations

import math
import operator
import re
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Sequence, Tuple, TypedDict, Union

from ._errors import InvalidInputError, InvalidTypeError

if TYPE_CHECKING:
    from typing_extensions import Literal

    Placement = Literal["adaptive", "offset", "sphere"]
    Method = Literal["schwarz", "dense", "svd"]
    MapKind = Literal["harmonic", "bijective"]
    Up = Literal["x", "y", "z", "-x", "-y", "-z"]
    Via = Literal["targets", "conformal"]
    CellKind = Literal["tet", "hex"]
    Mesher = Literal["tetgen", "cgal"]
    Orient = Literal["given", "principal", "best"]

#: A number of bytes, or text such as ``"500MB"`` or ``"4GiB"``.
Size = Union[int, str]


class MethodOptions(TypedDict, total=False):
    """Options of the method of fundamental solutions, as :func:`solidmap.fit` explains them."""

    paper: bool
    placement: Optional[Placement]
    alpha: Optional[float]
    offset: Optional[float]
    radius: Optional[float]
    s_ratio: Optional[float]
    c_ratio: Optional[float]
    max_sources: Optional[int]
    max_s_ratio: Optional[float]
    memory: Optional[Size]
    method: Optional[Method]
    truncation: Optional[float]
    no_affine: bool
    no_refine: bool
    free_sources: bool
    held_out: int
    seed: int


METHOD_DEFAULTS: Dict[str, Any] = {
    "paper": False,
    "placement": None,
    "alpha": None,
    "offset": None,
    "radius": None,
    "s_ratio": None,
    "c_ratio": None,
    "max_sources": None,
    "max_s_ratio": None,
    "memory": None,
    "method": None,
    "truncation": None,
    "no_affine": False,
    "no_refine": False,
    "free_sources": False,
    "held_out": 20_000,
    "seed": 1,
}


class RepairOptions(TypedDict, total=False):
    """Options of the repair of carried meshes, as :meth:`solidmap.Map.remesh` explains them."""

    fix_boundary: bool
    split_stuck: Union[int, None, Literal["off"]]
    effort: float
    max_cells: int
    memory: Optional[Size]


REPAIR_DEFAULTS: Dict[str, Any] = {
    "fix_boundary": False,
    "split_stuck": None,
    "effort": 2000.0,
    "max_cells": 20_000_000,
    "memory": None,
}


def number(name: str, value: Any) -> float:
    """A real number."""
    if isinstance(value, (str, bytes)) or getattr(value, "shape", ()) != ():
        raise InvalidTypeError(f"{name} is {value!r}, but must be a number")
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InvalidTypeError(f"{name} is of type {type(value).__name__}, but must be a number") from None


def seconds(name: str, value: Any) -> float:
    """A number of seconds."""
    found = number(name, value)
    if not 0.0 <= found < math.inf:
        raise InvalidInputError(f"{name} is {found}, but must be a number of seconds")
    return found


def count(name: str, value: Any, least: int = 0) -> int:
    """An integer that is not negative."""
    try:
        found = operator.index(value)
    except TypeError:
        raise InvalidTypeError(f"{name} is {value!r}, but must be an integer") from None
    if not least <= found < 2**63:
        raise InvalidInputError(f"{name} is {found}, but must be an integer of at least {least}")
    return found


def flag(name: str, value: Any) -> bool:
    """``True`` or ``False``."""
    if value is True or value is False or type(value).__name__ in ("bool_", "bool"):
        return bool(value)
    raise InvalidTypeError(f"{name} is {value!r}, but must be True or False")


def choice(name: str, value: Any, allowed: Sequence[str]) -> str:
    """One of some words."""
    if isinstance(value, str) and value in allowed:
        return value
    words = ", ".join(f'"{word}"' for word in allowed)
    raise InvalidInputError(f"{name} is {value!r}, but must be one of {words}")


def optional(convert: Any, name: str, value: Any, *more: Any) -> Any:
    """``None``, or what another function converts."""
    return None if value is None else convert(name, value, *more)


_UNITS = {"": 1, "b": 1}
for _power, _letter in enumerate("kmgt", start=1):
    _UNITS.update({f"{_letter}b": 1000**_power, f"{_letter}ib": 1024**_power})


def size(name: str, value: Any) -> int:
    """A number of bytes."""
    if not isinstance(value, str):
        return count(name, value)
    found = re.fullmatch(r"\s*([0-9.]+)\s*([a-zA-Z]*)\s*", value)
    unit = _UNITS.get(found.group(2).lower()) if found else None
    try:
        amount = float(found.group(1)) if found else math.nan
    except ValueError:
        amount = math.nan
    if unit is None or not math.isfinite(amount):
        raise InvalidInputError(f"{name} is {value!r}, but must be a number of bytes, such as 500MB or 4GiB")
    return int(amount * unit)


def off_or_count(name: str, value: Any) -> Optional[int]:
    """``None``, ``"off"`` for 0, or a number."""
    return 0 if isinstance(value, str) and value == "off" else optional(count, name, value)


_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def direction(name: str, value: Any) -> Tuple[float, float, float]:
    """An axis by its name, with its sign."""
    word = choice(name, value, ["x", "y", "z", "-x", "-y", "-z"])
    x, y, z = _AXES[word[-1]]
    return (-x, -y, -z) if word[0] == "-" else (x, y, z)


def _merged(defaults: Dict[str, Any], given: Dict[str, Any], call: str) -> Dict[str, Any]:
    unknown = sorted(set(given) - set(defaults))
    if unknown:
        raise InvalidTypeError(f"{call}() got an unexpected keyword argument {unknown[0]!r}")
    return {**defaults, **given}


def method(
    given: Dict[str, Any],
    call: str,
    tolerance: float = 1e-3,
    max_error: float = 20.0,
    max_local_error: float = math.inf,
) -> Dict[str, Any]:
    """All options of a fit, for the native module."""
    all_options = _merged(METHOD_DEFAULTS, given, call)
    converted: Dict[str, Any] = {
        "tolerance": number("tolerance", tolerance),
        "max_error": number("max_error", max_error),
        "max_local_error": number("max_local_error", max_local_error),
        "placement": optional(choice, "placement", all_options["placement"], ["adaptive", "offset", "sphere"]),
        "method": optional(choice, "method", all_options["method"], ["schwarz", "dense", "svd"]),
        "memory": optional(size, "memory", all_options["memory"]),
        "max_sources": optional(count, "max_sources", all_options["max_sources"]),
    }
    for name in ("alpha", "offset", "radius", "s_ratio", "c_ratio", "max_s_ratio", "truncation"):
        converted[name] = optional(number, name, all_options[name])
    for name in ("paper", "no_affine", "no_refine", "free_sources"):
        converted[name] = flag(name, all_options[name])
    for name in ("held_out", "seed"):
        converted[name] = count(name, all_options[name])
    return converted


def carried(
    given: Dict[str, Any],
    call: str,
    *,
    kind: str,
    cells: int,
    cell_size: Optional[float],
    no_repair: bool,
    polish: Optional[int],
    worst: int,
    keep_boundary_map: bool = False,
) -> Dict[str, Any]:
    """All options of a carried mesh, for the native module."""
    repair = _merged(REPAIR_DEFAULTS, given, call)
    return {
        "kind": choice("kind", kind, ["tet", "hex"]),
        "cells": count("cells", cells),
        "cell_size": optional(number, "cell_size", cell_size),
        "no_repair": flag("no_repair", no_repair),
        "polish": optional(count, "polish", polish),
        "fix_boundary": flag("fix_boundary", repair["fix_boundary"]),
        "keep_boundary_map": flag("keep_boundary_map", keep_boundary_map),
        "split_stuck": off_or_count("split_stuck", repair["split_stuck"]),
        "effort": number("effort", repair["effort"]),
        "max_cells": count("max_cells", repair["max_cells"]),
        "memory": optional(size, "memory", repair["memory"]),
        "worst": count("worst", worst),
    }


def lame(value: Any) -> List[float]:
    """The two Lamé constants."""
    try:
        first, second = value
    except (TypeError, ValueError):
        raise InvalidTypeError(f"lame is {value!r}, but must be two numbers, lambda and mu") from None
    return [number("lame", first), number("lame", second)]
