"""`make check` runs the tests of what changed."""

import pytest

from tests.changed import ALWAYS, selected


@pytest.fixture
def root(tmp_path):
    files = {
        "markergen/maths/rotation.py": "", "tests/maths/test_rotation.py": "",
        "markergen/units.py": "", "tests/test_units.py": "",
        "markergen/maths/lm.py": '"""Docstring."""\n\n# tests: tests/maths/test_fit.py tests/contracts\n',
        "markergen/maths/dlt.py": "", "tests/maths/test_homographies.py": "from markergen.maths.dlt import dlt\n",
        "markergen/maths/lenses/thin.py": "", "tests/maths/test_lenses.py": "",
        "markergen/maths/crlb.py": "", "tests/read/test_videos.py": "from tests.support.videos import video\n",
        "markergen/drawing/font.ttf": "", "tests/drawing/test_font.py": "",
    }  # fmt: skip
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ("markergen/maths/rotation.py", ["tests/maths/test_rotation.py"]),
        ("markergen/units.py", ["tests/test_units.py"]),
        ("markergen/drawing/font.ttf", ["tests/drawing/test_font.py"]),
        ("markergen/maths/lm.py", ["tests/maths/test_fit.py"]),
        ("markergen/maths/dlt.py", ["tests/maths/test_homographies.py"]),
        ("markergen/maths/lenses/thin.py", ["tests/maths/test_lenses.py"]),
        ("markergen/maths/crlb.py", ["tests/maths"]),
    ],
)
def test_a_module_has_its_mirror_or_names_its_tests(root, changed, tests):
    assert selected([changed], root) == sorted([*ALWAYS, *tests])


def test_tests_are_run_that_changed_or_use_what_did(root):
    assert selected(["tests/maths/test_rotation.py", "tests/conftest.py"], root) == ["tests/maths/test_rotation.py"]
    assert selected(["tests/support/videos.py"], root) == ["tests/read/test_videos.py"]


def test_what_lies_beside_the_package_has_tests_too(root):
    assert selected(["docs/detect.md", "README.md"], root) == ["tests/docs"]
    assert selected(["pyproject.toml"], root) == ["tests/test_packaging.py"]
    assert selected(["detector/src/lens.c"], root) == ["detector/tests"]
    assert selected([], root) == []


def test_a_folder_holds_its_tests(root):
    changed = ["markergen/maths/crlb.py", "markergen/maths/rotation.py"]
    assert selected(changed, root) == sorted([*ALWAYS, "tests/maths"])
