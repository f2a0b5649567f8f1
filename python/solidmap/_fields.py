"""Points, cells and fields that maps carry."""

from __future__ import annotations

from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _inputs as inputs
from . import _solidmap as native
from ._errors import InvalidInputError, UnsupportedError
from ._meshes import Mesh
from ._reports import TransferReport


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
    report : TransferReport or None
        What was carried, with checks of volumes and distributions; ``None`` for the material of a sequence.
    """

    points: NDArray[np.float64]
    cells: Optional[NDArray[np.uint32]]
    point_data: Dict[str, NDArray[np.float64]]
    cell_data: Dict[str, NDArray[np.float64]]
    status: Optional[NDArray[np.uint8]]
    report: Optional[TransferReport]

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


def by_name(found: List[Tuple[str, int, NDArray[np.float64]]]) -> Dict[str, NDArray[np.float64]]:
    return {name: values if columns == 1 else values.reshape(-1, columns) for name, columns, values in found}


def carrier(field: Any, name: str = "field") -> Tuple[Any, Any, Dict[str, Any], Dict[str, Any]]:
    """Points, cells, and fields over both, of what carries fields."""
    if field is None:
        return None, None, {}, {}
    if inputs.is_path(field):
        points, cells, over_points, over_cells = native.read_fields(inputs.path(name, field))
        if cells is not None and cells.shape[1] == 3:
            cells = None
        return points, cells, dict(by_name(over_points)), dict(by_name(over_cells))
    if inputs._is_cells(field):
        mesh = inputs.cells(name, field)
        of_points, blocks = getattr(field, "point_data", {}), getattr(field, "cell_data", {})
        of_cells = {}
        for key in blocks.keys():
            values = blocks[key]
            # meshio has a list with an array for each block of cells.
            of_cells[str(key)] = np.concatenate(values) if isinstance(values, list) else np.asarray(values)
        return mesh.points, mesh.cells, {str(k): np.asarray(of_points[k]) for k in of_points.keys()}, of_cells
    if hasattr(field, "points") and hasattr(field, "point_data"):
        data = {str(key): np.asarray(field.point_data[key]) for key in field.point_data.keys()}
        return inputs.rows_of_points(f"the points of {name}", field.points), None, data, {}
    return inputs.rows_of_points(name, field), None, {}, {}


#: Names of fields of three components that are not pushed forward as vectors.
_NOT_VECTORS = ("rgb", "color", "colors", "colour", "colours", "normal", "normals")


def fields(
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
