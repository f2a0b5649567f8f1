"""The page of a sequence, as a reader uses it."""

import math

import pytest

import shapes
from conftest import solidmap

FRAMES = 12


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """The page of a ball that bends there and back; the seventh frame cannot be used."""
    folder = tmp_path_factory.mktemp("sequence")
    vertices, triangles = shapes.ball(3)
    shapes.write_obj(folder / "ball.obj", vertices, triangles)
    names = []
    for k in range(FRAMES):
        amount = 0.2 * (1 - math.cos(2 * math.pi * k / FRAMES))
        names.append(f"bend{k:02}.obj")
        shapes.write_obj(folder / names[-1], [(x + amount * z * z, y, z) for x, y, z in vertices], triangles)
    (folder / names[7]).write_text("v 0 0 0\n")
    solidmap(folder, "sequence", "ball.obj", *names, "-o", "bends", "--resolution", "10", "--html", "bends.html")
    return folder


@pytest.fixture
def page(sequence, opened):
    return opened(sequence / "bends.html")


def frame(page):
    """The row of the frame that is shown."""
    return page.page.evaluate("solidmapPage.data.shown[solidmapPage.state.frame]")


def wait(page, condition):
    """Waits until a condition holds; the page's security policy forbids Playwright's own way."""
    for _ in range(200):
        if page.page.evaluate(condition):
            return
        page.page.wait_for_timeout(50)
    raise AssertionError(condition)


def test_the_page_says_nothing_loads_nothing_and_shows_every_usable_frame(sequence, page):
    assert page.said == []
    assert [url for url in page.requested if not url.startswith("blob:")] == [(sequence / "bends.html").as_uri()]
    seen = page.pixels(0)
    assert 0.02 < seen["covered"] / seen["all"] < 0.9
    assert page.page.evaluate("solidmapPage.data.shown") == [k for k in range(FRAMES) if k != 7]
    assert "1 frames could not be used" in page.page.locator(".notes").inner_text()
    numbers = page.page.locator(".about table").first.inner_text()
    assert "deformation energy, largest" in numbers and "frame 6, bend06.obj" in numbers
    files = page.page.locator(".about table").last.inner_text()
    assert all(name in files for name in ("ball.obj", "bend03.obj", "energy.csv", "surface.pvd"))
    page.page.get_by_text("All frames", exact=True).click()
    rows = page.page.locator("details tbody tr")
    assert rows.count() == FRAMES
    assert rows.nth(7).locator("td").count() == 2


def test_the_page_of_the_folder_is_the_same_but_for_where_it_comes_from(sequence, page, opened):
    solidmap(sequence, "view", "bends", "-o", "viewed.html")
    viewed = opened(sequence / "viewed.html")
    assert viewed.hashes() == page.hashes()
    viewed.set("frame", 6)
    page.set("frame", 6)
    assert viewed.hashes() == page.hashes()


def test_playing_and_scrubbing_change_the_picture(page):
    first = page.hashes()[0]
    seen = {first}
    for k in (3, 6):
        page.set("frame", k)
        assert frame(page) == k
        seen.add(page.hashes()[0])
    assert len(seen) == 3
    page.set("frame", 0)
    page.page.get_by_role("button", name="Play").click()
    wait(page, "solidmapPage.state.frame >= 2")
    page.page.get_by_role("button", name="Stop").click()
    stopped = page.hashes()[0]
    assert stopped != first and frame(page) >= 2
    page.page.wait_for_timeout(400)
    assert page.hashes()[0] == stopped
    # It begins again after the last frame.
    page.set("frame", FRAMES - 2)
    page.set("speed", 30)
    page.page.get_by_role("button", name="Play").click()
    wait(page, "solidmapPage.state.frame < 5")


def test_a_click_on_the_curve_goes_to_its_frame(page):
    box = page.page.locator(".curve").bounding_box()
    for n in (5, 8, 0):
        x = page.page.evaluate("(n) => solidmapPage.curve.placeOf(n)", n)
        page.page.mouse.click(box["x"] + x + 2, box["y"] + 40)
        page.settle()
        assert page.page.evaluate("solidmapPage.state.frame") == n
        assert page.page.get_by_label("frame", exact=True).input_value() == str(n)
    # A frame that could not be used has none to go to: its neighbour is taken.
    between = page.page.evaluate("(solidmapPage.curve.placeOf(6) + solidmapPage.curve.placeOf(7)) / 2 + 3")
    page.page.mouse.click(box["x"] + between, box["y"] + 40)
    assert frame(page) == 8


def test_the_curve_marks_the_frame_and_shows_other_quantities(page):
    curve = """() => {
        const canvas = document.querySelector('.curve');
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        let hash = 0;
        for (const value of data) hash = (Math.imul(hash, 31) + value) | 0;
        return hash;
    }"""
    seen = {page.page.evaluate(curve)}
    page.set("frame", 4)
    seen.add(page.page.evaluate(curve))
    for quantity in ("1", "3", "6"):
        page.set("of", quantity)
        seen.add(page.page.evaluate(curve))
    assert len(seen) == 5


def test_colours_scale_and_shadow_change_what_is_seen(page):
    page.set("frame", 6)
    seen = {page.hashes()[0]}
    page.page.get_by_label("logarithmic scale", exact=True).click()
    seen.add(page.hashes()[0])
    page.set("by", "displacement")
    seen.add(page.hashes()[0])
    page.page.get_by_label("reference as a shadow", exact=True).click()
    seen.add(page.hashes()[0])
    assert len(seen) == 4


def test_the_pointer_reads_the_surface(page):
    page.set("frame", 6)
    x, y = page.page.evaluate("solidmapPage.stage.project(0, [0, 0, 0])")
    page.page.mouse.move(x, y)
    page.page.wait_for_selector(".readout dt >> text=in the reference")
    values = page.readout()
    point, reference = (
        [float(part) for part in values[name].strip("()").split(",")] for name in ("point", "in the reference")
    )
    assert math.dist(point, reference) == pytest.approx(float(values["displacement"]), rel=0.05, abs=2e-3)
    assert math.hypot(*reference) == pytest.approx(1, abs=0.03)
    # Another frame has other values under the same pointer.
    page.page.locator(".curve").focus()
    page.page.keyboard.press("Home")
    page.settle()
    assert float(page.readout()["displacement"]) < 1e-6


def test_the_keyboard_reaches_every_control_and_plays(page):
    wanted, reached = page.focusable()
    assert wanted >= 11 and reached == wanted
    page.page.locator(".curve").focus()
    for key, row in (("End", 11), ("ArrowLeft", 10), ("PageDown", 0), ("ArrowRight", 1)):
        page.page.keyboard.press(key)
        assert frame(page) == row
    page.page.keyboard.press(" ")
    wait(page, "solidmapPage.state.frame >= 3")
    page.page.keyboard.press(" ")
    assert page.page.evaluate("solidmapPage.state.playing") is False
    before = page.hashes()
    page.page.locator(".view canvas").focus()
    page.page.keyboard.press("ArrowLeft")
    assert page.hashes() != before


def test_fewer_frames_keep_to_the_largest_size_and_the_page_says_so(sequence, opened):
    solidmap(sequence, "view", "bends", "-o", "small.html", "--max-size", f"{(sequence / 'bends.html').stat().st_size - 10_000}")
    small = opened(sequence / "small.html")
    shown = small.page.evaluate("solidmapPage.data.shown")
    assert len(shown) < FRAMES - 1 and shown[0] == 0 and shown[-1] == FRAMES - 1
    # The one of most energy is there.
    assert 6 in shown
    assert f"{len(shown)} of {FRAMES - 1} surfaces are in this page" in small.page.locator(".notes").inner_text()


def test_a_collection_of_another_program_is_played_by_displacement(sequence, opened):
    names = sorted((sequence / "bends/surface").iterdir())[:3]
    steps = "".join(f'<DataSet timestep="{k / 10}" file="{name}"/>' for k, name in enumerate(names))
    (sequence / "other.pvd").write_text(f'<VTKFile type="Collection"><Collection>{steps}</Collection></VTKFile>')
    solidmap(sequence, "view", "other.pvd", "-o", "other.html")
    other = opened(sequence / "other.html")
    assert other.said == []
    assert other.page.evaluate("solidmapPage.data.curves.map(({ label }) => label)") == ["displacement"]
    # Ten frames a second, as the times say.
    assert other.page.evaluate("solidmapPage.state.rate") == 10


def test_the_page_fits_phones(sequence, opened):
    page = opened(sequence / "bends.html", viewport={"width": 390, "height": 800}, color_scheme="dark")
    assert page.page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.pixels(0)["covered"] > 1500
