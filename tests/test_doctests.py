"""The examples in docstrings are true."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# By their text: to import every module and look would take longer than all examples.
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted((ROOT / "markergen").rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]

SLOW = {
    *("api.calibrate", "api.compare", "api.design", "api.handeye", "api.rescale", "api.study", "optimize.design"),
    *("comparison.result", "validation.result", "verification.result"),
}
"""Modules whose examples take a second and more. Tests of the same functions are elsewhere."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.docs] * (name.removeprefix("markergen.") in SLOW)) for name in MODULES],
)
def test_examples_in_docstrings(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    output = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for example in doctest.DocTestFinder(exclude_empty=True).find(module, name):
        runner.run(example, out=output.append)
    # An example that doctest does not see, in a comment or on a constant, proves nothing.
    seen = Path(module.__file__).read_text(encoding="utf-8").count(">>> ")
    assert not runner.failures, "".join(output)
    assert runner.tries == seen
