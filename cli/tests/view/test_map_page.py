"""The page of a map, as a reader uses it."""

import csv
import math
import re

import pytest

import shapes
from conftest import solidmap


def numbers(text):
    return [float(number) for number in re.findall(r"-?[\d.]+(?:e[+-]?\d+)?", text)]


def test_a_page_opens_without_errors_and_loads_nothing(maps, opened):
    page = opened(maps / "bent.html")
    assert page.said == []
    others = [url for url in page.requested if not url.startswith("blob:")]
    assert others == [(maps / "bent.html").as_uri()]
    assert page.page.title() == "bent.map: harmonic map"


def test_both_views_show_a_solid(maps, opened):
    page = opened(maps / "bent.html")
    for view in (0, 1):
        seen = page.pixels(view)
        assert 0.1 < seen["covered"] / seen["all"] < 0.9
        assert seen["colours"] > 200


def test_the_cut_moves_in_both_views_and_the_target_alone_moves_to_the_domain(maps, opened):
    page = opened(maps / "bent.html")
    first = page.hashes()
    page.set("position", 0.25)
    cut = page.hashes()
    assert cut[0] != first[0] and cut[1] != first[1]
    page.set("axis", "2")
    across = page.hashes()
    assert across[0] != cut[0] and across[1] != cut[1]
    page.set("move", 0.5)
    half = page.hashes()
    assert half[0] == across[0] and half[1] != across[1]
    page.set("move", 0)
    # All the way back, the target's view shows the domain.
    domain, target = page.hashes()
    assert domain == target


def test_colours_patterns_and_halves_change_what_is_seen(maps, opened):
    page = opened(maps / "bent.html")
    seen = {tuple(page.hashes())}
    for field in ("deformation", "volume", "anisotropy", "distance"):
        page.set("by", field)
        seen.add(tuple(page.hashes()))
    for label in ("other half", "lattice lines on the cut"):
        page.page.get_by_label(label, exact=True).click()
        seen.add(tuple(page.hashes()))
    for pattern in ("coloured", "plain", "hidden"):
        page.set("pattern", pattern)
        seen.add(tuple(page.hashes()))
    page.page.get_by_label("cut", exact=True).click()
    seen.add(tuple(page.hashes()))
    # Without boundary and cut, nothing is left.
    assert page.pixels(0)["covered"] == 0
    assert len(seen) == 11


@pytest.mark.parametrize("view", [0, 1])
@pytest.mark.parametrize("point", [(0.1, 0.0, 0.2), (-0.4, 0.0, 0.3)])
def test_the_pointer_shows_what_eval_gives(maps, opened, tmp_path, view, point):
    page = opened(maps / "bent.html")
    page.set("axis", "1")
    # Across y at 0: the point is on the cut. Where its image is drawn, the target's view shows it.
    x, y = page.page.evaluate(
        """([view, point]) => {
            const { stage, data, valuesAt } = window.solidmapPage;
            const place = (p, { centre, radius }) => p.map((x, k) => (x - centre[k]) / radius);
            const { image } = window.solidmapPage.valuesAt(point);
            return stage.project(view, view ? place(image, data.target) : place(point, data.domain));
        }""",
        [view, point],
    )
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt")
    shown = page.readout()
    found = numbers(shown["point"])
    # A pixel is a few thousandths of the solid.
    assert found == pytest.approx(point, abs=0.02)
    (tmp_path / "at.csv").write_text("x,y,z\n" + ",".join(map(str, found)) + "\n")
    solidmap(tmp_path, "eval", maps / "bent.map", "at.csv", "-o", "images.csv", "--jacobian")
    with open(tmp_path / "images.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    row = {name: float(value) for name, value in row.items()}
    # What is shown has eight digits, and so has the point that was evaluated.
    assert numbers(shown["image"]) == pytest.approx([row[k] for k in ("fx", "fy", "fz")], rel=1e-6, abs=1e-6)
    j = [[row[f"j{i}{k}"] for k in range(3)] for i in range(3)]
    determinant = sum(
        j[0][k] * (j[1][(k + 1) % 3] * j[2][(k + 2) % 3] - j[1][(k + 2) % 3] * j[2][(k + 1) % 3]) for k in range(3)
    )
    assert float(shown["det J"]) == pytest.approx(determinant, rel=1e-5)
    # Without the scale to unit volume, which is the same for all points.
    scale = (float(shown["det J, both solids at unit volume"]) / determinant) ** (2 / 3)
    squares = sum(entry * entry for line in j for entry in line)
    assert float(shown["harmonic energy density"]) == pytest.approx(scale * squares, rel=1e-4)


def test_a_point_is_typed_where_there_is_no_pointer(maps, opened):
    page = opened(maps / "bent.html")
    for name, value in zip("xyz", ("0.3", "0.1", "-0.2")):
        page.page.get_by_label(f"point {name}", exact=True).fill(value)
    page.page.keyboard.press("Tab")
    assert numbers(page.readout()["point"]) == [0.3, 0.1, -0.2]
    page.page.get_by_label("point x", exact=True).fill("1.5")
    page.page.keyboard.press("Tab")
    assert "outside the domain" in page.page.locator(".readout").inner_text()


def test_folds_have_a_colour_of_their_own(maps, opened):
    assert opened(maps / "bent.html").wrong_pixels() == 0
    page = opened(maps / "folded.html")
    assert page.wrong_pixels() > 1000
    for name, value in zip("xyz", ("-0.9", "0", "0")):
        page.page.get_by_label(f"point {name}", exact=True).fill(value)
    page.page.keyboard.press("Tab")
    assert "folded" in page.readout()


def test_the_keyboard_reaches_every_control_and_turns_the_solids(maps, opened):
    page = opened(maps / "bent.html")
    wanted, reached = page.focusable()
    assert wanted >= 14 and reached == wanted
    page.page.locator(".view canvas").first.focus()
    pictures = [page.hashes()]
    for key in ("ArrowLeft", "ArrowUp", "+", "-", "ArrowDown", "0"):
        page.page.keyboard.press(key)
        pictures.append(page.hashes())
    for before, after in zip(pictures, pictures[1:]):
        assert before[0] != after[0] and before[1] != after[1]
    assert pictures[-1] == pictures[0]


def test_the_cameras_are_one(maps, opened):
    page = opened(maps / "bent.html")
    before = page.hashes()
    box = page.page.locator(".view canvas").nth(1).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 60, y + 20, steps=3)
    page.page.mouse.up()
    after = page.hashes()
    assert before[0] != after[0] and before[1] != after[1]


def test_the_cut_is_dragged_with_shift(maps, opened):
    page = opened(maps / "bent.html")
    # Along z, which points up on the screen.
    page.set("axis", "2")
    before = page.hashes()
    box = page.page.locator(".view canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    camera = "solidmapPage.stage.camera.position.toArray()"
    where = page.page.evaluate(camera)
    page.page.keyboard.down("Shift")
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x, y + 40, steps=4)
    page.page.mouse.up()
    page.page.keyboard.up("Shift")
    after = page.hashes()
    assert before[0] != after[0] and before[1] != after[1]
    assert float(page.page.get_by_label("position", exact=True).input_value()) < 0.45
    assert page.page.evaluate(camera) == where


def test_hostile_names_do_no_harm(maps, opened, tmp_path):
    # The folder and the name together hold the end of a script element.
    folder = tmp_path / "<"
    folder.mkdir()
    name = "script><img src=x onerror=\"alert('harm')\">\"'`${1}{{DATA}}.map"
    (folder / name).write_bytes((maps / "bent.map").read_bytes())
    solidmap(tmp_path, "view", f"</{name}", "-o", "page.html", "--samples", "8")
    page = opened(tmp_path / "page.html")
    assert page.said == []
    assert page.page.locator("h1").inner_text() == f"{name}: harmonic map"
    assert page.page.locator("img").count() == 0
    assert f"</{name}".replace("'", "'\\''") in page.page.locator("section.about").inner_text()


def test_without_webgl_the_numbers_are_there(maps, opened):
    script = "HTMLCanvasElement.prototype.getContext = () => null;"
    page = opened(maps / "bent.html", script)
    assert "has no WebGL 2" in page.page.locator("#message").inner_text()
    assert "harmonic energy" in page.page.locator("table").first.inner_text()
    assert page.page.locator("canvas").count() == 0


def test_the_page_fits_phones_and_dark_screens(maps, opened):
    page = opened(maps / "bent.html", viewport={"width": 390, "height": 800}, color_scheme="dark")
    wide = page.page.evaluate("document.documentElement.scrollWidth")
    assert wide <= 390
    for view in (0, 1):
        assert page.pixels(view)["covered"] > 2000
    red, green, blue = numbers(page.page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert max(red, green, blue) < 60


def test_the_picture_is_saved(maps, opened):
    page = opened(maps / "bent.html")
    with page.page.expect_download() as saved:
        page.page.get_by_role("button", name="Save picture").click()
    content = saved.value.path().read_bytes()
    assert content.startswith(b"\x89PNG") and len(content) > 10_000


def test_a_page_that_would_be_too_large_says_that_it_is_coarser(maps, opened, tmp_path):
    said = solidmap(tmp_path, "view", maps / "bent.map", "-o", "small.html", "--max-size", "1MB", "--json")
    assert '"coarser": true' in said
    assert (tmp_path / "small.html").stat().st_size <= 1_000_000
    page = opened(tmp_path / "small.html")
    assert "Sampled more coarsely than asked for" in page.page.locator(".notes").inner_text()
    assert page.said == []


def test_what_is_proved_is_shown_by_boxes_in_the_domain(maps, opened):
    # Sources of the default placement are too near to the boundary of so coarse a ball for anything to be proved.
    solidmap(maps, "fit", "ball.obj", "--image", "folded.obj", "-o", "far.map", "--placement", "sphere", "--no-refine")
    solidmap(maps, "certify", "far.map", "--finest", "64", "--html", "proved.html", "--samples", "16")
    page = opened(maps / "proved.html")
    assert page.said == []
    folded, undecided = page.page.evaluate("['folded', 'undecided'].map((name) => solidmapPage.arrays[name].length / 4)")
    assert folded > 10 and undecided > 10
    # With x² on the boundary continued by (1 + 2x² - y² - z²) / 3 the map turns back where x < -5/8, in a ball of radius 1 and a
    # view of radius 3^½.
    farthest = page.page.evaluate(
        "Math.max(...solidmapPage.arrays.folded.filter((_, k) => k % 4 === 0)) * Math.sqrt(3)")
    assert -0.75 < farthest < -0.6
    seen = [page.hashes()]
    for name in ("folded boxes", "undecided boxes"):
        page.page.get_by_label(name, exact=True).click()
        seen.append(page.hashes())
    domain, target = zip(*seen)
    assert len(set(domain)) == 3 and len(set(target)) == 1
    assert "proved to be inverted" in page.page.locator(".about table").first.inner_text()


def test_a_field_that_the_map_carries_is_shown_first_and_read(maps, opened):
    solidmap(maps, "transfer", "bent.map", "--distance", "-o", "carried.vtu", "--html", "carried.html", "--samples", "32")
    page = opened(maps / "carried.html")
    assert page.said == []
    assert page.page.get_by_label("by", exact=True).input_value() == "carried-0"
    point = (0.3, 0.1, -0.2)
    for name, value in zip("xyz", map(str, point)):
        page.page.get_by_label(f"point {name}", exact=True).fill(value)
    page.page.keyboard.press("Tab")
    # Linear between samples that are a sixteenth apart, in a ball that is cut into flat triangles.
    assert float(page.readout()["distance"]) == pytest.approx(1 - math.hypot(*point), abs=0.01)
    before = page.hashes()
    page.set("by", "harmonic")
    assert all(a != b for a, b in zip(before, page.hashes()))


def test_labels_that_the_map_carries_are_not_mixed(maps, opened):
    parts = maps / "parts.vtk"
    shapes.write_block(parts, 8)
    # Around the ball, with the labels' border in the middle.
    lines = parts.read_text().split("\n")
    first = next(n for n, line in enumerate(lines) if line.startswith("POINTS")) + 1
    for n in range(first, first + 9**3):
        lines[n] = " ".join(repr(2.4 * float(x) - 1.2) for x in lines[n].split())
    parts.write_text("\n".join(lines))
    solidmap(maps, "transfer", "bent.map", "parts.vtk", "--label", "part", "-o", "parts.vtu", "--html", "parts.html", "--samples", "32")
    page = opened(maps / "parts.html")
    assert page.said == []
    key = page.page.evaluate("solidmapPage.data.fields.find(({ label }) => label === 'part').key")
    page.set("by", key)
    page.set("axis", "2")
    for view in (0, 1):
        counts = page.label_pixels(view)
        assert min(counts[1], counts[5]) > 2000
        assert max(count for label, count in enumerate(counts) if label not in (1, 5)) < 50
    # Away from the node in the middle that is moved.
    for x, label in (("-0.04", "1"), ("0.04", "5")):
        page.page.get_by_label("point x", exact=True).fill(x)
        page.page.get_by_label("point y", exact=True).fill("-0.5")
        page.page.get_by_label("point z", exact=True).fill("-0.4")
        page.page.keyboard.press("Tab")
        assert page.readout()["part"] == label
