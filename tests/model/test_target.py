import pytest

from markergen.errors import InputError
from markergen.model.goal import Target, parse_target
from markergen.model.spec import AUTO, Spec


@pytest.mark.parametrize(
    ("text", "target", "normal"),
    [
        ("0.1deg@1.5m", Target(0.1, True, 1.5), "0.1deg@1.5m"),
        (" 1 mm @ 150cm ", Target(0.001, False, 1.5), "1mm@1.5m"),
        ("0.002@2", Target(0.002, False, 2.0), "2mm@2m"),
    ],
)
def test_a_target_is_an_error_at_a_distance(text, target, normal):
    assert parse_target(text) == target
    assert str(target) == normal
    assert parse_target(normal) == target


@pytest.mark.parametrize(
    "text", ["", "0.1deg", "@1m", "0deg@1m", "-1deg@1m", "1mm@0m", "1rad@1m", "1deg@x", "nandeg@1m"]
)
def test_other_texts_are_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"write for example 0\.1deg@1\.5m"):
        parse_target(text)


def test_an_open_number_of_dots_is_for_the_usual_print():
    assert Spec(n=AUTO).print_sigma == 1e-4
    assert Spec(n=AUTO).dot == "auto"
    assert Spec(n=AUTO, print_sigma=0.0).print_sigma == 0
    assert Spec().print_sigma == 0
    assert Spec(n=AUTO, target="1 mm@1m").target == "1mm@1m"
    for wrong in ({"target": "1mm@1m", "n": 5}, {"n": AUTO, "relief": 0.02}, {"n": 3}, {"scale_sigma": 0.2}):
        with pytest.raises(InputError):
            Spec(**wrong)
