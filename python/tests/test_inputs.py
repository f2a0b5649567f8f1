"""What functions take: shapes, dtypes, strides, objects of other packages; and what they refuse, by name."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import solidmap
from solidmap import _inputs

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_doubles_in_c_order_are_not_copied():
    array = np.zeros((5, 3))
    assert _inputs.points("points", array)[0] is array
    assert np.shares_memory(_inputs.points("points", np.zeros((2, 4, 3)))[0], _inputs.points("points", array)[0]) is False
    grid = np.zeros((2, 4, 3))
    assert np.shares_memory(_inputs.points("points", grid)[0], grid)


@quick
@given(
    shape=hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    dtype=st.sampled_from(["f8", "f4", ">f8", "f2", "i1", "u2", "i4", "i8", "u8"]),
    order=st.sampled_from("CF"),
    step=st.sampled_from([1, 2, -1]),
)
def test_images_do_not_depend_on_shape_dtype_or_strides(f, shape, dtype, order, step):
    random = np.random.default_rng(1)
    array = random.integers(0, 2, size=(*shape, 3)).astype(dtype, order=order)
    strided = np.repeat(array, 2, axis=0)[::2][::step] if shape and step == -1 else array
    found = f(strided)
    assert found.shape == (strided.shape if strided.size or strided.ndim > 1 else (0, 3))
    plain = np.array(strided, np.float64, order="C").reshape(-1, 3)
    assert np.array_equal(found.reshape(-1, 3), f(plain))
    jacobian = f.jacobian(strided)
    assert jacobian.shape == (*strided.shape[:-1], 3, 3)


@pytest.mark.parametrize("empty", [[], np.empty((0, 3)), np.empty((0, 0)), np.empty((4, 0, 3)), np.empty(0, "f4")])
def test_no_points_have_no_images(f, empty):
    assert f(empty).size == 0 and f(empty).shape[-1] == 3
    assert f.jacobian(empty).size == 0
    assert f.inverse(empty).status.size == 0
    assert f.densities(empty).harmonic.size == 0
    assert solidmap.signed_distance(f.domain, empty).size == 0


@pytest.mark.parametrize(
    "points, error, words",
    [
        ([1, 2], solidmap.InvalidInputError, r"points has the shape \(2,\), but must be \(..., 3\)"),
        (np.zeros((3, 2)), solidmap.InvalidInputError, r"points has the shape \(3, 2\)"),
        (5.0, solidmap.InvalidInputError, r"points has the shape \(\)"),
        (["a", "b", "c"], solidmap.InvalidTypeError, "points has the dtype <U1"),
        ([1j, 0, 0], solidmap.InvalidTypeError, "points has the dtype complex128"),
        ([None, None, None], solidmap.InvalidTypeError, "points has the dtype object"),
        ([True, False, True], solidmap.InvalidTypeError, "points has the dtype bool"),
    ],
)
def test_points_that_are_none_are_refused_by_name(f, points, error, words):
    for call in (f, f.jacobian, f.inverse, f.densities):
        with pytest.raises(error, match=words):
            call(points)


def test_points_that_are_not_finite_have_no_images(f):
    found = f([[np.nan, 0, 0], [0, 0, 0]])
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()
    assert f.inverse([[np.inf, 0, 0]]).status.tolist() == [solidmap.NOT_FINITE]


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">i4"])
def test_faces_may_have_integers_of_any_width(dtype):
    small = solidmap.shapes.sphere(levels=0)
    assert solidmap.Surface(small.points, small.faces.astype(dtype)) == small
    assert solidmap.Surface(small.points.astype("f4"), np.asfortranarray(small.faces.astype(dtype))).volume > 0


@pytest.mark.parametrize(
    "faces, error, words",
    [
        ([[0, 1, 99]], solidmap.InvalidInputError, r"faces of the surface\[0\] names point 99, and there are 12 points"),
        ([[0, 1, -1]], solidmap.InvalidInputError, "names point -1"),
        ([[0, 1, 2**40]], solidmap.InvalidInputError, "names point"),
        ([[0.5, 1, 2]], solidmap.InvalidTypeError, "faces of the surface has the dtype float64"),
        ([[0, 1]], solidmap.InvalidInputError, r"has the shape \(1, 2\), but must be \(m, 3\)"),
        ([0, 1, 2], solidmap.InvalidInputError, r"has the shape \(3,\)"),
    ],
)
def test_faces_that_cannot_be_used_are_refused(faces, error, words):
    with pytest.raises(error, match=words):
        solidmap.Surface(solidmap.shapes.sphere(levels=0).points, faces)


def test_vertices_that_are_not_finite_are_refused_by_fit_and_found_by_check(ball):
    broken = ball.points
    broken[3, 1] = np.nan
    with pytest.raises(solidmap.InvalidInputError, match=r"the vertices of surface\[3\] is \(.*nan"):
        solidmap.fit((broken, ball.faces), images=ball.points)
    with pytest.raises(solidmap.InvalidInputError, match=r"images\[3\]"):
        solidmap.fit(ball, images=broken)
    report = solidmap.check((broken, ball.faces))
    assert not report.solvable
    assert "non_finite_vertices" in [finding.kind for finding in report.findings]


def surfaces_of(ball, folder):
    trimesh = pytest.importorskip("trimesh")
    pyvista = pytest.importorskip("pyvista")
    meshio = pytest.importorskip("meshio")
    path = folder / "ball.obj"
    ball.save(path)
    faces = ball.faces.astype(np.int64)
    return [
        (ball.points, ball.faces),
        [ball.points.tolist(), faces.tolist()],
        ball,
        trimesh.Trimesh(ball.points, faces, process=False),
        pyvista.PolyData(ball.points, np.hstack([np.full((len(faces), 1), 3), faces]).ravel()),
        meshio.Mesh(ball.points, [("triangle", faces)]),
        ball.to_trimesh(),
        ball.to_pyvista(),
        ball.to_meshio(),
        path,
        str(path),
    ]


def test_all_that_stands_for_a_surface_is_the_same_surface(tmp_path):
    ball = solidmap.shapes.sphere(levels=1)
    for given in surfaces_of(ball, tmp_path):
        found = solidmap.Surface.of(given)
        assert np.allclose(found.points, ball.points, atol=1e-12) and np.array_equal(found.faces, ball.faces)
        # With the images in the same form too.
        assert solidmap.BoundaryMap(given, given).target_volume == pytest.approx(ball.volume)


def test_all_that_stands_for_cells_is_the_same_mesh(tets, tmp_path):
    pytest.importorskip("pyvista")
    pytest.importorskip("meshio")
    path = tmp_path / "tets.vtu"
    tets.save(path)
    for given in [tets, (tets.points, tets.cells.astype("i8")), tets.to_pyvista(), tets.to_meshio(), path, str(path)]:
        found = solidmap.Mesh.of(given)
        assert np.array_equal(found.points, tets.points) and np.array_equal(found.cells, tets.cells)
        # Where a surface is wanted, it is their boundary.
        assert solidmap.Surface.of(given).volume == pytest.approx(tets.volume)
    hexes = solidmap.fit(solidmap.shapes.cube(1.0, 2), images=solidmap.shapes.cube(1.0, 2).points).remesh(
        kind="hex", cells=2
    )
    again = solidmap.Mesh.of(hexes.to_pyvista())
    assert again.kind == "hexes" and np.array_equal(again.cells, hexes.cells)
    assert solidmap.Mesh.of(hexes.to_meshio()).volume == pytest.approx(1.0)


def test_polygons_of_pyvista_are_cut_into_triangles():
    pyvista = pytest.importorskip("pyvista")
    assert solidmap.Surface.of(pyvista.Cube()).volume == pytest.approx(1.0)


@pytest.mark.parametrize("value", [3, None, (1, 2, 3), {"a": 1}, b"ball.obj", object()])
def test_what_stands_for_nothing_is_refused_by_name(value):
    with pytest.raises(solidmap.SolidmapError, match="surface|faces|vertices"):
        solidmap.check(value)
    with pytest.raises(solidmap.SolidmapError, match="mesh"):
        solidmap.Mesh.of(value)


@quick
@given(
    vertices=hnp.arrays(st.sampled_from(["f8", "f4", "i4"]), hnp.array_shapes(max_dims=3, max_side=6)),
    faces=hnp.arrays(st.sampled_from(["i4", "u4", "i8", "f8"]), hnp.array_shapes(max_dims=3, max_side=6)),
)
def test_any_arrays_are_a_surface_or_refused(vertices, faces):
    try:
        solidmap.check((vertices, faces))
    except solidmap.SolidmapError:
        pass


def test_ten_thousand_random_calls_end_in_results_or_in_our_errors(f, ball):
    random = np.random.default_rng(3)

    def argument():
        kind = random.integers(9)
        shape = tuple(random.integers(0, 4, size=random.integers(0, 4)))
        if kind == 0:
            return random.normal(size=(*shape, 3))
        if kind == 1:
            return random.integers(-3, 9, size=shape)
        if kind == 2:
            return random.normal(size=shape).astype("f4")
        if kind == 3:
            return np.full((*shape, 3), [np.nan, np.inf, 1e300][random.integers(3)])
        if kind == 4:
            return np.asfortranarray(random.normal(size=(3, 3)))[:: random.choice([1, -1]), ::-1]
        if kind == 5:
            return random.choice(["x", "", "no.obj"])
        if kind == 6:
            return [None, 3, -1.5, True, [], {}, ()][random.integers(7)]
        if kind == 7:
            return (random.normal(size=(4, 3)), random.integers(-1, 5, size=(3, 3)))
        return (ball.points[:8], random.integers(0, 8, size=(2, random.choice([3, 4, 8]))))

    calls = [
        lambda a, b: f(a),
        lambda a, b: f.jacobian(a),
        lambda a, b: f(a, map=b),
        lambda a, b: f.densities(a, lame=b),
        lambda a, b: solidmap.Surface(a, b),
        lambda a, b: solidmap.Mesh(a, b),
        lambda a, b: solidmap.Surface.of(a).volume,
        lambda a, b: solidmap.Mesh.of(a).quality,
        lambda a, b: solidmap.signed_distance(ball, a),
        lambda a, b: solidmap.BoundaryMap(ball, a),
        lambda a, b: solidmap.BoundaryMap(a, b),
        lambda a, b: solidmap.shapes.sphere(a, 1),
        lambda a, b: solidmap.shapes.polycube(a, 1),
        lambda a, b: solidmap.memory_estimate(ball, memory=a, seed=b),
        lambda a, b: f.boundary(a, b),
        lambda a, b: solidmap.fit(ball, images=ball.points[:3], tolerance=a, s_ratio=b),
    ]
    ended = {"result": 0, "error": 0}
    for _ in range(10_000):
        call = calls[random.integers(len(calls))]
        try:
            call(argument(), argument())
            ended["result"] += 1
        except solidmap.SolidmapError as error:
            assert not isinstance(error, solidmap.InternalError), error
            ended["error"] += 1
    assert min(ended.values()) > 500, ended
