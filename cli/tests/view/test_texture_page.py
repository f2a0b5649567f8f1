"""The page of a solid texture, in a browser."""

import pytest

import shapes


def test_the_page_opens_without_errors_and_loads_nothing(texture, opened):
    page = opened(texture)
    assert page.said == []
    assert [url for url in page.requested if not url.startswith(("file:", "blob:", "data:"))] == []
    assert page.pixels(0)["colours"] > 1000


def test_the_cut_shows_the_colours_inside(texture, opened):
    page = opened(texture)
    page.set("drawn", "hidden")
    page.set("axis", "1")
    page.settle()
    # Without the surface, all that is drawn is the cut, an outline and nothing else.
    half = page.pixels(0)
    seen = page.page.evaluate(
        """() => {
            const canvas = document.querySelector('.view canvas');
            const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d');
            copy.drawImage(canvas, 0, 0);
            const box = canvas.getBoundingClientRect();
            const { centre, radius } = solidmapPage.data.domain;
            return [[0, 0, 0], [0.5, 0, 0.3], [-0.4, 0, -0.5]].map((point) => {
                const [x, y] = solidmapPage.stage.project(0, point.map((p, k) => (p - centre[k]) / radius));
                const scale = canvas.width / box.width;
                return [...copy.getImageData((x - box.left) * scale, (y - box.top) * scale, 1, 1).data];
            });
        }"""
    )
    for point, pixel in zip([(0, 0, 0), (0.5, 0, 0.3), (-0.4, 0, -0.5)], seen):
        expected = [255 * shapes.code((1 + x) / 2) for x in point]
        # Fitted to a few parts in a thousand, and a voxel is a fiftieth of the ball wide.
        assert pixel[:3] == pytest.approx(expected, abs=6), point
    page.page.get_by_label("cut", exact=True).click()
    page.settle()
    assert page.pixels(0)["covered"] == 0 < half["covered"]


def test_the_cut_moves_and_the_surface_is_drawn_in_three_ways(texture, opened):
    page = opened(texture)
    seen = {page.hashes()[0]}
    page.set("position", 0.7)
    seen.add(page.hashes()[0])
    page.page.get_by_label("other half", exact=True).click()
    seen.add(page.hashes()[0])
    page.set("axis", "2")
    seen.add(page.hashes()[0])
    page.set("drawn", "flat")
    seen.add(page.hashes()[0])
    page.set("drawn", "hidden")
    seen.add(page.hashes()[0])
    assert len(seen) == 6


def test_a_typed_point_and_the_pointer_show_its_colour(texture, opened):
    page = opened(texture)
    for name, value in zip("xyz", ("0.3", "0.1", "-0.2")):
        page.page.get_by_label(f"point {name}", exact=True).fill(value)
    page.page.keyboard.press("Tab")
    shown = [int(part) for part in page.readout()["red, green, blue"].split(",")]
    assert shown == pytest.approx([255 * shapes.code((1 + x) / 2) for x in (0.3, 0.1, -0.2)], abs=6)
    page.page.get_by_label("point x", exact=True).fill("1.5")
    page.page.keyboard.press("Tab")
    assert "outside the solid" in page.page.locator(".readout").inner_text()
    x, y = page.page.evaluate("solidmapPage.stage.project(0, [0, 0, 0])")
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt")
    assert page.readout()["point"].startswith("(")


def test_the_keyboard_reaches_every_control_and_the_page_fits_phones(texture, opened):
    page = opened(texture)
    wanted, reached = page.focusable()
    assert wanted >= 9 and reached == wanted
    narrow = opened(texture, viewport={"width": 390, "height": 800})
    assert narrow.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
