"""What crossing from Python costs: no copies of doubles in C order, and no work that grows with the points."""

import json
import os
import tracemalloc

import numpy as np
import pytest

import solidmap
from conftest import in_python

PEAK = """
import json
import numpy as np, solidmap
ball = solidmap.shapes.sphere(levels=2)
f = solidmap.fit(ball, images=ball.points * 2)
points = (np.random.default_rng(0).random((3_000_000, 3)) - 0.5).astype({dtype!r}, order={order!r})
f(np.zeros((300_000, 3)))

def status(name):
    line = next(line for line in open("/proc/self/status") if line.startswith(name))
    return 1024 * int(line.split()[1])

# The largest so far, which making the points has left, is forgotten.
open("/proc/self/clear_refs", "w").write("5")
before = status("VmRSS")
images = f(points)
print(json.dumps([status("VmHWM") - before, images.nbytes]))
"""


def growth(dtype, order):
    done = in_python(PEAK.format(dtype=dtype, order=order))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_doubles_in_c_order_are_not_copied_for_evaluation(f):
    points = np.random.default_rng(0).random((500_000, 3)) - 0.5
    f(points[:10])
    traced = {}
    for name, array in (("as it is", points), ("floats", points.astype("f4")), ("by columns", np.asfortranarray(points))):
        tracemalloc.start()
        f(array)
        traced[name] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # numpy's own memory is traced: what has to be converted is 12 MB, and what need not is nothing.
    assert traced["as it is"] < 100_000 < 10_000_000 < min(traced["floats"], traced["by columns"])


@pytest.mark.skipif(not os.path.exists("/proc/self/clear_refs"), reason="Linux tells the peak")
def test_the_peak_of_memory_shows_the_copy_that_is_not_made():
    plain, size = growth("f8", "C")
    copied, _ = growth("f8", "F")
    # The library's own working memory is part of both.
    assert copied - plain > 0.7 * size


def test_images_take_over_the_memory_of_the_library(f, inside):
    images = f(inside)
    assert images.flags.c_contiguous and images.flags.writeable and images.flags.aligned
    images[:] = 0
    assert f.jacobian(inside).flags.c_contiguous
