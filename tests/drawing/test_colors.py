import pytest

from markergen.drawing.colors import (
    BLACK_ON_WHITE,
    INVERTED,
    Colors,
    channels,
    is_grey,
    luma,
    parse_colors,
    rgb,
    spot_color,
    spot_name,
)
from markergen.errors import InputError


@pytest.mark.parametrize(
    ("text", "colors"),
    [
        ("black", BLACK_ON_WHITE),
        (" Inverted ", INVERTED),
        ("#202020,#FFFFEE", Colors("#202020", "#ffffee")),
        ("black,cut:CutContour", Colors(cut="CutContour=#ff00ff")),
        ("#00f000, #000000, cut: #FF0000", Colors("#00f000", "#000000", "#ff0000")),
        ("inverted,cut:Thru-cut 1", Colors("#ffffff", "#000000", "Thru-cut 1=#ff00ff")),
    ],
)
def test_what_users_write(text, colors):
    assert parse_colors(text) == colors


@pytest.mark.parametrize(
    "text",
    ["", "red", "#000,#fff", "#000000", "#000000,", "black,white", "black,#ffffff", "#000000,#ffffff,#ff0000", "cut:A"],
)
def test_other_words_are_told_what_there_is(text):
    with pytest.raises(InputError, match=r"black, inverted or #rrggbb,#rrggbb"):
        parse_colors(text)


@pytest.mark.parametrize("name", ["", "=x", "a=b", "(x)", "/x", "x" * 41, "\u00e9"])
def test_a_spot_color_has_a_plain_name(name):
    with pytest.raises(InputError, match="CutContour"):
        parse_colors(f"black,cut:{name}")


@pytest.mark.parametrize("pair", ["#ffffff,#ffffff", "#808080,#a0a0a0", "#ff0000,#00807f"])
def test_colors_that_a_camera_cannot_tell_apart_are_refused(pair):
    with pytest.raises(InputError, match="grey levels apart"):
        parse_colors(pair)


@pytest.mark.parametrize("bad", [{"ink": "black"}, {"paper": "#FFFFFF"}, {"cut": "Cut="}, {"cut": "Cut=red"}])
def test_a_color_that_is_none_is_refused(bad):
    with pytest.raises(InputError, match="a color #rrggbb"):
        Colors(**bad)


def test_parts_of_colors():
    spot = spot_color("CutContour", "#0000ff")
    assert (spot_name(spot), rgb(spot), channels(spot)) == ("CutContour", "#0000ff", (0, 0, 255))
    assert (spot_name("#0a0b0c"), rgb("#0a0b0c"), channels("#0a0b0c")) == (None, "#0a0b0c", (10, 11, 12))
    assert is_grey("#7f7f7f")
    assert not is_grey("#7f7f80")
    assert luma("#ffffff") == pytest.approx(255)
    assert luma("#00ff00") > luma("#ff0000") > luma("#0000ff")


def test_marks_lie_between_paper_and_ink():
    assert BLACK_ON_WHITE.mix(1) == "#000000"
    assert BLACK_ON_WHITE.mix(0) == "#ffffff"
    assert INVERTED.mix(0.6) == "#999999"
    assert not BLACK_ON_WHITE.grounded
    assert INVERTED.grounded
