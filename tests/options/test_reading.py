import doctest
from pathlib import Path

import numpy as np
import pytest
from sentences import sentence

from markergen import options
from markergen.errors import InputError
from markergen.options import declared, settle
from markergen.options.compare import CompareKeywords, StudyKeywords
from markergen.options.declarations import (
    DesignKeywords,
    DetectKeywords,
    ExportKeywords,
    RescaleKeywords,
    ValidateKeywords,
)

TABLES = [
    CompareKeywords, DesignKeywords, DetectKeywords, ExportKeywords, RescaleKeywords, StudyKeywords, ValidateKeywords,
]  # fmt: skip


@pytest.mark.parametrize("table", TABLES)
def test_what_is_not_given_is_the_default(table):
    settled = settle({}, table)
    assert list(settled) == list(declared(table))
    for name, option in declared(table).items():
        assert (settled[name] is None) == (option.default is None)
        assert not (option.kind == "length" and isinstance(settled[name], str))


@pytest.mark.parametrize(
    ("name", "stated", "settled"),
    [
        ("radius", "6in", 0.1524),
        ("radius", 1, 1.0),
        ("radius", np.float32(0.5), 0.5),
        ("n", np.int64(7), 7),
        ("asymmetric", 2, 2.0),
        ("tile", np.False_, False),
        ("dot", "auto", "auto"),
        ("dot", "12mm", 0.012),
        ("template", "plate", Path("plate")),
        ("output", "a.pdf", (Path("a.pdf"),)),
        ("output", ["a.pdf", Path("a.step")], (Path("a.pdf"), Path("a.step"))),
        ("mount", "4xM3@120mm", ("4xM3@120mm",)),
        ("mount", ["4xM3@120mm", "M3:1mm,2mm"], ("4xM3@120mm", "M3:1mm,2mm")),
        ("keep_out", "circle:3mm", ("circle:3mm",)),
        ("boundary", {"type": "circle"}, {"type": "circle"}),
        ("camera", Path("camera.yaml"), Path("camera.yaml")),
        ("seed", None, 0),
    ],
)
def test_values_are_converted(name, stated, settled):
    result = settle({name: stated}, DesignKeywords)[name]
    assert result == settled
    assert type(result) is type(settled)


@pytest.mark.parametrize(
    ("name", "stated", "expected"),
    [
        ("n", "5", "a whole number"),
        ("n", 5.0, "a whole number"),
        ("n", True, "a whole number"),
        ("asymmetric", "2", "a number"),
        ("asymmetric", 10**400, "a number"),
        ("asymmetric", 1j, "a number"),
        ("tile", 1, "True or False"),
        ("tile", "yes", "True or False"),
        ("tag", 3, "a text"),
        ("radius", "much", "a length such as"),
        ("radius", "15 parsec", "a length such as"),
        ("radius", float("nan"), "a length such as"),
        ("radius", True, "a length such as"),
        ("radius", np.zeros(3), "a length such as"),
        ("dot", "automatic", "a length such as"),
        ("template", b"plate", "a path"),
        ("template", "", "a path"),
        ("output", ["a.pdf", 3], "a path, or a list"),
        ("output", b"a.pdf", "a path, or a list"),
        ("mount", 4, "a text, or a list"),
        ("boundary", 0.15, "an outline"),
        ("keep_out", ["circle:3mm", 3], "an outline"),
        ("camera", 5, "a camera"),
        ("poses", 3, "poses: a text"),
    ],
)
def test_a_wrong_type_is_told(name, stated, expected):
    with pytest.raises(InputError) as caught:
        settle({name: stated}, DesignKeywords)
    message = str(caught.value)
    assert f"({expected}" in message
    assert f"{name}=" in message
    assert "\n" not in message


def test_names_of_other_tools_are_answered_as_python_writes_them():
    with pytest.raises(InputError, match="radius='150mm' or boundary='rect:200mmx100mm'"):
        settle({"size": 0.2}, DesignKeywords)
    with pytest.raises(InputError, match="write n=8"):
        settle({"dots": 8}, DesignKeywords)


def test_all_that_is_wrong_is_told_at_once():
    with pytest.raises(InputError) as caught:
        settle({"rnus": 3, "noise": "0.2", "zzz": 1, "seed": 1.5}, ValidateKeywords)
    message = str(caught.value)
    assert message.startswith(sentence("no option", "validate", "rnus=3 (no such option: did you mean 'runs'?)"))
    assert "noise='0.2' (a number)" in message
    assert "seed=1.5 (a whole number)" in message
    assert "zzz=1 (no such option: known: poses," in message
    assert message.endswith("; see help(markergen.validate)")


def test_a_name_of_another_function_is_answered():
    with pytest.raises(InputError, match="the camera of the first marker's design"):
        settle({"camera": "camera.yaml"}, CompareKeywords)


def test_a_message_stays_short_whatever_is_given():
    class Shouting:
        def __repr__(self):
            return "loud\n" * 1000

    for value in (list(range(10**6)), Shouting(), 10**5000):
        with pytest.raises(InputError) as caught:
            settle({"runs": value if not isinstance(value, int) else [value]}, ValidateKeywords)
        assert len(str(caught.value)) < 200
        assert "\n" not in str(caught.value)


def test_the_example_runs():
    assert doctest.testmod(options).failed == 0


def test_an_option_of_the_release_before_is_accepted_with_a_warning():
    with pytest.warns(DeprecationWarning, match="refine= has no effect"):
        settled = settle({"refine": "photometric", "runs": 3}, ValidateKeywords)
    assert settled == settle({"runs": 3}, ValidateKeywords)
