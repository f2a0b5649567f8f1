"""The page of a comparison, as a reader uses it."""

import pytest

import shapes
from conftest import solidmap


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    """The folder of a comparison in which one of three methods fails."""
    folder = tmp_path_factory.mktemp("compare")
    vertices, triangles = shapes.ball(3)
    shapes.write_obj(folder / "ball.obj", vertices, triangles)
    shapes.write_obj(folder / "bent.obj", [shapes.bent(p) for p in vertices], triangles)
    solidmap(
        folder, "compare", "ball.obj", "--image", "bent.obj", "--methods", "mfs,fem,mean_value", "--max-tets", "10", "--no-reference",
        "--resolution", "8", "--interior", "100", "--out", "all",
    )
    return folder


@pytest.fixture
def page(comparison):
    return comparison / "all" / "comparison.html"


def test_the_picture_and_all_tables_are_seen_without_webgl_and_nothing_is_loaded(comparison, page, opened):
    without = "HTMLCanvasElement.prototype.getContext = () => null;"
    seen = opened(page, without)
    assert seen.said == []
    loaded = [url for url in seen.requested if not url.startswith(("blob:", "data:"))]
    assert loaded == [page.as_uri()]
    picture = seen.page.locator("img.chart")
    width, height = picture.evaluate("(image) => [image.naturalWidth, image.naturalHeight]")
    assert width > 600 and height > 300
    assert "mfs, mean_value" in picture.get_attribute("alt")
    tables = seen.page.locator(".data table")
    assert tables.count() == 3
    for table in (tables.nth(k) for k in range(3)):
        names = table.locator("tbody th[scope=row]")
        assert names.all_inner_texts() == ["mfs", "fem", "mean_value"]
    text = seen.page.locator("#page").inner_text()
    for words in ("Time and memory", "Boundary errors, at held-out points", "10 are allowed", "ball.obj", "bent.obj", "compare"):
        assert words in text, words


def test_heads_and_entries_stand_below_each_other(page, opened):
    seen = opened(page)
    # The right ends of the heads of single columns, and of the entries of a row.
    for places in seen.page.evaluate(
        """() => Array.from(document.querySelectorAll('.data table'), (table) => {
            const ends = (cells) => Array.from(cells, (cell) => Math.round(cell.getBoundingClientRect().right));
            const rows = table.tHead.rows;
            const alone = [...rows[0].cells].filter((cell) => rows.length === 1 || cell.rowSpan === 2);
            const heads = [...alone, ...(rows[1]?.cells ?? [])];
            return [ends(heads).sort((a, b) => a - b), ends(table.tBodies[0].rows[0].cells)];
        })"""
    ):
        assert places[0] == places[1] and len(places[0]) > 8


def test_a_page_without_a_map_has_no_picture(comparison, opened):
    solidmap(comparison, "compare", "ball.obj", "--image", "bent.obj", "--time-limit", "0.001", "--out", "none")
    seen = opened(comparison / "none" / "comparison.html")
    assert seen.said == []
    assert seen.page.locator("img").count() == 0
    assert "time limit" in seen.page.locator("#page").inner_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_narrow_window_needs_no_scrolling_but_that_of_tables(page, opened, scheme):
    seen = opened(page, viewport={"width": 400, "height": 800}, color_scheme=scheme)
    assert seen.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
