"""The page of a study, as a reader uses it."""

import pytest

import shapes
from conftest import solidmap


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The page of a study with one row that fails."""
    folder = tmp_path_factory.mktemp("study")
    vertices, triangles = shapes.ball(4)
    shapes.write_obj(folder / "ball.obj", vertices, triangles)
    shapes.write_obj(folder / "bent.obj", [shapes.bent(p) for p in vertices], triangles)
    solidmap(
        folder, "study", "placement", "ball.obj", "bent.obj", "--placements", "sphere,adaptive", "--radius", "0.4,1",
        "--alpha", "1,2", "--points", "100", "--resolution", "8", "--html", "study.html",
    )
    return folder / "study.html"


def test_the_picture_and_all_rows_are_seen_without_webgl_and_nothing_is_loaded(study, opened):
    without = "HTMLCanvasElement.prototype.getContext = () => null;"
    page = opened(study, without)
    assert page.said == []
    loaded = [url for url in page.requested if not url.startswith(("blob:", "data:"))]
    assert loaded == [study.as_uri()]
    picture = page.page.locator("img.chart")
    width, height = picture.evaluate("(image) => [image.naturalWidth, image.naturalHeight]")
    assert width > 800 and height > 1000
    rows = page.page.locator("table").first.locator("tbody tr")
    assert rows.count() == 4
    assert "more than 0.5" in rows.nth(0).inner_text()
    # Columns of the setting, then the quantities that this study has.
    assert rows.nth(1).locator("th").count() == 4
    heads = page.page.locator("table").first.locator("thead th")
    assert rows.nth(1).locator("th, td").count() == heads.count()
    meanings = page.page.locator("table").nth(1).inner_text()
    assert "C-Error" in meanings and "distortion of angles" not in meanings


def test_a_narrow_window_needs_no_scrolling_but_that_of_tables(study, opened):
    page = opened(study, viewport={"width": 400, "height": 800})
    assert page.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
