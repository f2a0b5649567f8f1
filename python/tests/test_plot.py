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


def test_certificates_show_what_is_proved(ball, f):
    image = picture(f.certify(undecided=0.1, cells=True).plot(off_screen=True, window_size=SIZE, show_edges=False))
    drawn = require_drawing(image)
    blue = image[drawn][:, 2] > image[drawn][:, 0] + 30
    assert blue.mean() > 0.3, "most is proved"
    folded = solidmap.fit(ball, images=ball.points * np.where(ball.points[:, :1] > 0, [1.0, 1, 1], [-0.5, 1, 1]))
    image = picture(folded.certify(undecided=0.2, cells=True).plot(off_screen=True, window_size=SIZE, clip="y"))
    drawn = require_drawing(image)
    assert (image[drawn][:, 0] > image[drawn][:, 2] + 60).mean() > 0.05, "a part is folded"
    with pytest.raises(solidmap.InvalidInputError, match="has no cells"):
        f.certify(undecided=0.5).plot(off_screen=True)


def test_textures_are_drawn_cut_open(ball, f):
    made = solidmap.texture(ball, colours=(ball.points + 1) / 2, sources=200)
    whole = picture(made.plot(off_screen=True, window_size=SIZE, clip=None, resolution=24))
    cut = picture(made.plot(off_screen=True, window_size=SIZE, clip="x", resolution=24))
    require_drawing(whole), require_drawing(cut)
    assert np.abs(whole - cut).mean() > 1
    require_drawing(picture(made.plot(off_screen=True, window_size=SIZE, resolution=24, through=f)))


def test_sequences_are_drawn_as_curves(ball):
    frames = [ball.points * [1 + 0.1 * abs(np.sin(k)), 1, 1] for k in range(6)] + [ball.points[:4]]
    found = solidmap.sequence(ball, frames, resolution=8, fps=2)
    axes = found.plot()
    curve = axes.lines[0]
    assert np.allclose(curve.get_xdata(), np.arange(7) / 2)
    assert np.allclose(curve.get_ydata(), found.energies, equal_nan=True) and np.isnan(curve.get_ydata()[-1])
    assert found.plot(by="harmonic_energy", axes=axes) is axes and len(axes.lines) == 2


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
