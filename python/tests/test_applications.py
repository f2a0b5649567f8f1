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
    assert found["mfs"].interior_difference["rms"] < found["fem"].interior_difference["rms"] < 0.1
    assert found.reference.boundary_error.rms < found["mfs"].boundary_error.rms
    assert found.equal_accuracy == found.mesh_study == found.sequence == []
    assert found["mfs"].harmonic_energy == pytest.approx(found["fem"].harmonic_energy, rel=0.1)
    assert all(row.inverted_tets == 0 for row in found.methods)
    assert "mfs" in repr(found)
    with pytest.raises(solidmap.InvalidInputError, match='methods has "magic"'):
        solidmap.compare(boundary, methods=["magic"])
    with pytest.raises(KeyError):
        found["variational"]
    with pytest.raises(solidmap.InvalidInputError, match="equal_accuracy compares"):
        solidmap.compare(boundary, methods=["mfs"], equal_accuracy=True, no_reference=True)
    # Methods that need no reference are measured without one, too.
    found = solidmap.compare(
        boundary, methods=["mfs", "mean_value"], resolution=8, interior=100, memory=1000, equal_accuracy=True
    )
    assert found.reference is None and "no reference could be made" in found.warnings[0]
    assert "memory" in found["mfs"].error and found["mean_value"].folded_fraction == 0 and found.equal_accuracy == []
    with pytest.raises(solidmap.InvalidInputError, match="frames has none that can be used: frame 0"):
        solidmap.compare(boundary, methods=["mfs"], frames=[(ball.points, ball.faces[1:])])


def test_a_comparison_studies_source_distances_and_times_frames(ball, images, tets):
    boundary = solidmap.BoundaryMap(ball, images)
    frames = [ball.points * [1 + 0.1 * k, 1, 1] for k in range(2)] + [(ball.points, ball.faces[1:])]
    found = solidmap.compare(
        boundary, methods=["mfs", "fem"], mesh=tets, resolution=8, interior=100, no_reference=True, mesh_study=True, frames=frames
    )
    assert found.reference is None and found["mfs"].interior_difference is None
    study = {each.method: each for each in found.mesh_study}
    assert [run.what for run in study["mfs"].runs][0] == "sources at 0.8 spacings" and len(study["fem"].runs) == 4
    assert 0 < study["mfs"].spread["rms"] < 1e-2
    timed = {each.method: each for each in found.sequence}
    assert [len(each.frame_seconds) for each in timed.values()] == [2, 2]
    assert timed["mfs"].boundary_error_p99 < 1e-2 and "frame 2" in timed["fem"].skipped[0]


@needs_native
def test_finite_elements_are_refined_until_they_are_as_accurate():
    ball = solidmap.shapes.sphere(levels=2)
    p = ball.points
    boundary = solidmap.BoundaryMap(ball, np.column_stack([2 * p[:, 0], p[:, 1], p[:, 2] + 0.3 * p[:, 0] * p[:, 1]]))
    # A tolerance that few elements meet.
    found = solidmap.compare(
        boundary, methods=["mfs"], resolution=8, interior=100, tolerance=0.05, equal_accuracy=True, max_tets=200_000
    )
    steps = found.equal_accuracy
    assert [step.name for step in steps[:4]] == ["mfs", "mfs", "mfs", "fem"] and steps[3].what == "as coarse as can be"
    last = steps[-1]
    goal = steps[0].interior_difference["rms"]
    assert last.error or last.interior_difference["rms"] <= goal
    tets = [step.tets for step in steps[3:] if not step.error]
    assert tets == sorted(set(tets)), "each mesh is finer than the one before"


def test_a_mesh_of_the_same_tetrahedra_has_metrics(tets):
    found = solidmap.mesh_metrics(tets, (tets.points * [1, 1, 2], tets.cells))
    assert (found.tets, found.inverted) == (len(tets.cells), 0)
    # Linear: the same for all.
    assert found.symmetric_dirichlet["min"] == pytest.approx(found.symmetric_dirichlet["max"])
    assert solidmap.mesh_metrics(tets, (tets.points * [1, 1, -1], tets.cells)).inverted == len(tets.cells)
    with pytest.raises(solidmap.InvalidInputError, match="not meshes of the same tetrahedra"):
        solidmap.mesh_metrics(tets, (tets.points, tets.cells[1:]))


@needs_native
def test_labels_are_written_and_read(tmp_path):
    ball = solidmap.shapes.sphere(levels=2)
    made = solidmap.polycube(ball)
    made.save_labels(tmp_path / "labels.txt", ball.faces)
    assert solidmap.polycube(ball, labels=tmp_path / "labels.txt").report.charts == made.report.charts


def test_the_best_attempt_comes_with_the_error():
    # A block with a knob on it. On four strips around the knob the top is to face sideways, as stairs that go round and up
    # without end do.
    block = solidmap.shapes.polycube([(k % 3, k // 3, 0) for k in range(9)] + [(1, 1, 1)], 3)
    tets = solidmap.fit(block, images=block.points).remesh(kind="tet", cell_size=1 / 3).domain
    surface = tets.boundary
    corners = surface.points[surface.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(area).argmax(axis=1)
    labels = 2 * axis + (area[np.arange(len(area)), axis] > 0)
    x, y, z = corners.mean(axis=1).T
    along_x, along_y = ((4 / 3 <= c) & (c < 5 / 3) for c in (x, y))
    for strip, label in ((along_x & (y < 1), 0), (along_y & (x > 2), 2), (along_x & (y > 2), 1), (along_y & (x < 1), 3)):
        labels[(labels == 5) & (z < 1.5) & strip] = label
    with pytest.raises(solidmap.NumericalError, match="no polycube was found") as raised:
        solidmap.polycube(tets, labels=labels)
    best = raised.value.best_attempt
    assert best.polycube.cells.shape == best.model.cells.shape and best.places[0]["cells"] > 0
    assert best.model.volume == pytest.approx(10)
    assert set(best.polycube.cell_data["bad"]) == {0.0, 1.0} and best.model.cell_data["label"].min() == -1
    assert "bad places" in repr(best) and solidmap.NumericalError("other").best_attempt is None


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
    labels = made.labels_of(torus.faces)
    assert set(labels) == set(range(6)) and np.array_equal(labels, pickle.loads(pickle.dumps(made)).labels_of(torus.faces[:, ::-1]))
    assert np.array_equal(made.boundary.images, made.image.points) and made.voxels is None and made.simplified is None
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
def test_large_models_are_simplified_and_voxels_fill_them(ball):
    made = solidmap.polycube(ball, max_vertices=200)
    assert made.simplified.of == len(ball.points) > made.simplified.vertices and made.tets is not None
    voxels = solidmap.polycube(ball, polycube="voxels", lattice=0.2)
    assert voxels.report is None and voxels.tets is None and voxels.voxels.missed == 0 and "voxels of" in repr(voxels)
    for found in (made, voxels):
        assert not found.boundary.is_linear and len(found.labels_of(ball.faces)) == len(ball.faces)
        f = solidmap.fit(boundary=found.boundary, tolerance=0.005)
        assert f.remesh(kind="hex", cells=8).volume == pytest.approx(ball.volume, rel=0.1)
    again = pickle.loads(pickle.dumps(voxels))
    assert again.voxels == voxels.voxels and np.array_equal(again.labels_of(ball.faces), voxels.labels_of(ball.faces))


@needs_native
def test_hexmesh_does_all_in_one(ball):
    made = solidmap.hexmesh(ball, cells=8)
    assert made.valid and made.mesh.kind == "hexes" and made.mesh.volume == pytest.approx(ball.volume, rel=0.05)
    assert (made.polycube.report is None) != (made.polycube.voxels is None)
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


def test_a_material_moves_with_the_frames(ball, tets):
    material = solidmap.Mesh(0.9 * tets.points, tets.cells)
    material.point_data["fibre"] = np.tile([1.0, 0, 0], (len(tets.points), 1))
    material.cell_data["organ"] = np.arange(len(tets.cells))
    frames = [ball.points * [1 + 0.5 * k, 1, 1] for k in range(2)] + [ball.points[:4]]
    found = solidmap.sequence(ball, frames, material=material, resolution=8)
    first, second, skipped = found.material
    assert skipped is None and first.report is None
    assert np.allclose(second.points, material.points * [1.5, 1, 1], atol=1e-2)
    assert np.allclose(second.point_data["fibre"], [1.5, 0, 0], atol=0.05)
    assert np.array_equal(second.to_mesh().cell_data["organ"], material.cell_data["organ"])
    assert np.array_equal(pickle.loads(pickle.dumps(found)).material[1].points, second.points)
    only_points = solidmap.sequence(ball, frames[:1], material=material.points[:5], resolution=8)
    assert only_points.material[0].points.shape == (5, 3) and only_points.material[0].cells is None
    assert solidmap.sequence(ball, frames[:1], resolution=8).material is None


def test_volumes_of_textures_are_those_of_the_program(program, ball, f, tmp_path):
    made = solidmap.texture(ball, colours=(ball.points + 1) / 2, sources=200)
    volume = made.volume(resolution=16)
    inside = volume.rgba[..., 3] == 255
    assert volume.inside == inside.sum() and volume.inside / inside.size == pytest.approx(np.pi / 6, rel=0.05)
    # Layers along z: blue grows with them.
    centre = volume.rgba[:, 8, 8]
    assert (np.diff(centre[centre[:, 3] > 0, 2].astype(int)) >= 0).all() and centre[-1, 2] > centre[0, 2] + 100
    points = volume.origin + volume.spacing * np.array([8, 8, 8])
    assert np.array_equal(made(points)[0], volume.rgba[8, 8, 8, :3])
    made.save(tmp_path / "texture.safetensors")
    volume.save(tmp_path / "mine.vti")
    program("texture", tmp_path / "texture.safetensors", "-o", tmp_path / "its.vti", "--resolution", 16)
    assert (tmp_path / "mine.vti").read_bytes() == (tmp_path / "its.vti").read_bytes()
    carried = made.volume(resolution=16, through=f)
    assert carried.rgba.shape[2] == 16 and carried.rgba.shape[0] < 16, "the target is twice as long along x"
    with pytest.raises(solidmap.InvalidInputError, match="must end in .vti"):
        volume.save(tmp_path / "volume.png")


def test_fields_are_written_as_the_program_writes_them(program, ball, images, f, tmp_path):
    meshio = pytest.importorskip("meshio")
    f.save(tmp_path / "map.safetensors")
    solidmap.Surface(ball.points, ball.faces).save(tmp_path / "ball.obj")
    f.boundary.save(tmp_path / "boundary.safetensors")
    f.energy(resolution=8, vtu=tmp_path / "mine.vtu")
    program("energy", tmp_path / "map.safetensors", "--vtu", tmp_path / "its.vtu", "--resolution", 8)
    assert (tmp_path / "mine.vtu").read_bytes() == (tmp_path / "its.vtu").read_bytes()
    f.save_fields(tmp_path / "fit.vtu")
    fields = meshio.read(tmp_path / "fit.vtu").point_data
    assert np.allclose(fields["image"], images) and np.allclose(fields["mapped"], f(ball.points))
    assert np.allclose(fields["error"], np.linalg.norm(f(ball.points) - images, axis=1))
    f.boundary.save_fields(tmp_path / "boundary.vtk")
    assert "area ratio" in " ".join(meshio.read(tmp_path / "boundary.vtk").cell_data).replace("_", " ")
    for call in (f.save_fields, f.boundary.save_fields, lambda path: f.energy(vtu=path)):
        with pytest.raises(solidmap.InvalidInputError, match="must end in .vtu or .vtk"):
            call(tmp_path / "fields.csv")
    proof = f.certify(undecided=0.1, cells=True)
    program("certify", tmp_path / "map.safetensors", "-o", tmp_path / "proof.vtu", "--undecided", 0.1)
    its = meshio.read(tmp_path / "proof.vtu")
    assert np.array_equal(its.cells[0].data, proof.mesh.cells) and np.allclose(its.points, proof.mesh.points)
    for name, values in proof.mesh.cell_data.items():
        assert np.array_equal(its.cell_data[name][0], values), name
    assert (proof.mesh.cell_data["verdict"] == 1).any() and f.certify(undecided=0.1).mesh is None
    assert len(pickle.loads(pickle.dumps(proof)).mesh.cells) == len(proof.mesh.cells)
