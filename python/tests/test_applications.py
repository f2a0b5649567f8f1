"""Fields, sequences, textures, comparisons, polycubes."""

import pickle

import numpy as np
import pytest

import solidmap
from conftest import needs_native


def test_fields_are_carried_as_they_are_pushed_and_as_labels(f, inside):
    n = len(inside)
    fields = {
        "t": np.arange(n),
        "v": np.tile([1.0, 0, 0], (n, 1)),
        "rgb": np.tile([9, 8, 7], (n, 1)),
        "plain": np.tile([1.0, 2, 3], (n, 1)),
        "kind": np.arange(n) % 3,
        "two": np.ones((n, 2), "f4"),
    }
    found = f.transfer(inside, fields=fields, label=["kind"], plain_vectors=["plain"], distance=True)
    assert np.array_equal(found.points, f(inside)) and found.status is None and found.cells is None
    assert np.allclose(found.point_data["v"], f.jacobian(inside)[:, :, 0])
    for name in ("t", "rgb", "plain", "kind", "two"):
        assert np.array_equal(found.point_data[name], fields[name])
    assert np.allclose(found.point_data["distance"], -solidmap.signed_distance(f.domain, inside))
    kinds = {row["name"]: row["carry"] for row in found.report.fields}
    assert kinds == {"t": "values", "v": "vector", "rgb": "values", "plain": "values", "kind": "label", "two": "values",
                     "distance": "values"}
    assert found.report.volume["relative_error"] < 0.01


def test_fields_are_found_at_points_of_the_target(f, tets, inside):
    points = tets.points
    found = f.transfer(tets, fields={"x": points[:, 0]}, cell_fields={"c": np.ones(len(tets.cells))}, at=f(inside))
    assert (found.status == solidmap.OK).all()
    # Linear in the tetrahedra, so exact.
    assert np.allclose(found.point_data["x"], inside[:, 0], atol=1e-6)
    assert np.allclose(found.point_data["c"], 1.0)
    outside = f.transfer(tets, fields={"x": points[:, 0]}, at=[[50.0, 0, 0]])
    assert outside.status.tolist() == [solidmap.OUTSIDE] and np.isnan(outside.point_data["x"][0])


def test_meshes_with_data_of_other_packages_are_carried(f, tets, tmp_path):
    pytest.importorskip("pyvista")
    pytest.importorskip("meshio")
    mesh = solidmap.Mesh(tets.points, tets.cells)
    mesh.point_data["height"] = tets.points[:, 2]
    mesh.cell_data["material"] = np.arange(len(tets.cells))
    path = tmp_path / "given.vtu"
    mesh.to_pyvista().save(path)
    for given in (mesh, mesh.to_pyvista(), mesh.to_meshio(), path):
        found = f.transfer(given)
        assert np.array_equal(found.cells, tets.cells)
        assert np.array_equal(found.point_data["height"], tets.points[:, 2])
        assert np.array_equal(found.cell_data["material"], np.arange(len(tets.cells)))
    grid = found.to_pyvista()
    assert grid.n_cells == len(tets.cells) and "height" in grid.point_data
    assert found.to_mesh().to_meshio().cell_data["material"][0][5] == 5


@pytest.mark.parametrize(
    "arguments, words",
    [
        ({}, "field is missing"),
        ({"field": "INSIDE"}, "there are no fields"),
        ({"field": "INSIDE", "fields": {"t": [1, 2]}}, r"fields\['t'\] has the shape \(2,\), but must have 200 rows"),
        ({"field": "INSIDE", "fields": {"t": "TEXT"}}, r"fields\['t'\] has the dtype"),
        ({"field": "INSIDE", "distance": True, "label": ["u"]}, "there is no field 'u'"),
    ],
)
def test_fields_that_cannot_be_carried_are_refused(f, inside, arguments, words):
    values = {"INSIDE": inside, "TEXT": ["a"] * 200}
    arguments = {k: values.get(v, v) if isinstance(v, str) else v for k, v in arguments.items()}
    if isinstance(arguments.get("fields"), dict):
        arguments["fields"] = {k: values["TEXT"] if isinstance(v, str) else v for k, v in arguments["fields"].items()}
    with pytest.raises(solidmap.SolidmapError, match=words):
        f.transfer(**arguments)


def test_frames_are_measured_and_cycles_counted(ball):
    phases = np.linspace(0, 6 * np.pi, 36, endpoint=False)

    def frames():
        for phase in phases:
            yield ball.points * [1 + 0.1 * np.sin(phase) ** 2, 1, 1]

    found = solidmap.sequence(ball, frames(), resolution=12, fps=10, frames_per_block=8)
    assert len(found.frames) == 36 and found.skipped == 0 and found.tolerance_met
    assert found.cycles["count"] == pytest.approx(6, abs=0.2)
    assert found.frames[1].time == 0.1 and found.energies[0] < 1e-9 < found.energies[2]
    assert "36, 0 skipped" in repr(found)
    # The strain of a stretch s along x is s² - 1, twice Green's: the energy is (λ/2 + μ) of its square.
    strain = (1 + 0.1 * np.sin(phases[2]) ** 2) ** 2 - 1
    assert found.energies[2] == pytest.approx((0.0335 / 2 + 0.0224) * strain**2, rel=1e-3)


def test_a_frame_that_cannot_be_used_is_skipped(ball, images):
    found = solidmap.sequence(ball, [ball.points, ball.points[:7], images, ball.points * 0], resolution=8)
    assert [row.skipped is not None for row in found.frames] == [False, True, False, True]
    assert np.isnan(found.energies[1]) and "coincide" in found.frames[3].skipped
    assert found.no_cycles is not None


def test_frames_of_bijective_maps_do_not_fold(ball, tets, images):
    found = solidmap.sequence(tets, [solidmap.Surface(images, ball.faces)], map="bijective")
    assert found.map_kind == "bijective" and found.tets == len(tets.cells)
    assert found.frames[0].folded_fraction == 0 and found.frames[0].inverted_as_mapped == 0


def test_textures_meet_the_colours_of_vertices(ball, f, inside, tmp_path):
    colours = (255 * (ball.points + 1) / 2).astype(np.uint8)
    made = solidmap.texture(ball, colours=colours, sources=200)
    found, has_colour = made(ball.points)
    assert has_colour.all() and np.abs(found.astype(int) - colours).max() <= 1
    _, outside = made([[3.0, 0, 0], [np.nan, 0, 0]])
    assert not outside.any()
    through, has_colour = made(f(inside), through=f)
    assert has_colour.all() and np.abs(through.astype(int) - made(inside)[0]).max() <= 1
    made.save(tmp_path / "texture.safetensors")
    for again in (solidmap.Texture.load(tmp_path / "texture.safetensors"), pickle.loads(pickle.dumps(made))):
        assert np.array_equal(again(inside)[0], made(inside)[0])
    assert made.report.surface_error["max"] < 1e-6


def test_textures_of_pictures_need_coordinates(ball):
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:2] = [255, 0, 0]
    flat = (ball.points[ball.faces][:, :, :2] + 1) / 2
    made = solidmap.texture(ball, coordinates=flat, image=picture, sources=100, wrap="clamp")
    top, bottom = made([[0, 0.9, 0.2], [0, -0.9, 0.2]])[0]
    assert top[0] > bottom[0]
    assert solidmap.texture(ball, coordinates=flat, checker=4, sources=100).report.extended == "colours"
    for settings, words in [
        ({}, "there is nothing to extend"),
        ({"image": picture}, "there is nothing to extend"),
        ({"image": picture.astype(float), "coordinates": flat}, "image has the dtype float64"),
        ({"coordinates": flat[:5], "image": picture}, r"coordinates has the shape \(5, 3, 2\)"),
        ({"colours": ball.points * 9}, "colours must be from 0 to 1"),
        ({"colours": (ball.points[:3] + 1) / 2}, "3"),
    ]:
        with pytest.raises(solidmap.InvalidInputError, match=words):
            solidmap.texture(ball, **settings)


def test_methods_are_compared_alike(ball, images, tets):
    boundary = solidmap.BoundaryMap(ball, images)
    found = solidmap.compare(boundary, methods=["mfs", "fem", "bijective"], mesh=tets, resolution=10, interior=200)
    assert [row.name for row in found.methods] == ["mfs", "fem", "bijective"]
    assert found["mfs"].interior_difference is None and found["fem"].interior_difference["rms"] < 0.1
    assert found["mfs"].harmonic_energy == pytest.approx(found["fem"].harmonic_energy, rel=0.1)
    assert all(row.inverted_tets == 0 for row in found.methods)
    assert "mfs" in repr(found)
    with pytest.raises(solidmap.InvalidInputError, match='methods has "magic"'):
        solidmap.compare(boundary, methods=["magic"])
    with pytest.raises(KeyError):
        found["variational"]


@needs_native
def test_polycubes_carry_hexahedra():
    torus = solidmap.shapes.torus(1.0, 0.4, 24, 12)
    made = solidmap.polycube(torus)
    assert made.report.inverted == 0 and set(made.labels) == set(range(6))
    triangles = made.surface.points[made.surface.faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    axes = made.labels // 2
    facing = normals[np.arange(len(axes)), axes] * (2.0 * (made.labels % 2) - 1)
    assert (facing > 0).all(), "each triangle faces along its label"
    f = solidmap.fit(made.surface, images=made.image)
    assert f.remesh(kind="hex", cells=12).kind == "hexes"
    again = solidmap.polycube(made.image_tets, labels=None)
    assert again.report.tets >= made.report.tets
    with pytest.raises(solidmap.InvalidInputError, match="labels has the dtype"):
        solidmap.polycube(torus, labels=[1.5])


@needs_native
def test_labels_of_a_model_describe_its_polycube():
    box = solidmap.shapes.cube(1.0, 2)
    corners = box.points[box.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    labels = 2 * axis + (normals[np.arange(len(axis)), axis] > 0)
    made = solidmap.polycube(box, labels=labels)
    assert made.report.labels == "given" and made.report.charts == 6
    tets = solidmap.tetrahedralise(box)
    corners = tets.boundary.points[tets.boundary.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normals).argmax(axis=1)
    labels = 2 * axis + (normals[np.arange(len(axis)), axis] > 0)
    assert solidmap.polycube(tets, labels=labels).report.charts == 6


@needs_native
def test_hexmesh_does_all_in_one(ball):
    made = solidmap.hexmesh(ball, cells=8)
    assert made.valid and made.mesh.kind == "hexes" and made.mesh.volume == pytest.approx(ball.volume, rel=0.05)
    assert (made.polycube is None) != (made.voxels is None)
    assert np.allclose(made.map(made.map.domain.points), made.map.boundary.images, atol=0.05)


@needs_native
def test_surfaces_are_filled_and_wrapped(ball):
    for mesher in ("tetgen", "cgal"):
        mesh = solidmap.tetrahedralise(ball, mesher=mesher, max_volume=0.02)
        assert mesh.kind == "tets" and mesh.volume == pytest.approx(ball.volume, rel=0.05) and mesh.check().valid
    around = solidmap.offset_surface(ball, 0.3)
    radii = np.linalg.norm(around.points, axis=1)
    assert abs(radii - 1.3).max() < 0.05 and around.report.genus == 0
    with pytest.raises(solidmap.InvalidInputError, match="quality"):
        solidmap.tetrahedralise(ball, quality=0.5)


@needs_native
def test_what_crosses_itself_is_an_error_and_no_crash(ball):
    twice = solidmap.Surface(np.vstack([ball.points, ball.points + 0.3]), np.vstack([ball.faces, ball.faces + 642]))
    with pytest.raises(solidmap.InvalidInputError, match="intersect"):
        solidmap.tetrahedralise(twice)
    assert solidmap.check(twice).self_intersections["pairs"] > 0
    assert solidmap.tetrahedralise(ball).volume == pytest.approx(ball.volume)


def test_distances_are_negative_inside(ball):
    found = solidmap.signed_distance(ball, [[[0, 0, 0], [2, 0, 0]]])
    assert found.shape == (1, 2) and found[0, 0] == pytest.approx(-1, abs=0.02)
    assert found[0, 1] == pytest.approx(1, abs=0.02)


@pytest.mark.skipif(solidmap.HAS_NATIVE, reason="this build has CGAL and TetGen")
def test_a_build_without_cgal_and_tetgen_says_what_to_do(ball, tets, f):
    for call in (
        lambda: solidmap.tetrahedralise(ball),
        lambda: solidmap.offset_surface(ball, 0.1),
        lambda: solidmap.polycube(ball),
        lambda: solidmap.hexmesh(ball),
        lambda: f.make_bijective(),
    ):
        with pytest.raises(solidmap.UnsupportedError, match="pip install|give a tet mesh"):
            call()
    assert solidmap.check(ball).self_intersections["status"] == "not_checked"
    assert f.make_bijective(mesh=tets).bijective.boundary == "not_checked"
