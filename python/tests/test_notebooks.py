"""The notebooks run, and their pictures are not blank."""

import base64
import io
import tempfile
from pathlib import Path

import pytest

import solidmap
from conftest import ROOT

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("pyvista")
pytest.importorskip("distributed")

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def pictures(book):
    for cell in book.cells:
        for output in cell.get("outputs", []):
            content = output.get("data", {}).get("image/png")
            if content:
                yield base64.b64decode(content)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_draws(path, tmp_path, monkeypatch):
    from pathlib import Path

    from PIL import Image

    folder = str(Path(solidmap.__file__).parents[1])
    monkeypatch.setenv("PYTHONPATH", folder)
    book = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    drawn = list(pictures(book))
    assert drawn, "the notebook has no picture"
    for content in drawn:
        colours = Image.open(io.BytesIO(content)).convert("RGB").getcolors(1 << 24)
        # Not blank, and not of one colour beside the background.
        assert len(colours) > 30 and max(count for count, _ in colours) < 0.97 * sum(count for count, _ in colours)


def test_the_notebooks_in_the_repository_have_their_pictures():
    assert len(NOTEBOOKS) == 3
    for path in NOTEBOOKS:
        book = nbformat.read(path, as_version=4)
        assert list(pictures(book)), f"{path.name} was saved without its outputs"
        # Folders of the machine that ran them are no one else's business.
        folders = {str(Path.home()), str(ROOT), tempfile.gettempdir()}
        assert not any(f"{folder}/" in str(cell) for folder in folders for cell in book.cells)
