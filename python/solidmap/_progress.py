"""Progress of long calls: a bar, or any callable."""

from __future__ import annotations

import contextlib
import sys
from typing import Any, Callable, Iterator, Optional, Union

from ._errors import InvalidTypeError

#: What ``progress`` may be: ``True`` for a bar, or a callable that is given the name of the step, the share of it that is
#: done or ``None``, and details. It ends the work by returning ``False``.
Progress = Union[bool, None, Callable[[str, Optional[float], str], Any]]


class _Bar:
    """A bar of tqdm's."""

    def __init__(self, tqdm: Any) -> None:
        self._bar = tqdm(total=1.0, leave=False, bar_format="{desc}: {percentage:3.0f}%|{bar}| {elapsed}")

    def __call__(self, step: str, fraction: Optional[float], detail: str) -> None:
        self._bar.set_description_str(f"{step}, {detail}" if fraction is None and detail else step, refresh=False)
        self._bar.n = fraction or 0.0
        self._bar.refresh()

    def close(self) -> None:
        self._bar.close()


class _Line:
    """A line on standard error, where there is no tqdm."""

    def __init__(self) -> None:
        self._width = 0

    def __call__(self, step: str, fraction: Optional[float], detail: str) -> None:
        share = "" if fraction is None else f" {100 * fraction:.0f} %"
        text = f"{step}{share}" if fraction is not None or not detail else f"{step}: {detail}"
        sys.stderr.write("\r" + text.ljust(self._width))
        sys.stderr.flush()
        self._width = len(text)

    def close(self) -> None:
        if self._width:
            sys.stderr.write("\r" + " " * self._width + "\r")
            sys.stderr.flush()


@contextlib.contextmanager
def shown(progress: Progress) -> Iterator[Optional[Callable[[str, Optional[float], str], Any]]]:
    """The callback for the native module."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        if not callable(progress):
            raise InvalidTypeError(f"progress is {progress!r}, but must be True, False or a callable")
        yield progress
        return
    bar: Union[_Bar, _Line]
    try:
        from tqdm.auto import tqdm

        bar = _Bar(tqdm)
    except ImportError:
        bar = _Line()
    try:
        yield bar
    finally:
        bar.close()

