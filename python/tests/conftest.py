"""What the tests share."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import solidmap

ROOT = Path(__file__).parents[2]

needs_native = pytest.mark.skipif(not solidmap.HAS_NATIVE, reason="this build has no CGAL and TetGen")


def found_program():
    """The program of this build: the one that is named, in the target folder, or on the PATH."""
    named = os.environ.get("SOLIDMAP_PROGRAM")
    built = ROOT / "target" / "release" / "solidmap"
    return named or (str(built) if built.exists() else shutil.which("solidmap"))


@pytest.fixture(scope="session")
def program():
    """Runs the program with arguments, and returns what it printed."""
    path = found_program()
    if path is None:
        pytest.skip("the program is not built: cargo build --release, or SOLIDMAP_PROGRAM")

    def run(*arguments, codes=(0,)):
        done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, timeout=600)
        assert done.returncode in codes, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def ball():
    return solidmap.shapes.sphere(levels=3)


@pytest.fixture(scope="session")
def images(ball):
    """Images under a map that is no polynomial of degree one."""
    p = ball.points
    return np.column_stack([2 * p[:, 0], p[:, 1], p[:, 2] + 0.3 * p[:, 0] * p[:, 1]])


@pytest.fixture(scope="session")
def f(ball, images):
    return solidmap.fit(ball, images=images)


@pytest.fixture(scope="session")
def inside():
    """Points of the unit ball."""
    random = np.random.default_rng(7)
    directions = random.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return 0.9 * directions * random.random((200, 1)) ** (1 / 3)


@pytest.fixture(scope="session")
def tets(ball):
    """Tetrahedra that fill the ball: the triangles and the centre."""
    points = np.vstack([ball.points, [0, 0, 0]])
    centre = np.full((len(ball.faces), 1), len(ball.points))
    return solidmap.Mesh(points, np.hstack([centre, ball.faces]))


def in_python(code, **environment):
    """Runs code in an interpreter of its own."""
    folder = str(Path(solidmap.__file__).parents[1])
    paths = os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": paths, **environment},
    )
