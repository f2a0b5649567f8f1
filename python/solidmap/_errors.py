"""The exceptions of the package: one tree, whose classes are also what Python raises in like cases."""

from __future__ import annotations

from typing import Any


class SolidmapError(Exception):
    """Base of all errors that solidmap raises itself."""


class InvalidInputError(SolidmapError, ValueError):
    """A value that cannot be used: a surface that bounds no solid, an index or a setting out of range."""


class InvalidTypeError(SolidmapError, TypeError):
    """An argument of a type, or an array of a dtype, that cannot be used."""


class FileError(SolidmapError, OSError):
    """A file that cannot be read or written."""


class MissingFileError(FileError, FileNotFoundError):
    """A file that is not there."""


class UnsupportedError(SolidmapError, RuntimeError):
    """What this build, this file or this map does not offer."""


class NumericalError(SolidmapError, RuntimeError):
    """No result was found: a system without a solution, a mesh that could not be repaired."""

    #: What :func:`solidmap.polycube` ended with, as a :class:`solidmap.BestAttempt`.
    best_attempt: Any = None


# The other way round, its ``__new__`` would refuse it, which what sends exceptions between processes may call.
class TooLargeError(MemoryError, SolidmapError):
    """More memory would be needed than is allowed."""


class CancelledError(SolidmapError, RuntimeError):
    """The progress callback ended the work by returning ``False``."""


class NativeError(SolidmapError, RuntimeError):
    """CGAL or TetGen failed."""


class InternalError(SolidmapError, RuntimeError):
    """A bug in solidmap."""
