"""What an allocator that gives memory back at once costs maps, as it does with the threshold that Dask sets for its workers:

    python python/benches/memory.py [LEVELS] [MAPS]

Prints, for each setting: CPU seconds and page faults of a map, and the resident memory after maps and at its largest.
"""

import json
import os
import resource
import subprocess
import sys

import numpy as np

# The threshold, and whether importing solidmap takes it back: it does so for Dask's own number alone.
SETTINGS = {"Dask's, as a worker of solidmap has it": "65536", "Dask's": "65537", "none": None}


def measure(levels, maps):
    import distributed  # noqa: F401  as a worker has it, before solidmap
    import solidmap

    solidmap.set_threads(1)
    ball, random = solidmap.shapes.sphere(levels=levels), np.random.default_rng(5)

    def fit():
        solidmap.fit(ball, images=ball.points + 0.1 * np.sin(ball.points @ random.normal(size=(3, 3))))

    fit()
    before = resource.getrusage(resource.RUSAGE_SELF)
    for _ in range(maps):
        fit()
    after = resource.getrusage(resource.RUSAGE_SELF)
    with open("/proc/self/statm") as file:
        resident = int(file.read().split()[1]) * resource.getpagesize()
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "CPU seconds of a map": round(cpu / maps, 3),
        "of them in the system": round((after.ru_stime - before.ru_stime) / maps, 3),
        "page faults of a map": (after.ru_minflt - before.ru_minflt) // maps,
        "resident after maps, MiB": resident >> 20,
        "resident at most, MiB": after.ru_maxrss >> 10,
    }


def main():
    levels, maps = (int(text) for text in (sys.argv[1:] + ["4", "12"][len(sys.argv) - 1 :]))
    for name, threshold in SETTINGS.items():
        environment = {key: value for key, value in os.environ.items() if key != "MALLOC_TRIM_THRESHOLD_"}
        if threshold is not None:
            environment["MALLOC_TRIM_THRESHOLD_"] = threshold
        command = [sys.executable, __file__, "--measure", str(levels), str(maps)]
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
        print(json.dumps({"threshold": name, "levels": levels, **json.loads(done.stdout)}))


if __name__ == "__main__":
    if "--measure" in sys.argv:
        print(json.dumps(measure(*map(int, sys.argv[2:]))))
    else:
        main()
