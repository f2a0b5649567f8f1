"""Ctrl-C, progress callbacks, threads and processes."""

import signal
import sys
import threading
import time

import numpy as np
import pytest

import solidmap
from conftest import in_python, needs_native

#: Work that takes several seconds, by name; each is begun, interrupted, and timed until it has ended.
LONG = {
    "fit": "solidmap.fit(ball, images=bent, tolerance=1e-7)",
    "pair": "solidmap.boundary.pair(solidmap.shapes.cube(2.0, 40), ball)",
    "improve": "solidmap.boundary.improve(solidmap.boundary.sphere(solidmap.shapes.cube(2.0, 24)), tolerance=1e-4)",
    "sphere": "solidmap.boundary.sphere(solidmap.shapes.sphere(levels=7))",
    "evaluate": "f(np.random.default_rng(0).random((5_000_000, 3)) - 0.5)",
    "inverse": "f.inverse(np.random.default_rng(0).random((2_000_000, 3)) - 0.5)",
    "energy": "f.energy(resolution=300, energy_tolerance=1e-6)",
    "certify": "f.certify(max_cells=100_000_000)",
    "sequence": "solidmap.sequence(ball, (bent * (1 + 0.01 * k) for k in range(10_000)), resolution=40)",
    "compare": "solidmap.compare(f.boundary, methods=['mfs', 'mean_value'], resolution=120)",
    "texture": "solidmap.texture(solidmap.shapes.sphere(levels=7), colours=np.random.default_rng(0).random((163842, 3)))",
    "solve_many": "solidmap.Factor(ball).solve_many(np.stack([bent * (1 + k / 100) for k in range(200)]))",
}
if solidmap.HAS_NATIVE:
    LONG["tetrahedralise"] = "solidmap.tetrahedralise(ball, max_volume=1e-6)"
    LONG["polycube"] = "solidmap.polycube(solidmap.shapes.torus(1.0, 0.4, 120, 60), lattice=0.05)"
    LONG["offset"] = "solidmap.offset_surface(ball, 0.012)"

SCRIPT = """
import os, signal, sys, threading, time
import numpy as np, solidmap
ball = solidmap.shapes.sphere(levels=5)
bent = ball.points + 0.2 * np.sin(3 * ball.points[:, ::-1])
f = solidmap.fit(ball, images=bent)
sent = []
def interrupt():
    time.sleep(0.7)
    sent.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
try:
    {work}
    print("ended")
except KeyboardInterrupt:
    print(time.perf_counter() - sent[0])
    sys.stdout.flush()
    # The interpreter is not kept from ending either.
    start = time.perf_counter()
    print(f([0, 0, 0]).shape)
"""


@pytest.mark.parametrize("name", LONG)
def test_an_interrupt_ends_work_long_before_its_end(name):
    done = in_python(SCRIPT.format(work=LONG[name]))
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.split("\n")[:2]
    assert first != "ended", "the work was too short to be interrupted"
    # At most 0.2 s were measured; a busy machine takes longer.
    assert float(first) < 2, first
    assert second == "(3,)"


def test_a_callback_hears_of_progress_and_may_end_the_work():
    ball = solidmap.shapes.sphere(levels=5)
    bent = ball.points + 0.2 * np.sin(3 * ball.points[:, ::-1])
    heard = []
    solidmap.fit(ball, images=bent, progress=lambda *step: heard.append(step))
    assert heard and all(isinstance(name, str) and (share is None or 0 <= share <= 1) for name, share, _ in heard)
    with pytest.raises(solidmap.CancelledError):
        solidmap.fit(ball, images=bent, progress=lambda *_: False)

    class Mine(Exception):
        pass

    def raising(*_):
        raise Mine("from the callback")

    with pytest.raises(Mine, match="from the callback"):
        solidmap.fit(ball, images=bent, progress=raising)
    with pytest.raises(solidmap.InvalidTypeError, match="progress is 3"):
        solidmap.fit(ball, images=bent, progress=3)


def test_progress_is_drawn_with_tqdm_and_without(capsys, monkeypatch):
    ball = solidmap.shapes.sphere(levels=5)
    bent = ball.points + 0.2 * np.sin(3 * ball.points[:, ::-1])
    if sys.modules.get("tqdm") or __import__("importlib.util").util.find_spec("tqdm"):
        solidmap.fit(ball, images=bent, progress=True)
        assert "%" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    solidmap.fit(ball, images=bent, progress=True)
    said = capsys.readouterr().err
    assert "\r" in said and said.endswith("\r")


def test_other_threads_go_on_while_a_map_is_fitted():
    ball = solidmap.shapes.sphere(levels=5)
    counted = []
    stop = threading.Event()

    def count():
        n = 0
        while not stop.is_set():
            n += 1
            time.sleep(0.001)
        counted.append(n)

    thread = threading.Thread(target=count)
    thread.start()
    start = time.perf_counter()
    solidmap.fit(ball, images=ball.points + 0.2 * np.sin(3 * ball.points[:, ::-1]))
    took = time.perf_counter() - start
    stop.set()
    thread.join()
    assert counted[0] > 20 * took, "the lock was held"


def test_maps_are_used_by_many_threads_at_once(f, inside):
    expected, found = f(inside), []

    def work():
        for _ in range(20):
            found.append(np.array_equal(f(inside), expected) and f.inverse(inside[:3]).status.size == 3)

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 120 and all(found)


def test_the_number_of_threads_is_set_before_the_first_work():
    done = in_python(
        "import solidmap\n"
        "solidmap.set_threads(1)\n"
        "assert solidmap.threads() == 1\n"
        "solidmap.set_threads(1)\n"
        "try:\n"
        "    solidmap.set_threads(2)\n"
        "except solidmap.UnsupportedError as error:\n"
        "    print(error)\n"
        "ball = solidmap.shapes.sphere(levels=3)\n"
        "print(solidmap.fit(ball, images=ball.points).tolerance_met)\n"
    )
    assert "1 threads run already" in done.stdout and done.stdout.endswith("True\n"), done.stderr


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="no fork here")
def test_a_forked_process_gets_an_error_and_does_not_wait_forever():
    done = in_python(
        "import os, solidmap\n"
        "ball = solidmap.shapes.sphere(levels=2)\n"
        "f = solidmap.fit(ball, images=ball.points)\n"
        "if os.fork() == 0:\n"
        "    try:\n"
        "        f([0, 0, 0])\n"
        "    except solidmap.UnsupportedError as error:\n"
        "        print(str(error)[:40], flush=True)\n"
        "    os._exit(0)\n"
        "os.wait()\n"
    )
    assert done.stdout.startswith("this process was forked"), done.stderr


@needs_native
def test_cgal_and_tetgen_run_in_processes_of_their_own_that_may_die():
    done = in_python(
        "import os, signal, subprocess, threading, time, solidmap\n"
        "ball = solidmap.shapes.sphere(levels=5)\n"
        "def kill():\n"
        "    time.sleep(0.8)\n"
        "    children = subprocess.run(['pgrep', '-P', str(os.getpid())], capture_output=True, text=True).stdout.split()\n"
        "    for child in children:\n"
        "        try:\n"
        "            os.kill(int(child), signal.SIGKILL)\n"
        "        except ProcessLookupError:\n"
        "            pass\n"
        "threading.Thread(target=kill).start()\n"
        "try:\n"
        "    solidmap.tetrahedralise(ball, max_volume=1e-6)\n"
        "except solidmap.NativeError as error:\n"
        "    print('lost', error)\n"
        "print(len(solidmap.tetrahedralise(solidmap.shapes.cube()).cells) > 0)\n"
    )
    assert done.stdout.startswith("lost") and done.stdout.endswith("True\n"), done.stderr + done.stdout


def test_a_time_limit_takes_the_best_map_so_far():
    ball = solidmap.shapes.sphere(levels=4)
    bent = ball.points + 0.2 * np.sin(9 * ball.points[:, ::-1])
    # Over before the first solution is there, on any machine: that solution is the best so far.
    limited = solidmap.fit(ball, images=bent, tolerance=1e-7, time_limit=1e-6)
    assert limited.report.refinement_end == "concluded" and limited.tolerance_met is False
    with pytest.raises(solidmap.InvalidInputError, match="time_limit"):
        solidmap.fit(ball, images=bent, time_limit=-1)


def test_an_interrupt_of_the_interpreter_while_idle_is_its_own_affair():
    # The module installs no handler of its own.
    before = signal.getsignal(signal.SIGINT)
    ball = solidmap.shapes.sphere(levels=2)
    solidmap.fit(ball, images=ball.points)
    assert signal.getsignal(signal.SIGINT) is before


def test_errors_are_one_tree_and_pickle():
    import pickle

    for name in [n for n in solidmap.__all__ if n.endswith("Error")]:
        kind = getattr(solidmap, name)
        assert issubclass(kind, solidmap.SolidmapError)
        kind.__new__(kind)
        again = pickle.loads(pickle.dumps(kind("text")))
        assert type(again) is kind and "text" in str(again)
    assert issubclass(solidmap.InvalidInputError, ValueError) and issubclass(solidmap.NumericalError, RuntimeError)
    assert issubclass(solidmap.MissingFileError, FileNotFoundError) and issubclass(solidmap.InvalidTypeError, TypeError)
    with pytest.raises(FileNotFoundError):
        solidmap.Surface.load("/nowhere/a.obj")
    with pytest.raises(solidmap.UnsupportedError):
        solidmap.Surface.load("/nowhere/a.jpeg")
    with pytest.raises(solidmap.InvalidTypeError, match="maps are made by"):
        solidmap.Map()


def test_the_version_is_that_of_the_crate():
    assert solidmap.__version__.count(".") == 2 and "CGAL" in solidmap.LICENCE
