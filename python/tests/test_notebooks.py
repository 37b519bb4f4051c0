"""Every notebook runs from its first to its last cell, and its pictures show something.

With CARDIOTWIN_NOTEBOOKS=FOLDER, the notebooks are kept there with their outputs, and each picture beside them.
"""

from __future__ import annotations

import base64
import os
import re
from pathlib import Path

import cardiotwin
import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[2] / "examples" / "notebooks"
SVG = re.compile('data:image/svg.xml;base64,([^"]+)')
# Pictures in the outputs: PNG of matplotlib and PyVista, SVG of the programs.
PICTURES = {
    "1-first-cohort": (3, 1),
    "2-sensitivity-with-salib": (0, 0),
    "3-own-optimiser": (0, 0),
    "4-missing-effects": (0, 1),
    "5-heart-in-3d": (1, 0),
}


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Jupyter's own backend puts pictures into outputs; that of other tests draws nowhere.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "notebooks are kept without outputs"
    resources = {"metadata": {"path": path.parent}}
    NotebookClient(notebook, timeout=600, kernel_name="python3", resources=resources).execute()
    assert len([cell for cell in notebook.cells if cell.cell_type == "code" and cell.outputs]) >= 2
    kept = Path(os.environ.get("CARDIOTWIN_NOTEBOOKS", tmp_path))
    kept.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, kept / path.name)
    outputs = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])]
    drawn = [base64.b64decode(data["image/png"]) for data in outputs if "image/png" in data]
    lines = [part for data in outputs for part in SVG.findall(data.get("text/html", ""))]
    assert (len(drawn), len(lines)) == PICTURES[path.stem]
    for number, picture in enumerate(drawn, 1):
        file = kept / f"{path.stem}-{number}.png"
        file.write_bytes(picture)
        assert shades(file) > 2, f"{file} shows nothing"
    for number, figure in enumerate(lines, 1):
        svg = base64.b64decode(figure).decode()
        (kept / f"{path.stem}-{number}.svg").write_text(svg, encoding="utf-8")
        assert svg.count("<path") >= 4


def test_names_of_patients_are_completed(run: cardiotwin.Run) -> None:
    """As in a notebook's cell, whose completer runs no code of its own accord."""
    from IPython.core.completer import IPCompleter

    found = IPCompleter(namespace={"run": run}).complete('run.patients["0')[1]
    assert found == ['run.patients["01-CoA', 'run.patients["03-CoA']


def shades(file: Path) -> int:
    """Number of different values of a picture's pixels."""
    from matplotlib import image

    return len(set(image.imread(file).ravel().tolist()))
