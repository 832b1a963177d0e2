"""What `python -m benchmarks.structure` counts, in a package small enough to count by hand."""

import pytest

from benchmarks.structure import main, structure

FILES = {
    "__init__.py": '"""A house."""\n',
    "errors.py": '''"""Errors.

Two paragraphs.
"""
# Tried 2: one in ten failed.
LIMIT = 3
STEPS = (1, 2 * 3)
WIDTH, HEIGHT = 4, -5.0  # of the paper
NOTED = 1e-3
"""Below that, rounding."""
NAMES = ("LIMIT",)
NEAR = [1]  # noqa: X


class Problem:
    """A problem."""

    limit: int = 1


def log(text): ...
''',
    "model/__init__.py": "",
    "model/rig.py": '''from typing import TYPE_CHECKING

from house.errors import HEIGHT, LIMIT, NAMES, NOTED, STEPS, WIDTH

if TYPE_CHECKING:
    from house.calibration.run import calibrate


class Rig:
    """Plates.

    # not a comment
    """


class Problem: ...


def log(each, *, other): ...
''',
    "calibration/run.py": """from house import errors


def calibrate(body):
    # Within a function, an import counts.
    from house.model.rig import Rig

    if isinstance(body, Rig) or isinstance(body, int | Rig):
        body.found = errors.Problem(found=1)
    return [known for known in body if (told := known)]
""",
    "verification/check.py": "from house.calibration.run import calibrate\n",
}
TEST = """def test_it(raises, said, size):
    assert "this house has no 3 doors" in said
    assert said == f"a door of {size} mm", "not a word of the four counts"
    with raises(match="^the house .* is closed"), raises(match="--paper A4, found 2 mm"):
        assert said.replace("one two", "three four") == "see a.pdf, b.pdf, c.pdf and d.pdf"
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("code") / "house"
    for name, text in FILES.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    test = root.parent / "tests" / "calibration" / "test_run.py"
    test.parent.mkdir(parents=True)
    test.write_text(TEST)
    return root


@pytest.fixture(scope="module")
def figures(root):
    return structure(root)


def texts(figure):
    return [place.text for place in figure.places]


def test_every_line_is_of_one_kind(figures):
    numbers = {key: figures[key].number for key in ("modules", "lines", "code-lines", "docstring-lines", "comments")}
    blank = sum(not line for text in FILES.values() for line in text.splitlines()) - 2  # two are within docstrings
    assert numbers["modules"] == 6
    assert numbers["lines"] == sum(len(text.splitlines()) for text in FILES.values())
    assert numbers["docstring-lines"] == 1 + 4 + 1 + 4
    assert numbers["lines"] == blank + numbers["code-lines"] + numbers["docstring-lines"] + numbers["comments"]
    assert texts(figures["comments"]) == [
        "calibration/run.py:5: # Within a function, an import counts.",
        "errors.py:5: # Tried 2: one in ten failed.",
    ]
    assert texts(figures["comments-after-code"]) == ["errors.py:8: # of the paper"]
    assert figures["strings-below-names"].number == 1


def test_imports_count_when_the_program_runs(figures):
    assert figures["arrows"] == (4, "(4 between packages)", ())
    assert texts(figures["floors"]) == [
        "house.verification.check", "house.calibration.run", "house.model.rig", "house.errors"
    ]  # fmt: skip
    assert [text.split(" ")[0] for text in texts(figures["single-importers"])] == ["calibration/run.py", "model/rig.py"]
    assert texts(figures["never-imported"]) == ["verification/check.py"]
    assert figures["sibling-arrows"].number == 1
    assert texts(figures["names-given"])[0].startswith("model/rig.py <- errors.py: 6: HEIGHT, LIMIT")
    assert "calibration/run.py <- errors.py: 1: Problem" in texts(figures["names-given"])
    assert figures["givers-of-many"].number == 1
    assert [text.partition(": ")[0] for text in texts(figures["cut-in-two"])] == ["model/rig.py <- errors.py"]


def test_what_a_third_module_uses_is_no_half_of_a_thought(root):
    user = root / "calibration" / "run.py"
    user.write_text(user.read_text() + "\nfrom house.errors import LIMIT\n")
    assert texts(structure(root)["cut-in-two"]) == []


def test_names(figures):
    assert texts(figures["double-classes"]) == ["Problem: errors.py, model/rig.py"]
    assert [text.split(":")[0] for text in texts(figures["double-public"])] == ["Problem", "log"]
    # Seven constants, a field, six parameters and variables.
    assert figures["bindings"].number == 7 + 1 + 6
    assert texts(figures["meaningless"]) == [
        "calibration/run.py:10: known", "calibration/run.py:10: told", "model/rig.py:19: each"
    ]  # fmt: skip
    assert figures["meaningless-wider"].number == 4
    assert texts(figures["rig-branches"]) == ["calibration/run.py:8: isinstance(body, Rig)"]


def test_numbers_say_why(figures):
    names = [text.split(": ")[1] for text in texts(figures["numbers"])]
    assert names == ["LIMIT", "STEPS", "WIDTH", "HEIGHT", "NOTED", "NEAR"]
    assert texts(figures["numbers-without-note"]) == ["errors.py:7: STEPS", "errors.py:12: NEAR"]


def test_prose_is_four_words_of_letters(figures):
    assert [text.split(": ")[0] for text in texts(figures["prose-asserts"])] == ["calibration/test_run.py:2"]
    assert [text.split(": ")[0] for text in texts(figures["prose-matches"])] == ["calibration/test_run.py:4"]


def test_what_is_left_out_still_imports(root):
    figures = structure(root, ["calibration", "verification"])
    assert figures["modules"].number == 4
    assert figures["arrows"].number == 1
    assert texts(figures["single-importers"]) == ["model/rig.py (19 lines) <- calibration/run.py"]


def test_the_command_lists_what_a_figure_counts(root, monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.structure.ROOT", root)
    monkeypatch.setattr("sys.argv", ["structure", "--list", "floors"])
    main()
    assert capsys.readouterr().out.splitlines()[-1] == "house.errors"
    monkeypatch.setattr("sys.argv", ["structure", "--list", "ceilings"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "no 'ceilings'" in capsys.readouterr().err
