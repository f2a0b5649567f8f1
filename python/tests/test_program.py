"""Agreement with the program: the same settings give the same files and the same figures."""

import inspect
import json
import re

import numpy as np
import pytest

import solidmap
from conftest import needs_native


@pytest.fixture(scope="module")
def folder(tmp_path_factory, ball, images):
    folder = tmp_path_factory.mktemp("program")
    ball.save(folder / "ball.obj")
    solidmap.Surface(images, ball.faces).save(folder / "image.obj")
    solidmap.shapes.cube(2.0, 6).save(folder / "cube.ply")
    (folder / "landmarks.txt").write_text("0 5\n6 40\n# a comment\n48 100\n")
    return folder


@pytest.mark.parametrize(
    "arguments, settings",
    [
        ([], {}),
        (["--tolerance", "1e-4", "--seed", "7"], {"tolerance": 1e-4, "seed": 7}),
        (["--no-refine", "--s-ratio", "0.5", "--no-affine"], {"no_refine": True, "s_ratio": 0.5, "no_affine": True}),
        (["--alpha", "1.5", "--held-out", "500"], {"alpha": 1.5, "held_out": 500}),
        (["--free-sources", "--max-sources", "40"], {"free_sources": True, "max_sources": 40}),
        (["--max-error", "5", "--max-local-error", "0.5"], {"max_error": 5, "max_local_error": 0.5}),
    ],
)
def test_a_fit_writes_the_same_bytes(program, folder, arguments, settings):
    program("fit", folder / "ball.obj", "--image", folder / "image.obj", "-o", folder / "a.safetensors", *arguments,
            codes=(0, 1))
    solidmap.fit(folder / "ball.obj", images=folder / "image.obj", **settings).save(folder / "b.safetensors")
    assert (folder / "a.safetensors").read_bytes() == (folder / "b.safetensors").read_bytes()


def test_maps_onto_the_sphere_and_other_solids_are_the_same_bytes(program, folder):
    cube, ball = folder / "cube.ply", folder / "ball.obj"
    for target, tolerance in (("sphere", "5e-3"), (ball, "5e-3")):
        program("fit", cube, "--target", target, "-o", folder / "a.safetensors", "--tolerance", tolerance, codes=(0, 1))
        solidmap.fit(cube, target=target, tolerance=float(tolerance)).save(folder / "b.safetensors")
        assert (folder / "a.safetensors").read_bytes() == (folder / "b.safetensors").read_bytes()


def test_boundary_files_are_the_same_bytes(program, folder):
    cube, ball, landmarks = (folder / name for name in ("cube.ply", "ball.obj", "landmarks.txt"))
    out = ["-o", folder / "out.obj", "--boundary", folder / "a.safetensors"]
    program("boundary", "sphere", cube, *out, "--energy", "conformal")
    solidmap.boundary.sphere(cube, energy="conformal").save(folder / "b.safetensors")
    assert (folder / "a.safetensors").read_bytes() == (folder / "b.safetensors").read_bytes()
    report = json.loads(program("boundary", "pair", cube, ball, "--landmarks", landmarks, *out, "--json", codes=(0, 1)))
    pair = solidmap.boundary.pair(cube, ball, landmarks=landmarks)
    pair.save(folder / "b.safetensors")
    assert (folder / "a.safetensors").read_bytes() == (folder / "b.safetensors").read_bytes()
    assert pair.report.landmark_error == report["landmark_error"] and pair.report.stretch == report["stretch"]
    by_array = solidmap.boundary.pair(cube, ball, landmarks=np.array([[0, 5], [6, 40], [48, 100]]))
    assert np.array_equal(by_array.images, pair.images)
    # The map of a boundary file.
    program("fit", "--boundary", folder / "a.safetensors", "-o", folder / "c.safetensors", codes=(0, 1))
    solidmap.fit(boundary=folder / "a.safetensors").save(folder / "d.safetensors")
    assert (folder / "c.safetensors").read_bytes() == (folder / "d.safetensors").read_bytes()


@pytest.fixture(scope="module")
def fitted(folder):
    path = folder / "map.safetensors"
    solidmap.fit(folder / "ball.obj", images=folder / "image.obj").save(path)
    return path


def test_figures_are_the_same(program, folder, fitted, ball):
    f = solidmap.Map.load(fitted)
    energy = json.loads(program("energy", fitted, "--json", "--resolution", "20"))
    mine = f.energy(resolution=20).as_dict()
    assert mine.pop("warnings") == []
    assert {name: energy[name] for name in mine} == mine
    certificate = json.loads(program("certify", fitted, "--json", "--undecided", "0.05"))
    mine = f.certify(undecided=0.05).as_dict()
    assert {name: certificate[name] for name in mine} == mine
    fit = json.loads(program("fit", folder / "ball.obj", "--image", folder / "image.obj", "-o", folder / "x.map", "--json"))
    mine = solidmap.fit(folder / "ball.obj", images=folder / "image.obj").report.as_dict()
    assert {name: fit[name] for name in mine if name not in ("seconds", "memory_estimate")} == {
        name: value for name, value in mine.items() if name not in ("seconds", "memory_estimate")
    }
    check = json.loads(program("check", folder / "ball.obj", "--json"))["models"][0]
    mine = solidmap.check(folder / "ball.obj").as_dict()
    assert {name: check[name] for name in mine if name in check} == {name: mine[name] for name in mine if name in check}
    assert "components" in check


def test_images_and_preimages_are_the_same(program, folder, fitted, inside):
    f = solidmap.Map.load(fitted)
    np.save(folder / "points.npy", inside)
    program("eval", fitted, folder / "points.npy", "-o", folder / "images.npy", "--jacobian")
    found = np.load(folder / "images.npy")
    assert np.array_equal(found[:, :3], f(inside)) and np.array_equal(found[:, 3:12].reshape(-1, 3, 3), f.jacobian(inside))
    np.save(folder / "images.npy", f(inside))
    program("eval", fitted, folder / "images.npy", "-o", folder / "back.npy", "--inverse")
    found, mine = np.load(folder / "back.npy"), f.inverse(f(inside))
    assert np.array_equal(found[:, :3], mine.points) and np.array_equal(found[:, 3], mine.status)


def test_meshes_are_the_same(program, folder, tets):
    box = solidmap.shapes.cube(1.0, 6)
    box.save(folder / "box.obj")
    solidmap.Surface(box.points + 0.2 * box.points[:, ::-1] ** 2, box.faces).save(folder / "bent.obj")
    program("fit", folder / "box.obj", "--image", folder / "bent.obj", "-o", folder / "box.map")
    report = json.loads(
        program("remesh", folder / "box.map", "--kind", "hex", "--cells", "6", "-o", folder / "hexes.vtu", "--json")
    )
    mine = solidmap.Map.load(folder / "box.map").remesh(kind="hex", cells=6)
    assert np.array_equal(solidmap.Mesh.load(folder / "hexes.vtu").points, mine.points)
    own = mine.report.as_dict()
    assert {name: report[name] for name in own if name not in ("seconds", "memory_estimate")} == {
        name: own[name] for name in own if name not in ("seconds", "memory_estimate")
    }


@needs_native
def test_tetrahedra_and_bijective_maps_are_the_same(program, folder, fitted):
    program("tet", folder / "ball.obj", "-o", folder / "tets.vtu", "--max-volume", "0.01")
    mine = solidmap.tetrahedralise(folder / "ball.obj", max_volume=0.01)
    assert np.array_equal(solidmap.Mesh.load(folder / "tets.vtu").points, mine.points)
    program("bijective", fitted, "-o", folder / "a.safetensors")
    solidmap.Map.load(fitted).make_bijective().save(folder / "b.safetensors")
    first, second = solidmap.Map.load(folder / "a.safetensors"), solidmap.Map.load(folder / "b.safetensors")
    assert np.array_equal(first.bijective_tets[1].points, second.bijective_tets[1].points)


def test_sequences_are_the_same(program, folder, ball):
    names = []
    for k in range(4):
        names.append(folder / f"frame{k}.obj")
        moved = ball.points.copy()
        moved[:, 2] += 0.1 * k * moved[:, 0] ** 2
        solidmap.Surface(moved, ball.faces).save(names[-1])
    report = json.loads(program("sequence", folder / "ball.obj", *names, "-o", folder / "frames", "--json", "--no-vtu",
                                "--resolution", "16"))
    mine = solidmap.sequence(folder / "ball.obj", names, resolution=16)
    for row, own in zip(report["frames"], mine.frames):
        assert row["deformation_energy"] == pytest.approx(own.deformation_energy, rel=1e-12)
        assert row["boundary_error"] == own.boundary_error.as_dict()
    assert mine.no_cycles == report["no_cycles"]


#: Commands of the program and the functions that have their options, with those that have another form here.
COMMANDS = [
    (["fit"], solidmap.fit, {"image": "images", "json": None, "threads": None, "output": None, "vtu": None, "worst": None}),
    (["boundary", "pair"], solidmap.boundary.pair, {}),
    (["boundary", "sphere"], solidmap.boundary.sphere, {"boundary": None}),
    (["boundary", "torus"], solidmap.boundary.torus, {"boundary": None}),
    (["boundary", "unfold"], solidmap.boundary.unfold, {}),
    (["boundary", "check"], solidmap.boundary.check, {}),
    (["boundary", "improve"], solidmap.boundary.improve, {}),
    (["energy"], solidmap.Map.energy, {}),
    (["certify"], solidmap.Map.certify, {}),
    (["remesh"], solidmap.Map.remesh, {}),
    (["bijective"], solidmap.Map.make_bijective, {}),
    (["transfer"], solidmap.Map.transfer, {}),
    (["polycube"], solidmap.polycube, {}),
    (["hexmesh"], solidmap.hexmesh, {}),
    (["tet"], solidmap.tetrahedralise, {}),
    (["offset"], solidmap.offset_surface, {}),
    (["sequence"], solidmap.sequence, {}),
    (["texture"], solidmap.texture, {}),
    (["compare"], solidmap.compare, {}),
]
#: What is about files, pictures and processes, and the caller's here.
ELSEWHERE = set(
    "output json threads time_limit help png html max_size samples vtu worst up target_up position section axis domain_mesh "
    "keep out fps alternatives boundary tets model_tets write_labels write_model_labels best_attempt no_vtu show at colours "
    "map through through_kind resolution metrics image jacobian distance version".split()
)


@pytest.mark.parametrize("command, function, renamed", COMMANDS, ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_options_have_the_names_and_defaults_of_the_program(program, command, function, renamed):
    from solidmap import _options

    text = program(*command, "--help")
    own = {name: parameter.default for name, parameter in inspect.signature(function).parameters.items()}
    if "method" in own and own["method"] is inspect.Parameter.empty:
        own.update(_options.METHOD_DEFAULTS)
    if "repair" in own:
        own.update(_options.REPAIR_DEFAULTS)
    # Options are indented by up to six columns, and their explanations by more.
    options = re.split(r"^ {2,6}(?:-\w, )?--(?=[a-z])", text, flags=re.MULTILINE)[1:]
    compared = 0
    for option in options:
        name = re.match(r"[a-z-]+", option).group().replace("-", "_")
        rest = re.sub(r"\s+", " ", option)
        name = renamed.get(name, name)
        if name is None or (name in ELSEWHERE and name not in own):
            continue
        assert name in own, f"{function.__qualname__} has no {name}"
        default = re.search(r"\[default: ([^\]]*)\]", rest)
        if not default or own[name] is None or own[name] is inspect.Parameter.empty:
            continue
        said, value = default.group(1), own[name]
        if isinstance(value, bool) or name in ("up", "fps"):
            continue
        if isinstance(value, (int, float)):
            assert float(said) == pytest.approx(float(value)), name
        elif isinstance(value, str):
            assert said == value, name
        elif name == "lame":
            assert [float(word) for word in said.split()] == list(value)
        elif name == "methods":
            assert said.split(",") == list(value)
        compared += 1
    assert compared or function in (
        solidmap.boundary.torus, solidmap.boundary.unfold, solidmap.Map.transfer, solidmap.offset_surface, solidmap.texture, solidmap.Map.make_bijective)
