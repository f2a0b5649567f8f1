"""A program, a browser, and pages to open in it."""

import json
import os
import pathlib
import subprocess

import pytest
from playwright.sync_api import sync_playwright

import shapes

ROOT = pathlib.Path(__file__).resolve().parents[3]
PROGRAM = os.environ.get("SOLIDMAP_PROGRAM", str(ROOT / "target/release/solidmap"))
WRONG = (255, 0, 128)
# A graphics card is simulated: WebGL by SwiftShader.
BROWSER = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def solidmap(folder, *arguments):
    """Runs the program, and returns what it prints."""
    ran = subprocess.run([PROGRAM, *map(str, arguments)], cwd=folder, capture_output=True, text=True, timeout=120)
    assert ran.returncode in (0, 1), f"{arguments}: {ran.stderr}"
    return ran.stdout


@pytest.fixture(scope="session")
def maps(tmp_path_factory):
    """A folder with `bent.map` and `folded.map`."""
    folder = tmp_path_factory.mktemp("maps")
    vertices, triangles = shapes.ball(4)
    shapes.write_obj(folder / "ball.obj", vertices, triangles)
    for name in ("bent", "folded"):
        image = [getattr(shapes, name)(p) for p in vertices]
        shapes.write_obj(folder / f"{name}.obj", image, triangles)
        solidmap(folder, "fit", "ball.obj", "--image", f"{name}.obj", "-o", f"{name}.map", "--tolerance", "0.01")
        solidmap(folder, "view", f"{name}.map", "-o", f"{name}.html", "--samples", "32")
    return folder


@pytest.fixture(scope="session")
def texture(tmp_path_factory):
    """The page of a ball whose colours are linear in the coordinates, and so is the light inside."""
    folder = tmp_path_factory.mktemp("textures")
    vertices, triangles = shapes.ball(4)
    lines = [" ".join(map(repr, ("v", *p, *(shapes.code((1 + x) / 2) for x in p)))).replace("'", "") for p in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    (folder / "ball.obj").write_text("\n".join(lines) + "\n")
    solidmap(folder, "texture", "ball.obj", "--html", "ball.html", "--resolution", "48")
    return folder / "ball.html"


@pytest.fixture(scope="session")
def boundary(maps):
    """The page of a boundary map onto the sphere, of an ellipsoid."""
    vertices, triangles = shapes.ball(4)
    shapes.write_obj(maps / "ellipsoid.obj", [(2 * x, y, 0.7 * z) for x, y, z in vertices], triangles)
    solidmap(maps, "boundary", "sphere", "ellipsoid.obj", "-o", "sphere.obj", "--boundary", "way.safetensors")
    solidmap(maps, "view", "way.safetensors", "-o", "way.html")
    return maps / "way.html"


@pytest.fixture(scope="session")
def unfolded(tmp_path_factory):
    """The page of a ring that is laid out in a parallelogram."""
    folder = tmp_path_factory.mktemp("unfolded")
    shapes.write_obj(folder / "ring.obj", *shapes.ring(2, 0.8, 36, 18))
    solidmap(folder, "boundary", "unfold", "ring.obj", "--html", "ring.html")
    return folder / "ring.html"


@pytest.fixture(scope="session")
def block(tmp_path_factory):
    """The page of a block of 8 × 8 × 8 hexahedra, and what `check` says of it."""
    folder = tmp_path_factory.mktemp("meshes")
    shapes.write_block(folder / "block.vtk", 8)
    solidmap(folder, "view", "block.vtk", "-o", "block.html")
    report = json.loads(solidmap(folder, "check", "block.vtk", "--json"))
    return folder / "block.html", report["models"][0]["cell_mesh"]


@pytest.fixture(scope="session")
def browser():
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"), args=BROWSER)
        yield running
        running.close()


class Opened:
    """A page in the browser, and what it did."""

    def __init__(self, browser, path, script="", **settings):
        settings = {"viewport": {"width": 1280, "height": 900}, "color_scheme": "light", **settings}
        self.context = browser.new_context(**settings)
        self.page = self.context.new_page()
        self.said, self.requested = [], []
        self.page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.said.append(f"error: {error}"))
        self.page.on("request", lambda request: self.requested.append(request.url))
        self.page.on("dialog", lambda dialog: (self.said.append(f"dialog: {dialog.message}"), dialog.dismiss()))
        if script:
            self.page.add_init_script(script)
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("body[data-ready]", timeout=60_000)
        self.settle()

    def settle(self):
        """Waits until what has changed is drawn."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def pixels(self, view):
        """A view's picture: a hash, how many pixels are covered, and how many colours there are."""
        return self.page.evaluate(
            """(view) => {
                const canvas = document.querySelectorAll('.view canvas')[view];
                const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d');
                copy.drawImage(canvas, 0, 0);
                const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
                let [hash, covered] = [0, 0];
                const colours = new Map();
                for (let k = 0; k < data.length; k += 4) {
                    const colour = (data[k] << 16) | (data[k + 1] << 8) | data[k + 2];
                    hash = (Math.imul(hash, 31) + colour + data[k + 3]) | 0;
                    if (data[k + 3] > 0) {
                        covered += 1;
                        colours.set(colour, (colours.get(colour) ?? 0) + 1);
                    }
                }
                return { hash, covered, colours: colours.size, all: data.length / 4, named: Object.fromEntries(colours) };
            }""",
            view,
        )

    def hashes(self):
        """The pictures of all views."""
        self.settle()
        return [self.pixels(view)["hash"] for view in range(self.page.locator(".view canvas").count())]

    def wrong_pixels(self, view=0):
        """How many pixels have the colour of what is folded or inverted; shading makes it darker."""
        self.settle()
        count = 0
        for colour, pixels in self.pixels(view)["named"].items():
            red, green, blue = (int(colour) >> shift & 255 for shift in (16, 8, 0))
            share = red / WRONG[0]
            if share > 0.5 and green < 8 and abs(blue - share * WRONG[2]) < 4:
                count += pixels
        return count

    def label_pixels(self, view=0):
        """How many pixels have the colour of each label, however they are lit."""
        self.settle()
        palette = self.page.evaluate("solidmapPage.data.palettes.labels")
        counts = [0] * len(palette)
        for colour, pixels in self.pixels(view)["named"].items():
            seen = [int(colour) >> shift & 255 for shift in (16, 8, 0)]
            for label, wanted in enumerate(palette):
                share = max(seen) / max(wanted)
                if share > 0.5 and all(abs(a - share * b) < 4 for a, b in zip(seen, wanted)):
                    counts[label] += pixels
        return counts

    def focusable(self):
        """How many controls there are, and how many of them the Tab key reaches."""
        wanted = self.page.locator("canvas[tabindex], select, input, button, summary").count()
        reached = set()
        for _ in range(wanted + 2):
            self.page.keyboard.press("Tab")
            reached.add(
                self.page.evaluate(
                    """() => {
                        const all = [...document.querySelectorAll('canvas[tabindex], select, input, button, summary')];
                        return all.indexOf(document.activeElement);
                    }"""
                )
            )
        return wanted, len(reached - {-1})

    def set(self, label, value):
        """Sets a slider or a choice by its label."""
        control = self.page.get_by_label(label, exact=True)
        if control.evaluate("(one) => one.tagName") == "SELECT":
            control.select_option(value)
        else:
            control.fill(str(value))
        self.settle()

    def readout(self):
        """The values at the pointer by their names."""
        return self.page.evaluate(
            """() => Object.fromEntries(Array.from(document.querySelectorAll('.readout dt'),
                (name) => [name.textContent, name.nextSibling.textContent]))"""
        )


@pytest.fixture
def opened(browser):
    """Opens pages, and closes them at the end."""
    pages = []

    def open_page(path, script="", **settings):
        pages.append(Opened(browser, path, script, **settings))
        return pages[-1]

    yield open_page
    for page in pages:
        page.context.close()
