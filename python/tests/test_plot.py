"""Pictures: not blank, not of one colour, and showing what they are about."""

import numpy as np
import pytest

import solidmap

pytest.importorskip("pyvista")
pytest.importorskip("matplotlib")


def picture(plotter):
    found = plotter.screenshot(return_img=True)
    plotter.close()
    return found[..., :3].astype(int)


def require_drawing(image, least=0.05):
    background = image[0, -1]
    drawn = np.abs(image - background).sum(axis=2) > 24
    assert drawn.mean() > least, "the picture is blank"
    assert len(np.unique(image[drawn] // 16, axis=0)) > 12, "the picture has one colour"
    return drawn


SIZE = (600, 300)


def test_maps_are_drawn_with_a_cut_on_both_sides(f):
    for by in ("energy", "det_jacobian", lambda points: points[:, 2]):
        image = picture(f.plot(off_screen=True, window_size=SIZE, by=by))
        drawn = require_drawing(image)
        assert drawn[:, :300].mean() > 0.05 and drawn[:, 300:].mean() > 0.05
    # Another plane is another picture.
    first, second = (picture(f.plot(off_screen=True, window_size=SIZE, clip=c)) for c in (("y", 0.5), ("z", 0.3)))
    assert np.abs(first - second).mean() > 1
    picture(f.plot(off_screen=True, window_size=SIZE, clip=([1, 1, 0], [0, 0, 0])))


def test_meshes_are_cut_open(f, tets):
    carried = f.remesh(mesh=tets)
    whole = require_drawing(picture(carried.plot(off_screen=True, window_size=SIZE)))
    cut = require_drawing(picture(carried.plot(clip="x", off_screen=True, window_size=SIZE)))
    assert (whole != cut).any()
    mesh = solidmap.Mesh(tets.points, tets.cells)
    mesh.cell_data["number"] = np.arange(len(tets.cells))
    require_drawing(picture(mesh.plot(by="number", off_screen=True, window_size=SIZE)))


def test_boundary_maps_have_one_pattern_on_both(f):
    drawn = require_drawing(picture(f.boundary.plot(off_screen=True, window_size=SIZE)))
    assert drawn[:, :300].mean() > 0.05 and drawn[:, 300:].mean() > 0.05


def test_histograms_count_what_they_say(f, tets):
    axes = solidmap.plot.histogram(f, samples=3000)
    assert axes.get_xlabel() == "det J"
    heights = [bar.get_height() for bar in axes.patches]
    centre = sum(h * (bar.get_x() + bar.get_width() / 2) for h, bar in zip(heights, axes.patches)) / sum(heights)
    # The mean determinant is the ratio of the volumes.
    assert centre == pytest.approx(f.target.volume / f.domain.volume, rel=0.02)
    assert sum(heights) == 3000
    assert sum(bar.get_height() for bar in solidmap.plot.histogram(tets).patches) == len(tets.cells)
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 4


def test_what_cannot_be_drawn_is_refused(f, tets):
    for call, words in [
        (lambda: f.plot(clip="w", off_screen=True), 'clip is \'w\', but must be one of "x", "y", "z"'),
        (lambda: f.plot(clip=("x", 7.0), off_screen=True), "clip has the position 7"),
        (lambda: f.plot(by="colour", off_screen=True), "by is 'colour'"),
        (lambda: tets.plot(by="nothing", off_screen=True), "by is 'nothing'"),
        (lambda: f.plot(clip=([1, 0, 0], [99, 0, 0]), off_screen=True), "does not meet the domain"),
    ]:
        with pytest.raises(solidmap.InvalidInputError, match=words):
            call()
