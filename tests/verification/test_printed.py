"""What users measure and read on a sheet is compared with our own."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from damaged_sheets import DPI, grey

import markergen as mg
from markergen.drawing.paper import SheetOptions
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.tag import parse_tag
from markergen.verification import verify
from tests.support.rigs import mounted

INPUTS = Path(__file__).parents[1] / "golden/inputs"
SUFFIXES = (".svg", ".png", ".pdf")


@pytest.fixture(scope="module")
def marker(make_ngon):
    return make_ngon(5, 0.05, 0.012)


@pytest.fixture(scope="module")
def sheets(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheets")
    save(marker, [folder / f"a{suffix}" for suffix in SUFFIXES], ExportOptions(dpi=DPI))
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in SUFFIXES}


def check_of(marker, folder, suffix, data):
    (folder / f"b{suffix}").write_bytes(data)
    return verify(marker, folder / f"b{suffix}")


def without(names):
    return lambda text: re.sub(rf'<\w+ id="{names}"[^>]*/>', "", text)


def moved(name, by):
    return lambda text: re.sub(rf'(id="{name}")', rf'\1 transform="translate({by})"', text)


CHANGES = {
    "a ruler that ends sooner": lambda text: re.sub(r'(id="ruler" points="\S+ )(\d+)', r"\g<1>90", text),
    "a ruler's line of another scale": lambda text: text.replace('id="ruler"', 'id="ruler" transform="scale(.98 1)"'),
    "a ruler of another scale": lambda text: re.sub(r'(id="ruler[-\d]*")', r'\1 transform="scale(.98 1)"', text),
    "ticks elsewhere": moved(r"ruler-y-\d+", "0 .7"),
    "a number elsewhere": moved("ruler-number-50", "50 0"),
    "a number missing": without("ruler-number-100"),
    "a length missing": without("check-x-0"),
    "the rulers' lengths missing": without("check-rulers-0"),
    "what to measure missing": without(r"remedy-[\d-]+"),
    "an axis elsewhere": moved(r"axes-x", "0 5"),
    "a dot with another number": moved("number-1", "3 3"),
    "all text elsewhere": lambda text: text.replace('<g id="text"', '<g id="text" transform="translate(5 0)"'),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_measured_is_looked_at(marker, sheets, tmp_path, name):
    text = sheets[".svg"].decode()
    changed = CHANGES[name](text)
    assert changed != text
    check = check_of(marker, tmp_path, ".svg", changed.encode())
    assert {finding.kind for finding in check.findings} == {"marks"}, check.findings


@pytest.mark.parametrize("colors", ["inverted", "#102030,#f0f0ff"])
def test_rulers_beside_a_printed_ground_are_looked_at_too(tmp_path, make_ngon, colors):
    marker = make_ngon(5, 0.03, 0.008)
    marker.save(tmp_path / "a.svg", tmp_path / "a.png", colors=colors, dpi=DPI)
    for suffix in (".svg", ".png"):
        check = verify(marker, tmp_path / f"a{suffix}")
        assert check.passed, check.findings
    changed = CHANGES["a ruler of another scale"]((tmp_path / "a.svg").read_text())
    assert [finding.kind for finding in check_of(marker, tmp_path, ".svg", changed.encode()).findings] == ["marks"]


def test_columns_may_stand_elsewhere_and_words_may_be_others(marker, sheets, tmp_path):
    text = moved(r"check-y[-\w]*", "-12 0")(moved(r"check-rulers[-\w]*", "-20 0")(sheets[".svg"].decode()))
    text = moved(r"remedy-1-0", "3 0")(text)
    assert check_of(marker, tmp_path, ".svg", text.encode()).passed
    assert not check_of(marker, tmp_path, ".svg", moved("check-x-0", "0 4")(text).encode()).passed


@pytest.mark.parametrize("suffix", [".pdf", pytest.param(".svg", marks=pytest.mark.long)])
def test_plates_of_a_rig_with_their_names_pass(tmp_path, suffix):
    rig = mg.Rig.load(INPUTS / "cube.json")
    save(rig, [tmp_path / f"cube{suffix}"])
    # The page of the SVG has a fraction of a pixel, and rings far from where resvg begins to count.
    check = verify(rig, tmp_path / f"cube{suffix}")
    assert check.passed, check.findings


@pytest.mark.parametrize("compensate", [False, True])
def test_plates_that_differ_by_their_tags_alone_are_found_after_a_rescale(make_ngon, tmp_path, compensate):
    markers = [replace(make_ngon(5, 0.05, 0.012), tag=parse_tag(f"aruco:DICT_4X4_50:{k}", 0.02)) for k in range(2)]
    rig = mounted(markers, [np.eye(3)] * 2, [[0, 0, 0], [0.2, 0, 0]])
    lengths = {"measured_x": "147mm", "measured_y": "200mm", "also": "plate 1=147mm,198mm"}
    mg.rescale(rig, tmp_path / "printed.json", **lengths)
    printed = mg.Rig.load(tmp_path / "printed.json")
    save(printed, [tmp_path / "rig.pdf"], ExportOptions(sheet=SheetOptions(compensate=compensate)))
    check = verify(printed, tmp_path / "rig.pdf")
    assert check.passed, check.findings


BLACK = base64.b64encode(cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()).decode()
INSIDE = {
    "circle": '<circle cx="74" cy="99" r="2"/>',
    "image": f'<image x="72" y="97" width="4" height="4" href="data:image/png;base64,{BLACK}"/>',
}


@pytest.mark.parametrize("name", INSIDE)
def test_ink_inside_of_the_outline_is_extra(marker, sheets, tmp_path, name):
    data = sheets[".svg"].replace(b"</svg>", f"{INSIDE[name]}</svg>".encode())
    check = check_of(marker, tmp_path, ".svg", data)
    assert [finding.kind for finding in check.findings] == ["extra"], check.findings


def test_pixels_inside_of_the_outline_are_extra(marker, sheets, tmp_path):
    def blot(levels):
        left, right, top, bottom = (int(side * DPI / 25.4) for side in (72, 76, 97, 101))
        levels[top:bottom, left:right] = 0
        return levels

    check = check_of(marker, tmp_path, ".png", grey(blot)(sheets[".png"]))
    assert [finding.kind for finding in check.findings] == ["extra"], check.findings


def test_a_ruler_without_its_line_in_pixels(marker, sheets, tmp_path):
    def without(levels):
        # The longest row of ink in the lower part that is not the hairline from margin to margin.
        ink = (levels < 128).sum(axis=1)
        ink[: len(ink) * 7 // 10] = 0
        ink[ink > 0.8 * levels.shape[1]] = 0
        row = int(ink.argmax())
        levels[row - 4 : row + 5] = 255
        return levels

    check = check_of(marker, tmp_path, ".png", grey(without)(sheets[".png"]))
    assert "marks" in [finding.kind for finding in check.findings], check.findings


@pytest.mark.parametrize("change", [lambda levels: levels[:, ::-1].copy(), lambda levels: levels[::-1].copy()])
def test_a_mirrored_page_of_a_symmetric_layout_is_named(marker, sheets, tmp_path, change):
    assert check_of(marker, tmp_path, ".png", sheets[".png"]).passed
    check = check_of(marker, tmp_path, ".png", grey(change)(sheets[".png"]))
    assert [finding.kind for finding in check.findings] == ["mirrored"], check.findings


@pytest.mark.parametrize("layers", ["marks|text", "text"])
def test_a_page_of_another_layout_has_its_own_rulers(marker, sheets, tmp_path, layers):
    text = sheets[".svg"].decode()
    changed = re.sub(rf'<g id="({layers})"', r'<g id="\1" display="none"', text)
    assert check_of(marker, tmp_path, ".svg", changed.encode()).passed
