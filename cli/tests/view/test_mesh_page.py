"""The page of a mesh, as a reader uses it."""

import re

import pytest


def shown(page):
    """How many cells are shown, of how many, and how many are inverted."""
    page.settle()
    return [int(number) for number in re.findall(r"\d+", page.page.get_by_role("status").inner_text())]


def test_all_cells_are_there_and_counted_as_check_does(block, opened):
    path, report = block
    page = opened(path)
    assert page.said == []
    assert [url for url in page.requested if not url.startswith("blob:")] == [path.as_uri()]
    seen = page.pixels(0)
    assert 0.1 < seen["covered"] / seen["all"] < 0.9
    assert shown(page) == [512, 512, report["inverted_cells"]]
    least = page.page.evaluate("Math.min(...solidmapPage.arrays['field-quality'])")
    assert least == pytest.approx(report["min_scaled_jacobian"], abs=1e-6)
    assert report["inverted_cells"] > 0


def test_cells_are_peeled_whole_and_inverted_ones_stay(block, opened):
    path, report = block
    page = opened(path)
    inverted = report["inverted_cells"]
    # Nothing is inverted at the boundary.
    assert page.wrong_pixels() == 0
    seen = {tuple(page.hashes())}
    page.set("to", page.page.get_by_label("from", exact=True).get_attribute("min"))
    # Only the worst cell is left in range, and it is inverted.
    assert shown(page)[0] == inverted
    assert page.wrong_pixels() > 500
    seen.add(tuple(page.hashes()))
    page.set("to", page.page.get_by_label("to", exact=True).get_attribute("max"))
    assert shown(page)[0] == 512
    # The cells of the outermost layer are less deep than a cell is high.
    page.set("at least", 0.12)
    peeled = shown(page)[0]
    assert inverted < peeled < 512
    seen.add(tuple(page.hashes()))
    page.set("at least", 0)
    page.page.get_by_label("cut", exact=True).click()
    assert shown(page)[0] < 512
    assert page.wrong_pixels() > 0
    half = page.hashes()
    page.set("position", 0.8)
    assert page.hashes() != half
    page.page.get_by_label("other half", exact=True).click()
    seen.add(tuple(page.hashes()))
    assert len(seen) == 4


def test_the_histogram_is_brushed(block, opened):
    page = opened(block[0])
    box = page.page.locator(".histogram").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + 2, middle)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + box["width"] / 2, middle, steps=4)
    page.page.mouse.up()
    brushed = shown(page)
    assert brushed[2] <= brushed[0] < 512
    # What is shown is what is in the range of the sliders, and what is inverted.
    expected = page.page.evaluate(
        """() => {
            const { state, arrays, isInverted } = solidmapPage;
            return arrays['field-quality'].reduce((sum, value, cell) =>
                sum + (isInverted[cell] || (value >= state.range[0] && value <= state.range[1]) ? 1 : 0), 0);
        }"""
    )
    assert brushed[0] == expected
    page.page.mouse.click(box["x"] + box["width"] / 2, middle)
    assert shown(page)[0] == 512


def test_edges_colours_and_shadow_change_what_is_seen(block, opened):
    page = opened(block[0])
    seen = {tuple(page.hashes())}
    page.page.get_by_label("edges", exact=True).click()
    seen.add(tuple(page.hashes()))
    for field in ("depth", "file-0"):
        page.set("by", field)
        seen.add(tuple(page.hashes()))
    page.set("at least", 0.2)
    few = page.pixels(0)["covered"]
    page.page.get_by_label("boundary as a shadow", exact=True).click()
    page.settle()
    assert page.pixels(0)["covered"] > 2 * few
    assert len(seen) == 4
    page.page.get_by_label("feature edges", exact=True).click()
    seen.add(tuple(page.hashes()))
    assert len(seen) == 5
    # Those of the block, each of which is eight cells long; the top is only a little uneven.
    assert page.page.evaluate("solidmapPage.features.geometry.getAttribute('position').count / 2") == 12 * 8


def test_labels_have_a_colour_each(block, opened):
    page = opened(block[0])
    page.page.get_by_label("edges", exact=True).click()
    page.set("by", "file-1")
    counts = page.label_pixels()
    assert min(counts[1], counts[5]) > 3000
    assert [count for label, count in enumerate(counts) if label not in (1, 5)] == [0] * 5
    # The cells' numbers are not labels.
    assert page.page.evaluate("solidmapPage.data.fields.map(({ palette }) => palette)") == ["quality", "amount", "amount", "labels"]
    assert "After 7 labels" in page.page.locator(".legend").first.inner_text()


def test_the_pointer_names_the_cell(block, opened):
    page = opened(block[0])
    x, y = page.page.evaluate("solidmapPage.stage.project(0, [0, 0, 0])")
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt")
    values = page.readout()
    # The file numbers its cells in the field that it has.
    assert values["cell (from 0)"] == values["number"]
    assert 0 < float(values["depth"]) < 1 / 8


def test_the_keyboard_reaches_every_control(block, opened):
    page = opened(block[0])
    wanted, reached = page.focusable()
    assert wanted >= 12 and reached == wanted
    before = page.hashes()
    page.page.locator(".view canvas").focus()
    page.page.keyboard.press("ArrowLeft")
    assert page.hashes() != before


def test_the_page_fits_phones(block, opened):
    page = opened(block[0], viewport={"width": 390, "height": 800}, color_scheme="dark")
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.pixels(0)["covered"] > 5000
