"""Runs on a cluster of processes: all rows, once each, whatever happens to cases and workers."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import solidmap

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit="2GiB"
    ) as cluster, distributed.Client(cluster) as client:
        yield client


def pairs_of(ball, count, amount=0.1):
    random = np.random.default_rng(5)
    for _ in range(count):
        waves = random.normal(size=(3, 3))
        yield ball, ball.points + amount * np.sin(ball.points @ waves)


def test_maps_and_functions_go_to_workers_as_they_are(client, f, inside, ball, images):
    array = pytest.importorskip("dask.array")
    points = array.from_array(inside, chunks=(50, 3))
    assert np.array_equal(array.map_blocks(f, points, dtype=float).compute(), f(inside))
    assert np.array_equal(points.map_blocks(f, dtype=float).compute(), f(inside))
    found = client.gather(client.map(solidmap.fit, [ball, ball], images=images, tolerance=1e-2))
    # Another number of threads may change the last digits.
    here = solidmap.fit(ball, images=images, tolerance=1e-2)
    assert np.allclose(found[0](inside), here(inside), atol=1e-12)
    factor = client.submit(solidmap.Factor, ball, tolerance=1e-2).result()
    assert factor.solve(images).tolerance_met


def test_each_case_has_a_row_and_failures_do_not_end_the_run(client, tmp_path):
    ball = solidmap.shapes.sphere(levels=2)
    cases = [{"name": f"case {k}", "surface": s, "images": i} for k, (s, i) in enumerate(pairs_of(ball, 12))]
    cases[3]["images"] = cases[3]["images"][:5]
    cases[7] = {"name": "case 7", "surface": "/nowhere/a.obj", "target": "sphere"}
    heard = []
    rows = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=1e-2, on_row=heard.append)
    assert [row["case"] for row in rows] == [f"case {k}" for k in range(12)] and len(heard) == 12
    assert [k for k, row in enumerate(rows) if row["error"]] == [3, 7]
    assert rows[3]["error_type"] == "InvalidInputError" and rows[7]["error_type"] == "MissingFileError"
    assert {row["process"] for row in rows} != {os.getpid()}
    alone = solidmap.fit(ball, images=cases[0]["images"], tolerance=1e-2)
    saved = solidmap.Map.load(rows[0]["map"])
    assert np.allclose(saved(ball.points), alone(ball.points), atol=1e-12)
    with open(tmp_path / "rows.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 12 and float(table[0]["boundary_error.p99"]) == rows[0]["boundary_error"]["p99"]
    # A run that goes on does nothing twice.
    again = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=1e-2, on_row=heard.append)
    assert again == rows and len(heard) == 12
    # What had failed is done again where that is asked for, with what is wrong repaired.
    cases[3]["images"] = ball.points
    repaired = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=1e-2, retry_failed=True)
    assert [k for k, row in enumerate(repaired) if row["error"]] == [7]
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert sorted(json.loads(line)["case"] for line in lines) == sorted(row["case"] for row in rows)


def test_a_line_that_was_cut_off_is_done_again(client, tmp_path):
    ball = solidmap.shapes.sphere(levels=1)
    cases = list(pairs_of(ball, 4))
    first = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=0.1, save_maps=False)
    path = tmp_path / "rows.jsonl"
    content = path.read_bytes()
    path.write_bytes(content[:-30])
    second = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=0.1, save_maps=False)
    assert [row["case"] for row in second] == [row["case"] for row in first] == ["0", "1", "2", "3"]
    assert len(path.read_text().splitlines()) == 4


def test_a_worker_that_is_killed_loses_no_case_and_doubles_none(tmp_path):
    ball = solidmap.shapes.sphere(levels=3)
    cases = list(pairs_of(ball, 16))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        killed = []

        def kill(row):
            if not killed:
                killed.append(row["process"])
                os.kill(row["process"], signal.SIGKILL)

        rows = solidmap.dask.fit_many(cases, client, output=tmp_path, tolerance=1e-3, on_row=kill)
    assert killed and [row["case"] for row in rows] == [str(k) for k in range(16)]
    assert all(row["error"] is None for row in rows)
    assert {row["process"] for row in rows} - set(killed)
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 16


def test_a_run_that_is_ended_goes_on_where_it_stopped(tmp_path):
    code = (
        "import numpy as np, solidmap, distributed, sys\n"
        "if __name__ == '__main__':\n"
        "    ball = solidmap.shapes.sphere(levels=2)\n"
        "    cases = [(ball, ball.points * (1 + k / 100)) for k in range(30)]\n"
        "    with distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=None) as client:\n"
        "        def tell(row):\n"
        "            print(row['case'], flush=True)\n"
        f"        rows = solidmap.dask.fit_many(cases, client, output={str(tmp_path / 'out')!r}, on_row=tell)\n"
        "        print('all', len(rows), flush=True)\n"
    )
    script = tmp_path / "run.py"
    script.write_text(code)
    environment = {**os.environ, "PYTHONPATH": os.path.dirname(os.path.dirname(solidmap.__file__))}
    first = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=environment)
    seen = [first.stdout.readline().strip() for _ in range(5)]
    first.kill()
    first.wait()
    time.sleep(0.2)
    second = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, timeout=300)
    done = second.stdout.split("\n")
    assert "all 30" in done, second.stderr
    # What the first had written is not done again.
    assert not set(seen) & set(done[:-2])
    cases = [json.loads(line)["case"] for line in (tmp_path / "out" / "rows.jsonl").read_text().splitlines()]
    assert sorted(cases, key=int) == [str(k) for k in range(30)]


def test_dask_arrays_of_points_are_mapped_block_by_block(client):
    da = pytest.importorskip("dask.array")
    ball = solidmap.shapes.sphere(levels=2)
    f = solidmap.fit(ball, images=ball.points * [2, 1, 1], tolerance=1e-2)
    points = da.from_array(0.5 * ball.points, chunks=(50, 3))
    mapped = f(points)
    assert isinstance(mapped, da.Array) and mapped.dtype == np.float64
    assert mapped.shape == points.shape and mapped.chunks == points.chunks
    assert np.allclose(mapped.compute(), f(0.5 * ball.points))
    # Coordinates in blocks of their own.
    jacobians = f.jacobian(points.rechunk((50, 1)), map="harmonic")
    assert jacobians.shape == (*points.shape, 3) and jacobians.chunks == (points.chunks[0], (3,), (3,))
    assert np.allclose(jacobians.compute(), f.jacobian(0.5 * ball.points))
    with pytest.raises(solidmap.InvalidInputError, match=r"points has the shape \(162, 2\)"):
        f(points[:, :2])


def test_rows_are_written_as_parquet_too(client, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    ball = solidmap.shapes.sphere(levels=1)
    cases = [*pairs_of(ball, 2), (ball, ball.points[:4])]
    rows = solidmap.dask.fit_many(cases, client, output=tmp_path, table="parquet", tolerance=0.1, save_maps=False)
    table = parquet.read_table(tmp_path / "rows.parquet").to_pydict()
    assert table["case"] == ["0", "1", "2"] and table["error_type"] == [None, None, "InvalidInputError"]
    assert table["boundary_error.rms"] == [*(row["boundary_error"]["rms"] for row in rows[:2]), None]
    assert not (tmp_path / "rows.parquet.part").exists()


def test_workers_keep_the_memory_that_maps_free(client):
    def faults(_=None):
        import resource

        import solidmap

        ball = solidmap.shapes.sphere(levels=3)
        for k in range(4):
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            solidmap.fit(ball, images=ball.points * [1 + 0.1 * k, 1, 1])
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    # With the threshold that Dask sets, each map took all its memory from the system again, a page at a time: some 20 000
    # times.
    assert client.submit(faults, pure=False).result() < 5000


def test_names_are_unique_and_cases_are_pairs(client):
    ball = solidmap.shapes.sphere(levels=1)
    with pytest.raises(solidmap.InvalidInputError, match="two cases have the name 'a'"):
        solidmap.dask.fit_many([{"name": "a", "surface": ball, "images": ball.points}] * 2, client)
    with pytest.raises(solidmap.InvalidInputError, match=r"cases\[0\] is neither"):
        solidmap.dask.fit_many([3], client)
    assert solidmap.dask.fit_many([], client) == []


def test_the_memory_of_a_worker_limits_its_maps(client, tmp_path):
    ball = solidmap.shapes.sphere(levels=4)
    rows = solidmap.dask.fit_many([(ball, ball.points)], client, memory="1MB")
    assert rows[0]["error_type"] == "TooLargeError" and "memory" in rows[0]["error"]
    limits = client.run(lambda dask_worker: dask_worker.memory_manager.memory_limit)
    assert set(limits.values()) == {2 << 30}
    assert client.submit(solidmap.dask._prepare_worker, pure=False).result() == int(0.8 * (2 << 30))
    assert set(client.run(solidmap.threads).values()) == {1}, "a worker of one thread works on one"


def test_frames_on_a_cluster_have_the_energies_of_one_process(client, tmp_path):
    ball = solidmap.shapes.sphere(levels=2)
    frames = [ball.points * [1 + 0.02 * k, 1, 1 - 0.01 * k] for k in range(11)] + [ball.points[:4]]
    rows = solidmap.dask.sequence(ball, frames, client, output=tmp_path, frames_per_block=3, resolution=12, fps=25)
    alone = solidmap.sequence(ball, frames, resolution=12, fps=25)
    assert [row["frame"] for row in rows] == list(range(12)) and rows[5]["time"] == 0.2
    for row, expected in zip(rows[:-1], alone.frames):
        assert row["deformation_energy"] == pytest.approx(expected.deformation_energy, rel=1e-3, abs=1e-12)
    assert "4" in rows[-1]["skipped"]
    with pytest.raises(solidmap.InvalidInputError, match="resolution"):
        solidmap.dask.sequence(ball, frames, client, resolution=-1)
    with pytest.raises(TypeError, match="unexpected keyword argument 'material'"):
        solidmap.dask.sequence(ball, frames, client, material=ball.points)
    failed = solidmap.dask.sequence((ball.points, ball.faces[1:]), frames[:4], client, frames_per_block=2)
    assert len(failed) == 4 and all("open" in row["skipped"] or "closed" in row["skipped"] for row in failed)


def test_comparisons_have_a_row_for_each_case(client, tmp_path):
    ball = solidmap.shapes.sphere(levels=2)
    cases = list(pairs_of(ball, 2)) + [{"name": "bad", "surface": ball, "images": ball.points, "methods": ["magic"]}]
    rows = solidmap.dask.compare_many(
        cases, client, output=tmp_path, methods=["mfs", "mean_value"], resolution=8, interior=100
    )
    assert [row["error"] is None for row in rows] == [True, True, False]
    assert set(rows[0]["methods"]) == {"mfs", "mean_value"}
    assert "methods.mfs.boundary_error.p99" in (tmp_path / "rows.csv").read_text().splitlines()[0]
