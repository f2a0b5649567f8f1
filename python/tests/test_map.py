"""Fits and maps: values, derivatives, inverses, measures, files and pickles."""

import copy
import pickle

import numpy as np
import pytest

import solidmap
from conftest import needs_native


def test_the_map_agrees_with_the_images_on_the_boundary(f, ball, images):
    off = np.linalg.norm(f(ball.points) - images, axis=1) / f.boundary.target_diagonal
    assert off.max() < 20 * 1e-3 and f.report.boundary_error.p99 < 1e-3 and f.tolerance_met


def test_a_quadratic_harmonic_map_is_reproduced_inside(f, inside):
    exact = np.column_stack([2 * inside[:, 0], inside[:, 1], inside[:, 2] + 0.3 * inside[:, 0] * inside[:, 1]])
    assert np.abs(f(inside) - exact).max() < 3e-3


def test_jacobians_are_derivatives_row_by_row(f, inside):
    step = 1e-5
    for axis in range(3):
        ahead, behind = inside.copy(), inside.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        slope = (f(ahead) - f(behind)) / (2 * step)
        assert np.allclose(f.jacobian(inside)[:, :, axis], slope, atol=1e-5)
    assert f.jacobian(inside).flags.c_contiguous


def test_preimages_are_those_of_the_images(f, inside):
    found = f.inverse(f(inside))
    assert (found.status == solidmap.OK).all() and (found.preimages == 1).all()
    assert np.allclose(found.points, inside, atol=1e-8)
    assert found.report.ok == len(inside) and found.round_trip.max() <= 1e-10
    # The search that was prepared before finds the same.
    again = f.inverse(f(inside).reshape(10, 20, 3))
    assert np.array_equal(again.points.reshape(-1, 3), found.points) and again.status.shape == (10, 20)


def test_energies_agree_with_those_by_tetrahedra_and_formula(f, tets):
    energy = f.energy(no_normalize=True)
    by_tets = f.energy(mesh=tets, no_normalize=True)
    assert by_tets.harmonic_energy == pytest.approx(energy.harmonic_energy, rel=0.05)
    # ∫ |J|²: for the quadratic map |J|² is 6 + 0.09 (x² + y²), and the mean of x² + y² in the unit ball is 2/5.
    assert energy.harmonic_energy == pytest.approx(f.domain.volume * (6 + 0.09 * 0.4), rel=0.02)
    densities = f.densities([[0, 0, 0]], no_normalize=True)
    assert densities.det_jacobian[0] == pytest.approx(np.linalg.det(f.jacobian([0, 0, 0])), rel=1e-9)
    assert f.distortion(resolution=16).mean["dirichlet"] > 3


def test_certificates_prove_what_the_determinant_says(f):
    proof = f.certify(undecided=0.02)
    assert proof.folded["cells"] == 0 and proof.positive["fraction"] > 0.97
    ball = f.domain
    mirrored = solidmap.fit(ball, images=ball.points * [1, 1, -1])
    assert mirrored.certify(undecided=0.05).positive["fraction"] > 0.9


def test_a_file_has_all_of_the_map(f, tmp_path, inside):
    path = tmp_path / "f.safetensors"
    f.save(path)
    again = solidmap.Map.load(path)
    assert np.array_equal(again(inside), f(inside))
    assert again.report.seconds is None and again.report.sources == f.report.sources
    again.save(tmp_path / "g.safetensors")
    assert np.array_equal(solidmap.Map.load(tmp_path / "g.safetensors").coefficients, f.coefficients)
    assert again.tolerance_met is None


def test_everything_pickles(f, ball, tets, inside):
    again = pickle.loads(pickle.dumps(f))
    assert np.array_equal(again(inside), f(inside)) and again.tolerance_met == f.tolerance_met
    assert again.report.seconds == f.report.seconds and repr(again) == repr(f)
    onto = solidmap.boundary.sphere(solidmap.shapes.cube(1.0, 4))
    for value in [ball, tets, onto, f.report, f.energy(resolution=8), solidmap.check(ball), f.boundary]:
        copied = pickle.loads(pickle.dumps(value))
        assert repr(copied) == repr(value)
    assert pickle.loads(pickle.dumps(ball)) == ball
    assert np.array_equal(pickle.loads(pickle.dumps(onto)).images, onto.images)
    factor = pickle.loads(pickle.dumps(solidmap.Factor(ball, tolerance=1e-2, s_ratio=0.5)))
    assert factor.solve(ball.points).report.sources == solidmap.Factor(ball, s_ratio=0.5).solve(ball.points).report.sources
    assert copy.deepcopy(f.report) == f.report


def test_maps_of_a_factor_are_those_of_fits(ball, images, inside):
    factor = solidmap.Factor(ball, no_refine=True)
    alone = solidmap.fit(ball, images=images, no_refine=True)
    assert np.allclose(factor.solve(images)(inside), alone(inside), atol=1e-12)
    frames = np.stack([images, images + 1.0, ball.points])
    maps = factor.solve_many(frames)
    assert np.allclose(maps[1](inside) - maps[0](inside), 1.0, atol=2e-4)
    assert np.allclose(maps[2](inside), inside, atol=1e-4)
    assert factor.solve_many(np.empty((0, 642, 3))) == []
    with pytest.raises(solidmap.InvalidInputError, match=r"frames has the shape \(1, 5, 3\), but must be \(k, 642, 3\)"):
        factor.solve_many(np.zeros((1, 5, 3)))
    with pytest.raises(solidmap.InvalidInputError, match=r"frames\[1\] has coordinates that are not finite"):
        factor.solve_many(np.stack([images, images * np.nan]))


def test_frames_at_fixed_points_are_those_of_their_maps(ball, images, inside):
    factor = solidmap.Factor(ball)
    frames = solidmap.FrameEvaluator(factor, inside)
    assert frames.modes == 4 and "modes" in repr(frames)
    first = frames.evaluate(images)
    assert 0 < first.solved <= 3 and first.images.shape == inside.shape
    assert np.allclose(first.images, factor.solve(images)(inside), atol=1e-4)
    assert first.boundary_rms < 2e-4 and first.left_out < 1e-9
    again = frames.evaluate(0.5 * images + ball.points[:, ::-1])
    assert again.solved == 0 and frames.modes == 4 + first.solved
    assert np.allclose(again.images, 0.5 * first.images + inside[:, ::-1], atol=1e-9)
    assert np.array_equal(frames(images), frames.evaluate(images).images)
    restored = pickle.loads(pickle.dumps(solidmap.FrameEvaluator(factor, inside, most_modes=4)))
    assert np.allclose(restored(images), first.images, atol=1e-6) and restored.modes == 4
    with pytest.raises(solidmap.InvalidInputError, match="the domain has 642 vertices and the image 5"):
        frames(np.zeros((5, 3)))
    with pytest.raises(solidmap.InvalidInputError, match=r"images\[0\] is"):
        frames(images * np.nan)
    with pytest.raises(solidmap.InvalidTypeError, match="factor is a Surface"):
        solidmap.FrameEvaluator(ball, inside)
    with pytest.raises(solidmap.InvalidInputError, match="most_modes is -1"):
        solidmap.FrameEvaluator(factor, inside, most_modes=-1)


def test_the_target_may_be_a_surface_or_the_sphere(ball):
    box = solidmap.shapes.cube(2.0, 6)
    onto = solidmap.fit(box, target="sphere", tolerance=1e-2)
    assert np.allclose(np.linalg.norm(onto(box.points), axis=1), 1, atol=0.05)
    to_ball = solidmap.fit(box, target=ball, tolerance=1e-2)
    assert np.allclose(np.linalg.norm(to_ball(box.points), axis=1), 1, atol=0.05)
    pair = solidmap.boundary.pair(box, ball)
    again = solidmap.fit(boundary=pair, tolerance=1e-2)
    assert np.allclose(again(box.points), to_ball(box.points), atol=1e-9)
    assert pair.inverse().domain.area == pytest.approx(ball.area)
    assert solidmap.boundary.check(pair).verdict == "bijective"


def test_shells_are_mapped_one_by_one(ball, tmp_path):
    outer, cavity = ball.points * [1.5, 1.0, 0.8], ball.points * 0.3 + [0.6, 0.1, 0.0]
    triangles = np.vstack([ball.faces, ball.faces[:, ::-1] + len(outer)])
    hollow = (np.vstack([outer, cavity]), triangles)
    pair = solidmap.boundary.pair(hollow, hollow)
    shells = [(shell["target"], shell["is_cavity"], shell["genus"]) for shell in pair.report.shells]
    assert shells == [(0, False, 0), (1, True, 0)]
    assert "cavity of genus 0, to shell 1" in str(pair.report)
    assert np.allclose(pair.images[len(outer) :].mean(axis=0), cavity.mean(axis=0), atol=0.03)
    assert solidmap.boundary.check(pair).verdict == "bijective"
    pair.save(tmp_path / "hollow.safetensors")
    again = solidmap.BoundaryMap.load(tmp_path / "hollow.safetensors")
    assert np.array_equal(again.images, pair.images)
    assert np.allclose(pair.inverse().inverse().images, pair.images)
    with pytest.raises(solidmap.InvalidInputError, match="2 shells .* and the target 1"):
        solidmap.boundary.pair(hollow, ball)


def test_solids_with_two_handles_are_mapped_and_fitted(tmp_path):
    cubes = [[i, j, 0] for i in range(5) for j in range(3) if not (i % 2 == 1 and j == 1)]
    plain = solidmap.shapes.polycube(cubes, 2)
    x, y, z = plain.points.T
    plate = (np.column_stack([x + 0.08 * x * x, y + 0.15 * y * y, z * (1 + 0.1 * x)]), plain.faces)
    turned = (plate[0] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).T, plate[1])
    pair = solidmap.boundary.pair(plate, turned)
    assert pair.report.hyperbolic["genus"] == 2 and "hyperbolic surface" in str(pair.report)
    # As far off as vertices of so coarse a mesh may slide: 2 % of the diagonal of some 7.
    assert np.linalg.norm(pair.images - turned[0], axis=1).mean() < 0.14
    assert solidmap.boundary.check(pair).verdict == "bijective"
    pair.save(tmp_path / "plate.safetensors")
    again = solidmap.BoundaryMap.load(tmp_path / "plate.safetensors")
    assert np.array_equal(again.images, pair.images)
    assert np.allclose(pair.inverse().inverse().images, pair.images)
    fitted = solidmap.fit(boundary=pair, tolerance=1e-2)
    assert np.abs(fitted(plate[0]) - pair.images).max() < 0.2


def test_loops_decide_how_a_handle_is_twisted(tmp_path):
    ring = solidmap.shapes.torus(1.0, 0.4, 24, 12)
    straight = [12 * k for k in range(24)]
    wound = [12 * k + k // 2 % 12 for k in range(24)]
    pair = solidmap.boundary.pair(ring, ring, loops=[(straight, wound)])
    assert abs(pair.report.torus["twist"]) == 1 and not pair.report.torus["is_turned"]
    (tmp_path / "loops.txt").write_text(f"{' '.join(map(str, straight))} > {' '.join(map(str, wound))}\n")
    by_file = solidmap.boundary.pair(ring, ring, loops=tmp_path / "loops.txt")
    assert np.array_equal(by_file.images, pair.images)
    with pytest.raises(solidmap.InvalidInputError, match="loop 0 bounds"):
        solidmap.fit(ring, target=ring, loops=[(straight, range(12))])
    with pytest.raises(solidmap.InvalidInputError, match="must be two paths"):
        solidmap.boundary.pair(ring, ring, loops=[straight])
    with pytest.raises(solidmap.InvalidInputError, match="needs target=MODEL"):
        solidmap.fit(ring, target="torus", loops=[(straight, wound)])


def test_components_go_where_they_are_told(ball, tmp_path):
    count = len(ball.points)
    balls = (np.vstack([ball.points, ball.points + [4, 0, 0]]), np.vstack([ball.faces, ball.faces + count]))
    places = [component["centre"][0] for component in solidmap.check(balls).components]
    assert np.allclose(places, [0, 4])

    def targets(**arguments):
        pair = solidmap.boundary.pair(balls, balls, aligned=True, **arguments)
        return pair, [shell["target"] for shell in pair.report.shells]

    assert targets()[1] == [0, 1]
    pair, found = targets(components=[[0, 1]])
    assert found == [1, 0]
    assert np.allclose(pair.images[:count], ball.points + [4, 0, 0], atol=0.05)
    (tmp_path / "swap.txt").write_text("# domain target\n1 0\n")
    by_file, found = targets(components=tmp_path / "swap.txt")
    assert found == [1, 0] and np.array_equal(by_file.images, pair.images)
    onto = solidmap.fit(balls, target=balls, aligned=True, components=[[0, 1]], tolerance=1e-2)
    assert np.allclose(onto([[0, 0, 0]]), [[4, 0, 0]], atol=0.1)
    with pytest.raises(solidmap.InvalidInputError, match="no shell 2 in the target"):
        targets(components=[[0, 2]])
    with pytest.raises(solidmap.InvalidInputError, match="given twice"):
        targets(components=[[0, 1], [1, 1]])
    with pytest.raises(solidmap.InvalidInputError, match="needs target=MODEL"):
        solidmap.fit(balls, target="sphere", components=[[0, 1]])


def test_landmarks_are_met():
    box, ball = solidmap.shapes.cube(2.0, 6), solidmap.shapes.sphere(levels=2)
    landmarks = [[0, 5], [6, 40], [48, 100]]
    pair = solidmap.boundary.pair(box, ball, landmarks=landmarks)
    assert pair.report.landmarks == 3 and pair.report.landmark_error < 1e-9
    assert np.allclose(pair.images[[0, 6, 48]], ball.points[[5, 40, 100]], atol=1e-9)
    with pytest.raises(solidmap.InvalidInputError, match="landmark"):
        solidmap.boundary.pair(box, ball, landmarks=[[0, 99999]])


@needs_native
def test_a_bijective_map_is_stored_beside_the_harmonic_one(f, ball, tets, tmp_path, inside):
    both = f.make_bijective()
    assert both.bijective.boundary == "one_to_one" and both.certify().one_to_one
    assert not np.array_equal(both(inside), f(inside))
    assert np.array_equal(both(inside, map="harmonic"), f(inside))
    assert np.abs(both(inside) - f(inside)).max() < 0.05
    found = both.inverse(both(inside))
    assert np.allclose(found.points, inside, atol=1e-9)
    both.save(tmp_path / "both.safetensors")
    assert solidmap.Map.load(tmp_path / "both.safetensors").bijective.tets == both.bijective.tets
    again = pickle.loads(pickle.dumps(both))
    assert np.array_equal(again(inside), both(inside))
    domain, target = both.bijective_tets
    assert len(domain.inverted) == len(target.inverted) == 0 and len(domain.cells) == both.bijective.tets
    assert solidmap.fit(ball, images=ball.points, bijective=True).bijective.inverted_as_mapped == 0
    with pytest.raises(solidmap.UnsupportedError, match="there is no bijective map"):
        f(inside, map="bijective")


def test_a_bijective_map_over_given_tetrahedra_needs_no_mesher(f, tets):
    assert f.make_bijective(mesh=tets).bijective.tets >= len(tets.cells)


def test_meshes_are_carried(f, tets):
    carried = f.remesh(mesh=tets)
    assert carried.report.valid and len(carried.points) == len(tets.points)
    assert carried.volume == pytest.approx(f.target.volume, rel=1e-6)
    assert np.array_equal(carried.domain.points, tets.points)
    assert np.allclose(carried.as_mapped[-1], f([0, 0, 0]), atol=1e-6)
    assert (carried.determinants > 0).all()
    again = pickle.loads(pickle.dumps(carried))
    assert again.report == carried.report and np.array_equal(again.points, carried.points)


def test_regular_meshes_of_polycubes_are_carried():
    box = solidmap.shapes.polycube([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 4)
    f = solidmap.fit(box, images=box.points + 0.1 * np.sin(box.points[:, ::-1]))
    for kind in ("tet", "hex"):
        mesh = f.remesh(kind=kind, cells=8)
        assert mesh.report.valid and mesh.quality.min_scaled_jacobian > 0.1
        assert mesh.volume == pytest.approx(f.target.volume, rel=0.02)
    with pytest.raises(solidmap.InvalidInputError, match="not a polycube"):
        solidmap.fit(solidmap.shapes.sphere(levels=2), images=solidmap.shapes.sphere(levels=2).points).remesh()


@pytest.mark.parametrize(
    "settings, words",
    [
        ({}, "give one of images, boundary and target"),
        ({"images": "IMAGES", "target": "sphere"}, "images and target are given"),
        ({"images": "IMAGES", "tolerance": -1}, "tolerance"),
        ({"images": "IMAGES", "tolerance": "small"}, "tolerance is 'small', but must be a number"),
        ({"images": "IMAGES", "max_sources": 2.5}, "max_sources is 2.5, but must be an integer"),
        ({"images": "IMAGES", "method": "lu"}, 'method is \'lu\', but must be one of "schwarz", "dense", "svd"'),
        ({"images": "IMAGES", "memory": "lots"}, "memory is 'lots'"),
        ({"images": "IMAGES", "no_affine": 1}, "no_affine is 1, but must be True or False"),
        ({"images": "IMAGES", "alpha": 1.0, "placement": "sphere"}, "alpha has no meaning"),
        ({"images": "IMAGES", "landmarks": [[0, 0]]}, "landmarks says how a solid is mapped to another"),
        ({"images": "FEW"}, "the domain has 642 vertices and the image 5"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_name(ball, images, settings, words):
    values = {"IMAGES": images, "FEW": images[:5]}
    settings = {name: values.get(value, value) if isinstance(value, str) else value for name, value in settings.items()}
    with pytest.raises(solidmap.SolidmapError, match=words):
        solidmap.fit(ball, **settings)


def test_a_fit_that_needs_too_much_memory_is_refused(ball, images):
    with pytest.raises(solidmap.TooLargeError) as raised:
        solidmap.fit(ball, images=images, memory="100kB")
    assert isinstance(raised.value, MemoryError) and isinstance(raised.value, solidmap.SolidmapError)


def test_the_settings_of_the_paper_are_a_dense_decomposition(images, ball):
    by_sphere = solidmap.fit(ball, images=images, radius=1.0, tolerance=0.5)
    assert by_sphere.report.method == "dense-svd" and "sphere" in by_sphere.report.placement
    assert solidmap.fit(ball, images=images, method="dense").report.method == "dense-qr"
    assert solidmap.fit(ball, images=images, method="dense", s_ratio=0.5).report.sources == 321


def test_reports_read_like_the_program_and_are_dictionaries(f):
    text = repr(f.report)
    assert "642 vertices, 1280 triangles" in text and "boundary error  rms" in text
    assert f.report._repr_html_().startswith("<table>")
    assert f.report.as_dict()["boundary_error"]["rms"] == f.report.boundary_error.rms
    f.report.as_dict()["boundary_error"]["rms"] = 7
    assert f.report.boundary_error.rms != 7
    assert "<table>" in f._repr_html_() and "tolerance" in repr(f)
