"""What crossing from Python costs, beside Rust and the program:

    python python/benches/cost.py MODEL [PROGRAM [BENCH_EVALUATE]]

Fits the model (a path) to itself, bent, with the program and here in turn; then evaluates the map at a million points, the
CPU time here beside that of the example `bench_evaluate`; then at one.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import solidmap


def main():
    model = sys.argv[1]
    program = sys.argv[2] if len(sys.argv) > 2 else "solidmap"
    bench = sys.argv[3] if len(sys.argv) > 3 else None
    with tempfile.TemporaryDirectory() as folder:
        domain, image, path = (os.path.join(folder, name) for name in ("domain.ply", "image.ply", "map.safetensors"))
        surface = solidmap.Surface.load(model)
        # In the unit ball's box, so that the points lie in the domain's neighbourhood.
        points = surface.points
        points = 1.6 * (points - (points.min(0) + points.max(0)) / 2) / np.ptp(points, axis=0).max()
        bent = points + 0.1 * np.sin(2 * points[:, ::-1])
        solidmap.Surface(points, surface.faces).save(domain)
        solidmap.Surface(bent, surface.faces).save(image)
        fits(program, domain, image, path)
        f = solidmap.Map.load(path)
        million(f, bench, path)
        one(f)


def fits(program, domain, image, path, rounds=5):
    times = {"program": [], "python": []}
    cpu = {"program": [], "python": []}
    here = os.path.join(os.path.dirname(path), "python.safetensors")
    code = f"import solidmap; solidmap.fit({domain!r}, images={image!r}).save({here!r})"
    commands = {
        "program": [program, "fit", domain, "--image", image, "-o", path, "--json"],
        "python": [sys.executable, "-c", code],
    }
    for _ in range(rounds):
        for name, command in commands.items():
            before, start = os.times(), time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            times[name].append(time.perf_counter() - start)
            after = os.times()
            cpu[name].append(after.children_user + after.children_system - before.children_user - before.children_system)
    started = []
    for _ in range(rounds):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import solidmap"], check=True)
        started.append(time.perf_counter() - start)
    with open(path, "rb") as first, open(here, "rb") as second:
        same = first.read() == second.read()
    report({"fit": {
        name: {"seconds": statistics.median(times[name]), "least": min(times[name]), "cpu": statistics.median(cpu[name])}
        for name in times
    }, "import": statistics.median(started), "same bytes": same})


def million(f, bench, path, runs=9):
    steps = np.array([0.8191725134, 0.6710436067, 0.5497004779])
    points = 0.5 * (2.0 * (np.arange(1_000_000)[:, None] * steps % 1.0) - 1.0)
    f(points)

    def measure():
        times = []
        for _ in range(runs):
            start = time.process_time()
            f(points)
            times.append(time.process_time() - start)
        return statistics.median(times)

    def rust():
        done = subprocess.run([bench, path, "1000000", str(runs)], check=True, capture_output=True, text=True)
        return json.loads(done.stdout)["evaluate"]

    mine, others = [], []
    for _ in range(3):
        mine.append(measure())
        if bench:
            others.append(rust())
    report({"million points, CPU seconds": {"python": mine, "rust": others}, "sources": len(f.sources)})


def one(f, rounds=20_000):
    def best(work):
        times = []
        for _ in range(rounds):
            start = time.perf_counter()
            work()
            times.append(time.perf_counter() - start)
        times.sort()
        return 1e6 * times[len(times) // 2]

    # A map of few sources, whose sum takes next to nothing: what is left is the call.
    ball = solidmap.shapes.sphere(levels=0)
    small = solidmap.fit(ball, images=ball.points)
    row = np.zeros((1, 3))
    many = np.zeros((1000, 3))
    report({"one point, microseconds": {
        "call, 12 sources": best(lambda: small(row)),
        "native call, 12 sources": best(lambda: small._map.evaluate(row, None)),
        "a point of 1000, 12 sources": best(lambda: small(many)) / 1000,
        "call, all sources": best(lambda: f(row)),
    }})


def report(found):
    print(json.dumps(found))


if __name__ == "__main__":
    main()
