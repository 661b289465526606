"""The notebooks of examples/ run from their first cell to their last, in a kernel of their own."""

import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parents[2] / "examples"
ROUNDS = '"mission.rounds": 8'  # what it shows; a test has time for one


def final_accuracy(cells: list[Any]) -> dict[str, list[float]]:
    """Of the fair run and of the other, by community, as a cell shows them."""
    texts = [out.data["text/plain"] for cell in cells for out in cell.outputs]
    (text,) = (text for text in texts if "unfair" in text and "accuracy" in text)
    lines = (line.split() for line in text.splitlines() if "accuracy" in line)
    return {name: [float(value) for value in values] for name, *values in lines}


@pytest.mark.slow
@pytest.mark.parametrize("name", [path.name for path in sorted(EXAMPLES.glob("*.ipynb"))])
# Of the kernel's client, not of the notebooks.
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(EXAMPLES.parent)]))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    startup = tmp_path / "ipython" / "profile_default" / "startup"
    startup.mkdir(parents=True)
    # The pictures that a notebook shows are drawn; those of its runs' folders are not.
    (startup / "pictures.py").write_text(
        "import mission.figures.run\nmission.figures.run.draw_run = lambda folder: ()\n"
    )
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "jupyter"))
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    if name == "first_run.ipynb":
        (ahead, ahead_unfair), (behind, behind_unfair) = final_accuracy(cells).values()
        assert ahead_unfair > ahead > behind > behind_unfair > 0.3, "it learns, and is fair"
        assert ROUNDS in cells[0].source
        cells[0].source = cells[0].source.replace(ROUNDS, '"mission.rounds": 1')
    client = NotebookClient(notebook, timeout=540, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    shown = [out for cell in cells for out in cell.outputs if out.output_type == "execute_result"]
    assert len(shown) >= 3
    if name == "first_run.ipynb":
        assert any("image/png" in out.data for out in shown)
        assert all(0.05 < value < 0.5 for pair in final_accuracy(cells).values() for value in pair)
