"""The notebooks run from their first cell to their last, and what a cell ends with is shown."""

import ast
import json
import warnings
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))


def run(cells, names):
    """Values of the last lines of cells that are expressions, run one after the other."""
    values = []
    for number, cell in enumerate(cells):
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"cell {number}", "exec"), names)
        if last:
            values.append(eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names))
    return values


@pytest.mark.docs
@pytest.mark.usefixtures("only_our_objectives")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(path.read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] for cell in cells)
    with warnings.catch_warnings():
        values = run(cells, {"__name__": "__main__"})
    pictures = [value for value in values if hasattr(value, "_repr_png_")]
    assert pictures
    assert all(picture._repr_png_().startswith(b"\x89PNG") for picture in pictures)
    assert capsys.readouterr().out
