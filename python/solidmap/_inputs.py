"""What functions take, as the arrays that the native module takes.

A surface is ``(vertices, faces)``, a :class:`solidmap.Surface`, a ``trimesh.Trimesh``, a ``pyvista.PolyData``, a
``meshio.Mesh`` or a path; cells are ``(points, cells)``, a :class:`solidmap.Mesh`, a ``pyvista.UnstructuredGrid``, a
``meshio.Mesh`` or a path. Objects of other packages are known by what they have, so that none is imported here.
"""

from __future__ import annotations

import os
from typing import Any, List, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _solidmap as native
from ._errors import InvalidInputError, InvalidTypeError

#: What stands for a surface.
SurfaceLike = Any
#: What stands for tetrahedra or hexahedra.
CellsLike = Any
PathLike = Union[str, "os.PathLike[str]"]

_WHAT_SURFACES_ARE = (
    "(vertices, faces), a solidmap.Surface, a trimesh.Trimesh, a pyvista.PolyData, a meshio.Mesh or a path"
)
_WHAT_CELLS_ARE = "(points, cells), a solidmap.Mesh, a pyvista.UnstructuredGrid, a meshio.Mesh or a path"

#: VTK's numbers of tetrahedra and hexahedra.
_VTK_CELLS = {10: 4, 12: 8}


def is_path(value: Any) -> bool:
    """Whether a value is the name of a file."""
    return isinstance(value, (str, os.PathLike))


def path(name: str, value: Any) -> str:
    """The name of a file."""
    if not is_path(value):
        raise InvalidTypeError(f"{name} is of type {type(value).__name__}, but must be a path")
    found = os.fspath(value)
    if not isinstance(found, str):
        raise InvalidTypeError(f"{name} is a path of bytes, but must be one of text")
    return found


def fields_path(name: str, value: Any) -> str:
    """The name of a file for fields."""
    found = path(name, value)
    if not found.lower().endswith((".vtu", ".vtk")):
        raise InvalidInputError(f"{name} is {found!r}, but must end in .vtu or .vtk")
    return found


def array_of(name: str, value: Any) -> NDArray[Any]:
    """Any array, or an error that names the argument."""
    try:
        return np.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidTypeError(f"{name} is no array: {error}") from None


def real_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Real numbers as doubles in C order; the very array where it is that already."""
    array = array_of(name, value)
    flags = array.flags
    if array.dtype == np.float64 and flags.c_contiguous and flags.aligned:
        return array
    if array.dtype.kind not in "fiu" and array.size:
        raise InvalidTypeError(f"{name} has the dtype {array.dtype}, but must have real numbers")
    return np.require(array, np.float64, ["C", "A"])


def points(name: str, value: ArrayLike) -> Tuple[NDArray[np.float64], Tuple[int, ...]]:
    """Points as ``(n, 3)``, and the shape that they were given in, without the last axis."""
    array = real_array(name, value)
    shape = array.shape
    if shape and shape[-1] == 3:
        return (array if array.ndim == 2 else array.reshape(-1, 3)), shape[:-1]
    if shape == (0,) or (len(shape) > 1 and shape[-1] == 0 and 0 in shape[:-1]):
        # ``[]`` and the like have no coordinates that could be counted.
        return np.empty((0, 3)), shape[:-1] or (0,)
    raise InvalidInputError(f"{name} has the shape {shape}, but must be (..., 3)")


def is_dask_array(value: Any) -> bool:
    """Whether a value is an array of Dask's."""
    return type(value).__module__.startswith("dask.array") and hasattr(value, "map_blocks")


def by_blocks(name: str, points: Any, call: Any, axes: int, **settings: Any) -> Any:
    """A Dask array of what a call, which has ``axes`` more axes of three entries, returns for each block of points."""
    if points.ndim == 0 or points.shape[-1] != 3:
        raise InvalidInputError(f"{name} has the shape {points.shape}, but must be (..., 3)")
    whole = points.rechunk({points.ndim - 1: 3})
    return whole.map_blocks(
        call,
        dtype=np.float64,
        meta=np.empty((0,) * (whole.ndim + axes)),
        new_axis=list(range(whole.ndim, whole.ndim + axes)) or None,
        chunks=(*whole.chunks, *((3,),) * axes),
        **settings,
    )


def rows_of_points(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Points as ``(n, 3)``, given like that."""
    array, shape = points(name, value)
    if len(shape) != 1:
        raise InvalidInputError(f"{name} has the shape {(*shape, 3)}, but must be (n, 3)")
    return array


def finite_points(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """As :func:`rows_of_points`, without NaN and infinite coordinates."""
    array = rows_of_points(name, value)
    finite = np.isfinite(array).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InvalidInputError(f"{name}[{row}] is {tuple(array[row].tolist())}, but coordinates must be finite")
    return array


def indices(name: str, value: ArrayLike, columns: Tuple[int, ...], most: Optional[int] = None) -> NDArray[np.uint32]:
    """Indices in rows, of any integer type, below ``most``."""
    array = array_of(name, value)
    if array.size == 0 and array.ndim < 2:
        array = np.empty((0, columns[0]), np.uint32)
    if array.dtype.kind not in "iu":
        raise InvalidTypeError(f"{name} has the dtype {array.dtype}, but must have integers")
    if array.ndim != 2 or array.shape[1] not in columns:
        wanted = " or ".join(f"(m, {n})" for n in columns)
        raise InvalidInputError(f"{name} has the shape {array.shape}, but must be {wanted}")
    limit = 2**32 if most is None else most
    if array.size:
        low, high = int(array.min()), int(array.max())
        wrong = low if low < 0 else high
        if low < 0 or high >= limit:
            row = int(np.argmax((array == wrong).any(axis=1)))
            there_are = "" if most is None else f", and there are {most} points, counted from 0"
            raise InvalidInputError(f"{name}[{row}] names point {wrong}{there_are}")
    return np.require(array, np.uint32, ["C", "A"])


class SurfaceInput(NamedTuple):
    """A surface for the native module, and the file that it is from."""

    surface: native.Surface
    path: Optional[str]


def _polygons(name: str, flat: NDArray[np.integer[Any]]) -> NDArray[np.integer[Any]]:
    """Triangles of VTK's list of polygons, ``[3, a, b, c, 3, ...]``."""
    if flat.size % 4 or (flat.reshape(-1, 4)[:, 0] != 3).any():
        raise InvalidInputError(f"{name} has polygons that are no triangles; call its triangulate() first")
    return flat.reshape(-1, 4)[:, 1:]


def _of_arrays(name: str, vertices: ArrayLike, faces: ArrayLike, finite: bool) -> native.Surface:
    label = f"the vertices of {name}"
    array = finite_points(label, vertices) if finite else rows_of_points(label, vertices)
    return native.Surface(name, array, indices(f"the faces of {name}", faces, (3,), len(array)))


def _meshio_blocks(value: Any, wanted: Tuple[str, ...]) -> List[Tuple[str, Any]]:
    blocks = [(block.type, block.data) for block in value.cells if hasattr(block, "data")]
    return [(kind, data) for kind, data in blocks if kind in wanted]


def surface(name: str, value: SurfaceLike, finite: bool = True) -> SurfaceInput:
    """What stands for a surface."""
    if isinstance(value, native.Surface):
        return SurfaceInput(value, None)
    own = getattr(value, "_surface", None)
    if isinstance(own, native.Surface):
        return SurfaceInput(own, None)
    if is_path(value):
        file = path(name, value)
        return SurfaceInput(native.Surface.read(file), file)
    if _is_cells(value):
        return SurfaceInput(cells(name, value).boundary(), None)
    if isinstance(value, (tuple, list)):
        if len(value) != 2:
            raise InvalidInputError(f"{name} is a {type(value).__name__} of {len(value)}, but must be (vertices, faces)")
        return SurfaceInput(_of_arrays(name, value[0], value[1], finite), None)
    if hasattr(value, "vertices") and hasattr(value, "faces"):
        return SurfaceInput(_of_arrays(name, value.vertices, value.faces, finite), None)
    if hasattr(value, "points") and hasattr(value, "faces"):
        if not getattr(value, "is_all_triangles", True) and hasattr(value, "triangulate"):
            value = value.triangulate()
        return SurfaceInput(_of_arrays(name, value.points, _polygons(name, np.asarray(value.faces)), finite), None)
    triangles = _meshio_blocks(value, ("triangle",)) if hasattr(value, "points") and hasattr(value, "cells") else []
    if triangles:
        faces = np.concatenate([data for _, data in triangles])
        return SurfaceInput(_of_arrays(name, value.points, faces, finite), None)
    raise InvalidTypeError(f"{name} is of type {type(value).__name__}, but must be {_WHAT_SURFACES_ARE}")


def _of_cells(name: str, nodes: ArrayLike, corners: ArrayLike, regions: Optional[ArrayLike] = None) -> native.Cells:
    array = finite_points(f"the points of {name}", nodes)
    found = indices(f"the cells of {name}", corners, (4, 8), len(array))
    if regions is None:
        return native.Cells(name, array, found)
    numbers = array_of(f"the regions of {name}", regions)
    if numbers.dtype.kind not in "iu" or numbers.shape != (len(found),):
        raise InvalidInputError(f"the regions of {name} must be {len(found)} integers, one for each cell")
    return native.Cells(name, array, found, np.require(numbers, np.int32, ["C", "A"]))


def _is_cells(value: Any) -> bool:
    """Whether a value has tetrahedra or hexahedra."""
    if isinstance(value, native.Cells) or isinstance(getattr(value, "_cells", None), native.Cells):
        return True
    if isinstance(value, (tuple, list)) and len(value) == 2:
        shape = array_of("the second part", value[1]).shape
        return len(shape) == 2 and shape[1] in (4, 8)
    if hasattr(value, "celltypes"):
        return True
    if hasattr(value, "points") and hasattr(value, "cells") and not hasattr(value, "faces"):
        return bool(_meshio_blocks(value, ("tetra", "hexahedron")))
    return False


def cells(name: str, value: CellsLike) -> native.Cells:
    """What stands for tetrahedra or hexahedra."""
    if isinstance(value, native.Cells):
        return value
    own = getattr(value, "_cells", None)
    if isinstance(own, native.Cells):
        return own
    if is_path(value):
        return native.Cells.read(path(name, value))
    if isinstance(value, (tuple, list)):
        if len(value) != 2:
            raise InvalidInputError(f"{name} is a {type(value).__name__} of {len(value)}, but must be (points, cells)")
        return _of_cells(name, value[0], value[1])
    if hasattr(value, "celltypes") and hasattr(value, "points"):
        kinds = np.unique(np.asarray(value.celltypes))
        if len(kinds) != 1 or int(kinds[0]) not in _VTK_CELLS:
            raise InvalidInputError(f"{name} must have tetrahedra alone or hexahedra alone, and no other cells")
        corners = _VTK_CELLS[int(kinds[0])]
        return _of_cells(name, value.points, np.asarray(value.cells).reshape(-1, corners + 1)[:, 1:])
    if hasattr(value, "points") and hasattr(value, "cells"):
        blocks = _meshio_blocks(value, ("tetra", "hexahedron"))
        if len({kind for kind, _ in blocks}) != 1:
            raise InvalidInputError(f"{name} must have tetrahedra alone or hexahedra alone")
        return _of_cells(name, value.points, np.concatenate([data for _, data in blocks]))
    raise InvalidTypeError(f"{name} is of type {type(value).__name__}, but must be {_WHAT_CELLS_ARE}")


class SolidInput(NamedTuple):
    """A surface or cells, and the file that it is from."""

    surface: Optional[native.Surface]
    cells: Optional[native.Cells]
    path: Optional[str]


def solid(name: str, value: Any) -> SolidInput:
    """A surface, or cells whose boundary it is."""
    if is_path(value):
        file = path(name, value)
        return SolidInput(*native.read_solid(file), file)
    if _is_cells(value):
        return SolidInput(None, cells(name, value), None)
    return SolidInput(surface(name, value).surface, None, None)


def images_or_surface(name: str, value: Any, domain: native.Surface) -> Union[NDArray[np.float64], native.Surface]:
    """An image of every vertex, as an array or as a surface with the same faces."""
    if isinstance(value, np.ndarray) or (isinstance(value, (list, tuple)) and np.ndim(value[0] if value else 0) == 1):
        return finite_points(name, value)
    if is_path(value):
        return native.Surface.read_image(path(name, value), domain)
    return surface(name, value).surface
