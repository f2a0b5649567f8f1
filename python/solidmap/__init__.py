"""Harmonic volumetric maps between solids: numpy in, numpy out.

Given a solid bounded by a closed triangle mesh, and an image for every vertex of it, :func:`fit` makes a map of the whole
solid that is harmonic and agrees with these images on the boundary, without a tetrahedral mesh.

>>> import solidmap
>>> ball = solidmap.shapes.sphere(levels=3)
>>> f = solidmap.fit(ball, images=ball.points * [2, 1, 1])
>>> f([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]]).shape
(2, 3)

Arrays of points are ``(n, 3)``; triangles are counter-clockwise seen from outside, and indices count from 0. Errors of a map
are fractions of the target's bounding-box diagonal, at boundary points that the fit has not seen. Options have the names and
defaults of the program's.
"""

from __future__ import annotations

import os as _os
import sys as _sys
from typing import TYPE_CHECKING as _TYPE_CHECKING

from . import _solidmap as _native
from . import boundary, shapes
from ._applications import Texture, TextureVolume, compare, mesh_metrics, sequence, texture
from ._errors import (
    CancelledError,
    FileError,
    InternalError,
    InvalidInputError,
    InvalidTypeError,
    MissingFileError,
    NativeError,
    NumericalError,
    SolidmapError,
    TooLargeError,
    UnsupportedError,
)
from ._fields import Transferred
from ._fit import Factor, FrameEvaluator, FrameImages, fit, memory_estimate
from ._map import FOLDED, NOT_FINITE, NOT_FOUND, OK, OUTSIDE, Densities, Map, Preimages
from ._meshes import CarriedMesh, Mesh, Surface, check, offset_surface, signed_distance, tetrahedralise
from ._polycube import BestAttempt, Hexmesh, Polycube, hexmesh, polycube
from ._reports import (
    BijectiveReport,
    BoundaryCheck,
    CellQuality,
    CertificateReport,
    CheckReport,
    Comparison,
    EnergyReport,
    FitReport,
    InverseReport,
    RemeshReport,
    Report,
    SequenceReport,
)
from ._solidmap import HAS_NATIVE, LICENCE, __version__, set_threads, threads
from .boundary import BoundaryMap

__all__ = [
    "BestAttempt",
    "BijectiveReport",
    "BoundaryCheck",
    "BoundaryMap",
    "CancelledError",
    "CarriedMesh",
    "CellQuality",
    "CertificateReport",
    "CheckReport",
    "Comparison",
    "Densities",
    "EnergyReport",
    "FOLDED",
    "Factor",
    "FileError",
    "FitReport",
    "FrameEvaluator",
    "FrameImages",
    "HAS_NATIVE",
    "Hexmesh",
    "InternalError",
    "InvalidInputError",
    "InvalidTypeError",
    "InverseReport",
    "LICENCE",
    "Map",
    "Mesh",
    "MissingFileError",
    "NOT_FINITE",
    "NOT_FOUND",
    "NativeError",
    "NumericalError",
    "OK",
    "OUTSIDE",
    "Polycube",
    "Preimages",
    "RemeshReport",
    "Report",
    "SequenceReport",
    "SolidmapError",
    "Surface",
    "Texture",
    "TextureVolume",
    "TooLargeError",
    "Transferred",
    "UnsupportedError",
    "__version__",
    "boundary",
    "check",
    "compare",
    "fit",
    "hexmesh",
    "memory_estimate",
    "mesh_metrics",
    "offset_surface",
    "polycube",
    "sequence",
    "set_threads",
    "shapes",
    "signed_distance",
    "tetrahedralise",
    "texture",
    "threads",
]

#: What the processes of CGAL and TetGen run: the native module alone, without numpy, which starts in some 30 ms.
_WORKER = """\
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
loader = ExtensionFileLoader("_solidmap", {path!r})
module = module_from_spec(spec_from_loader("_solidmap", loader))
loader.exec_module(module)
module.serve_calls()
"""

# A crash of either must not end this process. Where Python is part of another program, it cannot be started again.
if HAS_NATIVE and _sys.executable:
    _native.isolate(_sys.executable, ["-I", "-S", "-c", _WORKER.format(path=_native.__file__)])

# What Dask sets for its workers (``distributed.nanny.pre-spawn-environ``): their allocator gives memory back at once, and
# takes it again for each sum, which costs maps of some thousand vertices two thirds more CPU time (``benches/memory.py``).
# Another number is a user's own.
if "distributed" in _sys.modules and _os.environ.get("MALLOC_TRIM_THRESHOLD_") == "65536":
    _native.keep_freed_memory()


if _TYPE_CHECKING:
    from . import dask as dask
    from . import plot as plot


def __getattr__(name: str) -> object:
    # Imported when they are first used: they need pyvista, matplotlib or Dask.
    if name in ("dask", "plot"):
        from importlib import import_module

        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
