"""The notebooks of docs/notebooks: stored without results, run from beginning to end, and what their texts claim is so."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

#: For each notebook: how many pictures it draws, and what holds at its end.
CLAIMS = {
    "height_control": (
        1,
        """
        assert -1.65 < gain < -1.55 and 9.5 < slowest < 10.5
        assert abs(controlled[399] - target[399]) < 1e-5 and abs(controlled[-1] - target[-1]) < 1e-5
        assert 0.2 < lag < 0.4 and 0.002 < (target[400:] - controlled[400:]).max() < 0.006
        assert 0.010 < alone[0] - alone[-1] < 0.011
        assert worst > 0.005 and abs(forgetful[-1] - controlled[-1]) < 1e-5
        assert np.abs(np.diff(command)).max() <= FASTEST * STEP * (1 + 1e-12)
        assert 4.5 < tension[-1] / tension[0] < 5.5 and tension.min() < 0.0
        """,
    ),
    "load_and_memory": (
        2,
        """
        assert abs(away) < 1e-6 and between.max() > 0.05
        assert np.abs(heights["three_bar"] - heights["three_bar"][::-1]).max() < 1e-6
        assert heights["three_bar"][6] - heights["three_bar"][4] > 0.29
        ups = [jump.before.parameter for jump in jumps[:13]]
        assert sorted(ups) == ups and 42.0 < ups[-1] < 43.0
        lost = {law: run.transitions["loss"].sum() for law, run in runs.items()}
        assert lost["single-valued"] == 0.0 and 1.3 < lost["hysteretic"] < 1.4
        for run in runs.values():
            first, last = run.data.isel(time=0), run.data.isel(time=-1)
            parts = [f"energy.{part}" for part in ("kinetic", "potential", "elastic", "dissipated")]
            gap = sum(float(last[part] - first[part]) for part in parts) - float(last["energy.input_work"])
            assert abs(gap) < 1e-7
        """,
    ),
    "own_structure": (
        1,
        """
        assert Path("neck.toml").is_file() and Path("neck.html").stat().st_size > 500_000 and Path(fmu).is_file()
        assert apart < 1e-9 and 0.010 < way[0] < 0.016
        ends = [float(run[f"side{i}.force"][-1]) for i in (1, 2, 3)]
        assert min(ends) > 30.0 and max(float(run[f"bar{i}.force"].max()) for i in (1, 2, 3)) < 0.0
        """,
    ),
}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_results_and_leads_somewhere(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None
        for link in re.findall(r"\]\(([^)#]+)\)", cell.source) if cell.cell_type == "markdown" else ():
            assert link.startswith("https://") or (FOLDER / link).exists(), link
    assert path.name in (FOLDER / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_what_it_says_is_so(path, made_page, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    pictures, claims = CLAIMS[path.stem]
    notebook.cells.append(nbformat.v4.new_code_cell(re.sub(r"^ {8}", "", claims, flags=re.MULTILINE)))
    folder = tmp_path / "ü #1"
    folder.mkdir()
    NotebookClient(notebook, kernel_name="python3", timeout=120, resources={"metadata": {"path": str(folder)}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in shown) == pictures
    assert not [output for output in shown if output.output_type == "stream" and output.name == "stderr"]
