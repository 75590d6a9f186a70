"""The notebooks of docs/ are run, and print what they show."""

import warnings
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="pip install -e '.[test]' for the notebooks")
nbclient = pytest.importorskip("nbclient", reason="pip install -e '.[test]' for the notebooks")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs").rglob("*.ipynb"))


def printed(cell):
    """The text that a cell shows; pictures are only there or not."""
    texts = []
    for output in cell.get("outputs", []):
        data = output.get("data", {})
        texts.append(output.get("text") or data.get("text/plain", "").replace("<Figure size 640x480", "<Figure"))
        texts += [kind for kind in sorted(data) if kind.startswith("image/")]
    return texts


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_prints_what_it_shows(notebook, tmp_path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)  # a notebook's own shows pictures in place
    stored = nbformat.read(notebook, as_version=4)
    fresh = nbformat.read(notebook, as_version=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what the machinery of notebooks warns of is not ours
        nbclient.NotebookClient(
            fresh, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
        ).execute()
    assert [printed(cell) for cell in fresh.cells] == [printed(cell) for cell in stored.cells]
    assert any(printed(cell) for cell in stored.cells)


def test_there_is_a_notebook():
    assert [notebook.name for notebook in NOTEBOOKS] == ["derive.ipynb"]
