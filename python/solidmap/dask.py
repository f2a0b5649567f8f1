"""Many maps on a cluster of Dask (extra ``dask``).

Maps, boundary maps, factors and reports pickle, so that ``client.map(solidmap.fit, surfaces, images=...)`` and
``f(points)`` with an array of Dask's work as they are. The functions here are for runs of thousands of cases: each case has
one row, written as it ends; a case that fails has a row with the reason; a run that was stopped goes on where it was.

Dask's own deployments start the workers: ``LocalCluster`` here, ``dask_jobqueue.SLURMCluster`` on Slurm,
``dask_kubernetes.operator.KubeCluster`` on Kubernetes (``docs/python.md`` has settings).
"""

from __future__ import annotations

import csv
import json
import os
import re
import threading
import time
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

import numpy as np

from . import _applications as applications
from . import _inputs as inputs
from . import _options as options
from . import _solidmap as native
from ._applications import compare
from ._applications import sequence as alone
from ._errors import InvalidInputError, SolidmapError, UnsupportedError
from ._fit import fit
from ._inputs import PathLike
from .boundary import BoundaryMap

if TYPE_CHECKING:
    from typing_extensions import Literal

__all__ = ["compare_many", "fit_many", "sequence"]

#: A row of results: plain numbers and text.
Row = Dict[str, Any]
#: A case: ``(surface, images)``, or a dictionary of the keyword arguments with ``surface`` and, at will, ``name``.
Case = Union[Tuple[Any, Any], Dict[str, Any]]

#: Cases that are sent ahead, for each thread of the cluster: enough that none waits, few enough that the scheduler does not
#: hold the surfaces of all.
_AHEAD = 3
#: Share of a worker's memory that its maps may take.
_SHARE_OF_MEMORY = 0.8


def _client(client: Any) -> Any:
    if client is not None:
        return client
    try:
        from distributed import get_client
    except ImportError:
        raise UnsupportedError("this needs Dask: pip install solidmap[dask]") from None
    try:
        return get_client()
    except ValueError:
        raise InvalidInputError("client is missing: start one, as distributed.Client()") from None


class _Rows:
    """The rows of a run in a folder: ``rows.jsonl`` as they come, ``rows.csv`` or ``rows.parquet`` of all at the end."""

    def __init__(self, folder: Optional[PathLike], table: str) -> None:
        self.rows: List[Row] = []
        self.folder = None if folder is None else inputs.path("output", folder)
        self.table = options.choice("table", table, ["csv", "parquet"])
        self._file: Any = None
        if self.folder is None:
            return
        if self.table == "parquet":
            try:
                import pyarrow.parquet  # noqa: F401
            except ImportError:
                raise UnsupportedError('table="parquet" needs pyarrow: pip install pyarrow') from None
        os.makedirs(self.folder, exist_ok=True)
        name = os.path.join(self.folder, "rows.jsonl")
        whole = 0
        if os.path.exists(name):
            with open(name, "rb") as file:
                for line in file:
                    # A line that was cut off when the run was stopped is not a row: its case is done again.
                    if not line.endswith(b"\n"):
                        break
                    self.rows.append(json.loads(line))
                    whole += len(line)
        self._file = open(name, "r+b" if os.path.exists(name) else "w+b")
        self._file.truncate(whole)
        self._file.seek(whole)

    def keep(self, is_kept: Callable[[Row], bool]) -> None:
        """Forgets rows, whose cases are done again."""
        kept = [row for row in self.rows if is_kept(row)]
        if len(kept) == len(self.rows):
            return
        self.rows = kept
        if self._file is not None:
            self._file.seek(0)
            self._file.truncate()
            self._file.write(b"".join(json.dumps(row).encode() + b"\n" for row in kept))
            self._file.flush()

    def add(self, row: Row) -> None:
        self.rows.append(row)
        if self._file is not None:
            self._file.write(json.dumps(row).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def close(self, order: Dict[Any, int]) -> List[Row]:
        """Writes the table, and returns the rows in the order of the cases."""
        self.rows.sort(key=lambda row: order.get(row["case"], len(order)))
        if self._file is None or self.folder is None:
            return self.rows
        self._file.close()
        flat = [_flat(row) for row in self.rows]
        names: List[str] = list(dict.fromkeys(name for row in flat for name in row))
        target = os.path.join(self.folder, f"rows.{self.table}")
        if self.table == "parquet":
            import pyarrow
            from pyarrow import parquet

            columns = {name: [row.get(name) for row in flat] for name in names}
            parquet.write_table(pyarrow.table(columns), target + ".part")
            os.replace(target + ".part", target)
            return self.rows
        with open(target + ".part", "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(flat)
        os.replace(target + ".part", target)
        return self.rows


def _flat(row: Row, before: str = "") -> Row:
    """A row whose dictionaries are columns of their own, as ``boundary_error.rms``."""
    found: Row = {}
    for name, value in row.items():
        if isinstance(value, dict):
            found.update(_flat(value, f"{before}{name}."))
        elif isinstance(value, list):
            found[before + name] = json.dumps(value)
        else:
            found[before + name] = value
    return found


def _prepare_worker() -> Optional[int]:
    """Sets the threads of this process to those of its worker, and returns the memory that one task may take."""
    from distributed import get_worker

    try:
        worker = get_worker()
    except ValueError:
        return None
    threads = worker.state.nthreads
    try:
        # All tasks of a worker share its threads, so that no core has more than one.
        native.set_threads(threads)
    except UnsupportedError:
        pass
    limit = worker.memory_manager.memory_limit
    return None if not limit else int(_SHARE_OF_MEMORY * limit / threads)


def _guarded(name: Any, work: Callable[..., Row], *arguments: Any) -> Row:
    """Runs a case on a worker; its failure is a row."""
    start = time.perf_counter()
    row: Row = {"case": name, "error": None, "error_type": None}
    try:
        limit = _prepare_worker()
        row.update(work(limit, *arguments))
    except (SolidmapError, MemoryError, OSError, ValueError, TypeError) as error:
        row["error"], row["error_type"] = str(error), type(error).__name__
    row["task_seconds"] = time.perf_counter() - start
    row["process"] = os.getpid()
    return row


def _run(
    client: Any,
    rows: _Rows,
    tasks: Iterable[Tuple[Any, Callable[..., Row], Tuple[Any, ...]]],
    on_row: Optional[Callable[[Row], Any]],
) -> Dict[Any, int]:
    """Runs the tasks that have no row yet, and adds the rows as they end; returns the order of all tasks."""
    from distributed import as_completed

    has_row = {row["case"] for row in rows.rows}
    order: Dict[Any, int] = {}

    def new() -> Iterator[Any]:
        for name, work, arguments in tasks:
            if name in order:
                raise InvalidInputError(f"two cases have the name {name!r}")
            order[name] = len(order)
            if name not in has_row:
                # Not pure: the same arguments are another run of the case, and not an earlier result.
                future = client.submit(_guarded, name, work, *arguments, pure=False)
                waiting[future.key] = name
                yield future

    waiting: Dict[str, Any] = {}
    queue = new()
    threads = sum(client.nthreads().values()) or 1
    first = [future for _, future in zip(range(_AHEAD * threads), queue)]
    running = as_completed(first)
    try:
        for future in running:
            name = waiting.pop(future.key)
            try:
                row = future.result()
            except Exception as error:
                # The worker was killed too often, or the scheduler lost the task.
                row = {"case": name, "error": str(error) or repr(error), "error_type": type(error).__name__}
            rows.add(row)
            if on_row is not None:
                on_row(row)
            future.release()
            for following in queue:
                running.add(following)
                break
    finally:
        if waiting:
            client.cancel(list(waiting))
    for _ in queue:
        pass
    return order


def _named(cases: Iterable[Case], first: str, second: str) -> Iterator[Tuple[str, Dict[str, Any]]]:
    for index, case in enumerate(cases):
        if isinstance(case, dict):
            settings = dict(case)
            name = settings.pop("name", None)
        else:
            try:
                one, two = case
            except (TypeError, ValueError):
                raise InvalidInputError(f"cases[{index}] is neither a pair nor a dictionary") from None
            settings, name = {first: one, second: two}, None
        yield str(index) if name is None else str(name), {
            key: value if inputs.is_path(value) else _portable(value) for key, value in settings.items()
        }


def _portable(value: Any) -> Any:
    """What is sent to a worker."""
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _file_name(name: str) -> str:
    return re.sub(r"[^\w.+-]", "_", name)


def _fit_case(limit: Optional[int], settings: Dict[str, Any], file: Optional[str]) -> Row:
    settings = dict(settings)
    if limit is not None and settings.get("memory") is None:
        settings["memory"] = limit
    surface = settings.pop("surface", None)
    made = fit(surface, **settings)
    if file is not None:
        made.save(file)
    found = made.report.as_dict()
    return {"map": file, "tolerance_met": made.tolerance_met, **found}


def fit_many(
    pairs: Iterable[Case],
    client: Any = None,
    *,
    output: Optional[PathLike] = None,
    save_maps: bool = True,
    table: Literal["csv", "parquet"] = "csv",
    retry_failed: bool = False,
    on_row: Optional[Callable[[Row], Any]] = None,
    **settings: Any,
) -> List[Row]:
    """Fit many maps on the workers of a cluster.

    Parameters
    ----------
    pairs : iterable of (surface, images) or of dict
        The cases: a surface and the images of its vertices; or the arguments of :func:`solidmap.fit`, with a ``name``
        (by default the number of the case). Files are read by the workers, arrays are sent to them.
    client : distributed.Client, optional
        The cluster; by default the current one.
    output : path, optional
        Folder for the rows, and for the maps in its folder ``maps``. A run into a folder that has rows already does only
        the cases that have none.
    save_maps : bool
        Write the maps; the workers have to see the folder.
    table : {"csv", "parquet"}
        The table that is written at the end, beside ``rows.jsonl``; parquet needs pyarrow.
    retry_failed : bool
        Do cases again whose rows say that they failed.
    on_row : callable, optional
        Called with each row as it comes.
    **settings
        More arguments of :func:`solidmap.fit`, for all cases.

    Returns
    -------
    list of dict
        A row for each case, in their order: the report of the fit, or ``error`` and ``error_type``.

    Examples
    --------
    >>> import solidmap, distributed
    >>> ball = solidmap.shapes.sphere(levels=2)
    >>> pairs = [(ball, ball.points * [1 + 0.1 * k, 1, 1]) for k in range(3)] + [(ball, ball.points[:5])]
    >>> with distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=None) as client:  # doctest: +DASK
    ...     rows = solidmap.dask.fit_many(pairs, client)
    >>> [row["error_type"] for row in rows]  # doctest: +DASK
    [None, None, None, 'InvalidInputError']
    """
    client = _client(client)
    rows = _Rows(output, table)
    if retry_failed:
        rows.keep(lambda row: row["error"] is None)
    maps = None
    if rows.folder is not None and save_maps:
        maps = os.path.join(os.path.abspath(rows.folder), "maps")
        os.makedirs(maps, exist_ok=True)

    def tasks() -> Iterator[Tuple[str, Callable[..., Row], Tuple[Any, ...]]]:
        for name, case in _named(pairs, "surface", "images"):
            file = None if maps is None else os.path.join(maps, _file_name(name) + ".safetensors")
            yield name, _fit_case, ({**settings, **case}, file)

    return rows.close(_run(client, rows, tasks(), on_row))


def _compare_case(limit: Optional[int], settings: Dict[str, Any]) -> Row:
    settings = dict(settings)
    if limit is not None and settings.get("memory") is None:
        settings["memory"] = limit
    boundary, surface, images = (settings.pop(name, None) for name in ("boundary", "surface", "images"))
    if boundary is None:
        boundary = BoundaryMap(surface, images)
    found = compare(boundary, **settings).as_dict()
    found["methods"] = {row.pop("name"): row for row in found["methods"]}
    return found


def compare_many(
    cases: Iterable[Case],
    client: Any = None,
    *,
    output: Optional[PathLike] = None,
    table: Literal["csv", "parquet"] = "csv",
    retry_failed: bool = False,
    on_row: Optional[Callable[[Row], Any]] = None,
    **settings: Any,
) -> List[Row]:
    """Compare methods on many boundary maps, on the workers of a cluster.

    Parameters
    ----------
    cases : iterable of (surface, images) or of dict
        The cases; or the arguments of :func:`solidmap.compare`, with ``boundary``, or ``surface`` and ``images``, and a
        ``name``.
    client, output, table, retry_failed, on_row
        As for :func:`fit_many`.
    **settings
        More arguments of :func:`solidmap.compare`, for all cases.

    Returns
    -------
    list of dict
        A row for each case: the report of the comparison, with the figures by method in ``methods``.
    """
    client = _client(client)
    rows = _Rows(output, table)
    if retry_failed:
        rows.keep(lambda row: row["error"] is None)
    tasks = (
        (name, _compare_case, ({**settings, **case},)) for name, case in _named(cases, "surface", "images")
    )
    return rows.close(_run(client, rows, tasks, on_row))


#: References that this process has factored, by their number, each used by one thread at a time.
_prepared: Dict[str, Tuple[native.Sequence, native.Surface, threading.Lock]] = {}
_preparing = threading.Lock()


def _frames_case(
    limit: Optional[int],
    key: str,
    reference: Any,
    settings: Dict[str, Any],
    first: int,
    frames: Sequence[Any],
) -> Row:
    with _preparing:
        if key not in _prepared:
            of_method, arguments = dict(settings["method"]), settings["arguments"]
            if limit is not None and of_method["memory"] is None:
                of_method["memory"] = limit
            solid = inputs.solid("reference", reference)
            surface = solid.surface
            if surface is None:
                assert solid.cells is not None
                surface = solid.cells.boundary()
            is_tets = solid.cells is not None and solid.cells.cells.shape[1] == 4
            sequence_ = native.Sequence(surface, of_method, arguments, solid.cells if is_tets else None, None)
            # One at a time: another run's is not needed any more.
            _prepared.clear()
            _prepared[key] = (sequence_, surface, threading.Lock())
        prepared, surface, lock = _prepared[key]
    with lock:
        block = [(first + index, frame) for index, frame in enumerate(frames)]
        found, _ = applications._block(prepared, surface, block, settings["fps"], None)
    return {"frames": found}


def sequence(
    reference: Any,
    frames: Iterable[Any],
    client: Any = None,
    *,
    output: Optional[PathLike] = None,
    frames_per_block: int = 32,
    table: Literal["csv", "parquet"] = "csv",
    retry_failed: bool = False,
    fps: float = 1.0,
    on_row: Optional[Callable[[Row], Any]] = None,
    **settings: Any,
) -> List[Row]:
    """Measure the frames of a long sequence, block by block, on the workers of a cluster.

    Each worker factors the reference once. Energies agree with those of :func:`solidmap.sequence` to the tolerance of the
    fit, and not to the last digit: which sources are added depends on the frames that a worker has seen.

    Parameters
    ----------
    reference : surface, tetrahedra or path
        What frames are compared with.
    frames : iterable of array_like or paths
        As for :func:`solidmap.sequence`; paths are read by the workers.
    client, output, table, retry_failed, on_row
        As for :func:`fit_many`, with a row for each block in ``rows.jsonl``.
    frames_per_block : int
        Frames that are one task.
    fps : float
        Frames per second.
    **settings
        More arguments of :func:`solidmap.sequence`, but ``material``, which the rows have no place for.

    Returns
    -------
    list of dict
        A row for each frame, as in ``SequenceReport.frames``; frames of a block that failed have ``skipped``.
    """
    client = _client(client)
    size = options.count("frames_per_block", frames_per_block, 1)
    not_here = ("material", "progress", "fps")
    defaults = {name: value for name, value in (alone.__kwdefaults__ or {}).items() if name not in not_here}
    method, arguments = applications._sequence_options(**{**defaults, **settings, "frames_per_block": size})
    shared_settings = {"fps": options.number("fps", fps), "method": method, "arguments": arguments}
    # Sent to each worker once, and not with each block.
    shared = reference if inputs.is_path(reference) else client.scatter(reference, broadcast=True)
    key = f"{os.getpid()}-{id(shared_settings)}-{time.time_ns()}"
    rows = _Rows(output, table)
    if retry_failed:
        rows.keep(lambda row: row["error"] is None)
    sizes: Dict[str, int] = {}

    def tasks() -> Iterator[Tuple[str, Callable[..., Row], Tuple[Any, ...]]]:
        for block in applications._frames_in_blocks(frames, size):
            name = f"block {block[0][0]}"
            sizes[name] = len(block)
            given = [_portable(frame) if inputs.is_path(frame) else np.asarray(frame) for _, frame in block]
            yield name, _frames_case, (key, shared, shared_settings, block[0][0], given)

    blocks = rows.close(_run(client, rows, tasks(), on_row))
    found: List[Row] = []
    for block in blocks:
        first = int(block["case"].split()[1])
        if block["error"] is None:
            found.extend(block["frames"])
            continue
        for frame in range(first, first + sizes.get(block["case"], 0)):
            row = {**applications._NOT_MEASURED, "frame": frame, "time": frame / fps, "file": None}
            found.append({**row, "skipped": block["error"]})
    return sorted(found, key=lambda row: row["frame"])
