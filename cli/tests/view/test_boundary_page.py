"""The page of a boundary map, as a reader uses it."""

import math

import pytest

import shapes
from conftest import solidmap
from test_map_page import numbers


def test_the_surface_and_its_image_are_seen_and_nothing_is_loaded(boundary, opened):
    page = opened(boundary)
    assert page.said == []
    assert [url for url in page.requested if not url.startswith("blob:")] == [boundary.as_uri()]
    for view in (0, 1):
        seen = page.pixels(view)
        assert 0.1 < seen["covered"] / seen["all"] < 0.9 and seen["colours"] > 200
    assert "inverted triangles" in page.page.locator("table").first.inner_text()


def test_colours_and_the_way_to_the_image(boundary, opened):
    page = opened(boundary)
    seen = {tuple(page.hashes())}
    for colour in ("checker", "area", "angle"):
        page.set("by", colour)
        seen.add(tuple(page.hashes()))
    assert len(seen) == 4
    before = page.hashes()
    page.set("move", 0)
    after = page.hashes()
    assert after[0] == before[0] and after[1] != before[1] and after[0] == after[1]


def test_the_pointer_shows_a_point_and_its_image_on_the_sphere(boundary, opened):
    page = opened(boundary)
    x, y = page.page.evaluate("solidmapPage.stage.project(0, [0, 0, 0])")
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt")
    point, image = (numbers(page.readout()[name]) for name in ("point", "image"))
    assert (point[0] / 2) ** 2 + point[1] ** 2 + (point[2] / 0.7) ** 2 == pytest.approx(1, abs=0.02)
    # Inside the sphere by the height of its triangles at most.
    assert sum(c * c for c in image) == pytest.approx(1, abs=0.02)


def test_inverted_images_have_a_colour_of_their_own(boundary, maps, opened):
    assert opened(boundary).wrong_pixels() == 0
    vertices, triangles = shapes.ball(4)
    # One vertex is drawn across its neighbours, so that some triangles around it turn over.
    length = math.hypot(0.9, 0.3, 0.2)
    shapes.write_obj(maps / "turned.obj", [(0.9 / length, 0.3 / length, 0.2 / length), *vertices[1:]], triangles)
    solidmap(maps, "boundary", "check", "ball.obj", "turned.obj", "--html", "turned.html")
    page = opened(maps / "turned.html")
    assert page.said == []
    assert 1 <= page.page.evaluate("solidmapPage.arrays.flipped.length") <= 6
    assert page.wrong_pixels() > 20
    page.set("by", "checker")
    assert page.wrong_pixels() > 20


def test_the_keyboard_reaches_every_control(boundary, opened):
    wanted, reached = opened(boundary).focusable()
    assert wanted >= 6 and reached == wanted


def test_a_surface_and_its_layout_are_seen_with_a_table(unfolded, opened):
    page = opened(unfolded)
    assert page.said == []
    assert page.page.locator(".view figcaption").all_inner_texts() == ["Surface", "Layout"]
    for view in (0, 1):
        seen = page.pixels(view)
        assert 0.1 < seen["covered"] / seen["all"] < 0.9 and seen["colours"] > 200
    numbers_of_layout = page.page.locator("table").first.inner_text()
    for name in ("genus", "sides", "vertices of the layout", "99 %"):
        assert name in numbers_of_layout, name
    assert page.wrong_pixels(1) == 0


def test_a_layout_is_seen_from_above_however_the_surface_is_turned(unfolded, opened):
    page = opened(unfolded)
    before = page.hashes()
    page.page.locator(".view canvas").first.focus()
    for _ in range(5):
        page.page.keyboard.press("ArrowLeft")
    after = page.hashes()
    assert after[0] != before[0] and after[1] == before[1]
    # All the way back, it is the surface, as it is turned.
    page.set("move", 0)
    surface, layout = page.hashes()
    assert surface == layout == after[0]


def test_the_pointer_in_a_layout_shows_the_place_on_the_surface(unfolded, opened):
    page = opened(unfolded)
    page.page.keyboard.press("Tab")
    page.page.keyboard.press("ArrowUp")
    page.settle()
    wanted, (x, y) = page.page.evaluate(
        """() => {
            const { centre, radius } = solidmapPage.data.target;
            const point = [0.05, -0.1, 0];
            return [point.map((c, k) => centre[k] + radius * c), solidmapPage.stage.project(1, point)];
        }"""
    )
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt")
    layout, point = (numbers(page.readout()[name]) for name in ("layout", "point"))
    assert layout == pytest.approx(wanted, abs=0.01)
    distance = math.hypot(math.hypot(*point[:2]) - 2, point[2])
    assert distance == pytest.approx(0.8, abs=0.03)
