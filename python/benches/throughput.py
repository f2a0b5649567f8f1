"""Maps per second of two worker processes beside one process with one thread, and what a case costs besides its fit:

    python python/benches/throughput.py [CASES]

The pairs are one model, deformed by random smooth maps.
"""

import json
import statistics
import subprocess
import sys
import time

import numpy as np

import solidmap

LEVELS = 4
TOLERANCE = 1e-3


def pairs(count):
    ball = solidmap.shapes.sphere(levels=LEVELS)
    random = np.random.default_rng(1)
    for _ in range(count):
        waves = random.normal(size=(3, 3))
        yield ball, ball.points + 0.15 * np.sin(ball.points @ waves + random.normal(size=3))


def alone(count):
    """In an interpreter of its own."""
    solidmap.set_threads(1)
    cases = list(pairs(count))
    solidmap.fit(cases[0][0], images=cases[0][1], tolerance=TOLERANCE)
    start, fits = time.perf_counter(), []
    for surface, images in cases:
        began = time.perf_counter()
        solidmap.fit(surface, images=images, tolerance=TOLERANCE)
        fits.append(time.perf_counter() - began)
    print(json.dumps([time.perf_counter() - start, statistics.median(fits)]))


def main():
    from distributed import Client

    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    cases = list(pairs(count))
    found = {"cases": count, "vertices": len(cases[0][0].points), "alone": [], "two workers": [], "task": [], "fit": []}
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        solidmap.dask.fit_many(cases[:8], client, tolerance=TOLERANCE)
        for _ in range(2):
            start = time.perf_counter()
            rows = solidmap.dask.fit_many(cases, client, tolerance=TOLERANCE)
            found["two workers"].append(time.perf_counter() - start)
            assert not any(row["error"] for row in rows)
            found["task"].append(statistics.median(row["task_seconds"] for row in rows))
            found["fit"].append(statistics.median(row["seconds"]["total"] for row in rows))
            done = subprocess.run([sys.executable, __file__, "--alone", str(count)], check=True, capture_output=True, text=True)
            found["alone"].append(json.loads(done.stdout)[0])
        # What the client and the scheduler do for a case, with nothing to do in it: a surface that is refused at once.
        ball, images = cases[0]
        empty = [{"surface": ball, "images": images[:3]}] * count
        start = time.perf_counter()
        solidmap.dask.fit_many(empty, client)
        found["milliseconds for a case without a fit"] = 1000 * (time.perf_counter() - start) / count
        start = time.perf_counter()
        solidmap.dask.fit_many([{"surface": "none.obj", "target": "sphere"}] * count, client)
        found["the same, with names of files"] = 1000 * (time.perf_counter() - start) / count
    found["speed-up"] = min(found["alone"]) / min(found["two workers"])
    print(json.dumps(found))


if __name__ == "__main__":
    if "--alone" in sys.argv:
        alone(int(sys.argv[-1]))
    else:
        main()
