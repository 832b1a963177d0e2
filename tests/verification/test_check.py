"""Every format, every marker: what is right passes, and what is wrong is called by its name."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence
from spoiled_files import Spoiler

from markergen.drawing.paper import SheetOptions
from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.feature import Feature
from markergen.model.rescale import MeasuredDot, Rulers, remeasure, rescale_body
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.verification.reading import Settings
from markergen.verification.result import along_axes, short_length

DPI = 300
NAMES = ("4", "5", "5 alike", "5 skew", "12", "L", "L alike")
SUFFIXES = (".svg", ".pdf", ".dxf", ".png")
CORE = {
    "4": ".pdf", "5": ".dxf", "5 alike": ".svg", "5 skew": ".pdf", "12": ".png", "L": ".pdf", "L alike": ".svg",
}  # fmt: skip


def case(name, suffix, *more):
    """In the core is one file of each marker, and a marker in each format."""
    return pytest.param(name, suffix, *more, marks=() if CORE[name] == suffix else pytest.mark.long)


def some(*values, core=1):
    """Values of which the core has the first."""
    return [*values[:core], *(pytest.param(value, marks=pytest.mark.long) for value in values[core:])]


FILES = [case(name, suffix) for name in NAMES for suffix in SUFFIXES]
OTHERS = [("4", "5"), ("5", "5 skew"), ("5 skew", "L"), ("L", "12"), ("12", "L alike"), ("4", "L alike")]
# How exactly our own files are read; what is allowed is 20 um, and a quarter of a pixel at 300 dpi.
LIMIT = {".svg": 1e-6, ".pdf": 1e-6, ".dxf": 1e-6, ".png": 2e-5}
ALLOWED = {".svg": 2e-5, ".pdf": 2e-5, ".dxf": 2e-5, ".png": 2.117e-5}
NAMES_OF_CORNERS = ("top left", "top right", "bottom right", "bottom left")


@pytest.fixture
def spoiled(markers, files, tmp_path):
    """Verdict on the file of a marker after a spoiler has changed it."""

    def get(name, suffix, how, *arguments):
        data = files(name, suffix).read_bytes()
        changed = getattr(Spoiler(markers[name], DPI), how)(data, suffix, *arguments)
        assert changed != data
        path = tmp_path / f"spoiled{suffix}"
        path.write_bytes(changed)
        return verify(markers[name], path)

    return get


def kinds(check):
    return [finding.kind for finding in check.findings]


@pytest.mark.parametrize(("name", "suffix"), FILES)
def test_what_was_exported_is_right(markers, files, name, suffix):
    check = verify(markers[name], files(name, suffix))
    assert check.passed, check.findings
    assert check.dots == len(markers[name])
    assert check.copies == 1
    assert check.largest < LIMIT[suffix] / 2
    assert check.tolerance == pytest.approx(ALLOWED[suffix], rel=1e-3)
    # A micrometer on 60 mm or more.
    np.testing.assert_allclose(check.scale, 1, atol=2e-5 if suffix != ".png" else 2e-4)


@pytest.mark.parametrize(
    ("share", "dpi"),
    [(0.1, 150), (0.03, 300), *(pytest.param(*pair, marks=pytest.mark.long) for pair in [(0.1, 300), (0.03, 150)])],
)
def test_neighbors_in_a_crowd_of_pixels_do_not_spoil_each_other(make_marker, tmp_path, share, dpi):
    # Hexagonal packing: every inner dot has six neighbors at a gap of that share of its diameter.
    pitch = 0.012 * (1 + share)
    rows = [(pitch * (i + j / 2), pitch * j * 3**0.5 / 2) for i in range(-2, 3) for j in range(-2, 3) if abs(i + j) < 3]
    marker = make_marker(np.array(rows), 0.06, 0.012)
    path = tmp_path / "crowd.png"
    save(marker, [path], ExportOptions(dpi=dpi))
    check = verify(marker, path)
    assert check.passed, check.findings
    # As little as dots that stand alone, unless the gap is but two pixels wide.
    assert check.largest < (0.3e-6 if share * 12 / 25.4 * dpi > 4 else check.tolerance / 3)


@pytest.mark.parametrize("dpi", some(100, 150, 300))
def test_a_tag_as_large_as_the_dots_is_no_dot(make_ngon, tmp_path, dpi):
    marker = make_ngon(6, 0.09, 0.036)
    for side in (0.028, 0.03, 0.036):
        tagged = replace(marker, tag=Tag("aruco:DICT_4X4_50", 7, side))
        path = tmp_path / f"tag-{side}.png"
        save(tagged, [path], ExportOptions(dpi=dpi))
        check = verify(tagged, path)
        assert check.dots == 6
        assert check.passed, check.findings


@pytest.mark.parametrize("suffix", some(".dxf", ".step", ".pdf", ".svg", core=2))
def test_what_is_drawn_of_a_measured_marker_is_the_design(make_ngon, tmp_path, suffix):
    marker = make_ngon(5, 0.05, 0.012)
    dots = tuple(MeasuredDot(p.id, 0.993 * p.x, 0.995 * p.y) for p in marker.control_points)
    for k, printed in enumerate((remeasure(marker, dots)[0], rescale_body(marker, Rulers(0.199, 0.1985))[0])):
        path = tmp_path / f"{k}{suffix}"
        # A solid without engraving and fillets is small.
        save(printed, [path], ExportOptions(fabrication=Fabrication(engrave=False, foot=0.0)))
        for marker_to_print in (marker, printed):
            check = verify(marker_to_print, path)
            assert check.passed, check.findings


@pytest.mark.parametrize("suffix", [".json", ".opencv.yaml", ".ros2.yaml"])
@pytest.mark.parametrize("family", ["aruco:DICT_4X4_50", "apriltag:36h11"])
def test_a_list_of_points_with_another_tag_is_wrong(make_ngon, tmp_path, suffix, family):
    marker = make_ngon(6, 0.09, 0.03)
    mine, other, larger = (replace(marker, tag=Tag(family, *tag)) for tag in ((7, 0.03), (8, 0.03), (7, 0.031)))
    mine = rescale_body(mine, Rulers(0.199, 0.1985))[0]
    path = tmp_path / f"list{suffix}"
    save(mine, [path])
    assert verify(mine, path).passed
    for wrong in (other, larger, marker):
        check = verify(rescale_body(wrong, Rulers(0.199, 0.1985))[0], path)
        assert {"tag", "extra"} & set(kinds(check)), check.findings


@pytest.mark.parametrize("paper", some("240x245mm", "A4", "letter-landscape"))
def test_the_picture_of_a_plan_is_not_taken_for_the_marker(make_ngon, tmp_path, paper):
    # Larger than a page leaves room for by so little that the picture could have nearly its size.
    marker = make_ngon(6, 0.09, 0.036)
    path = tmp_path / "tiles.pdf"
    save(marker, [path], ExportOptions(sheet=SheetOptions(paper)))
    check = verify(marker, path)
    assert check.passed, check.findings
    assert check.copies == 1


SCALES = [
    (0.999, 0.999, sentence("scaled", "0.999 along x and y")),
    (0.999, 1.0, sentence("scaled", "0.999 along x")),
    (1.0, 0.999, sentence("scaled", "0.999 along y")),
    (0.993, 0.9955, sentence("scaled", "0.993 along x and by 0.9955 along y")),
]


@pytest.mark.parametrize(
    ("name", "suffix", "scale"),
    # All scales of some markers, and one of all.
    [
        case(name, suffix, scale)
        for name in NAMES
        for scale in (SCALES if name == "5 alike" else SCALES[:1])
        for suffix in SUFFIXES
    ],
)
def test_a_scale_is_found_and_named(spoiled, name, suffix, scale):
    x, y, expected = scale
    check = spoiled(name, suffix, "scaled", x, y)
    assert not check.passed
    assert "scaled" in kinds(check)
    np.testing.assert_allclose(check.scale, (x, y), atol=1e-6 if suffix != ".png" else 1e-4)
    if suffix != ".png":
        assert check.findings[0].sentence == expected


@pytest.mark.parametrize(("name", "suffix"), FILES)
def test_a_mirrored_file_is_named(spoiled, name, suffix):
    check = spoiled(name, suffix, "mirrored")
    assert kinds(check) == ["mirrored"]


@pytest.mark.parametrize(("name", "suffix"), FILES)
def test_a_missing_dot_is_named(markers, spoiled, name, suffix):
    index = 0 if name in ("4", "12") else 2
    check = spoiled(name, suffix, "without", index)
    assert check.dots == len(markers[name]) - 1
    assert kinds(check) == ["missing"]
    # Of equal dots on a regular polygon nobody can say which one it was, unless they have an order.
    if not (name == "5 alike" and suffix == ".png"):
        assert check.findings[0].sentence == f"dot {index} is missing"


@pytest.mark.parametrize(
    ("name", "other", "suffix"),
    [
        pytest.param(*pair, suffix, marks=() if SUFFIXES[k % len(SUFFIXES)] == suffix else pytest.mark.long)
        for k, pair in enumerate(OTHERS)
        for suffix in SUFFIXES
    ],
)
def test_another_marker_is_named(markers, files, name, other, suffix):
    check = verify(markers[name], files(other, suffix))
    assert kinds(check) in (["another marker"], ["no dots"])


def edited(marker, **changes):
    """The marker with the control point 3 changed."""
    points = list(marker.control_points)
    points[3] = replace(points[3], **{key: value for key, value in changes.items() if key != "add"})
    return replace(marker, control_points=tuple(points))


def test_what_rounding_leaves_is_no_length():
    assert along_axes(0.2, 3.553e-15) == "(x +200 um, y +0 um)"
    assert along_axes(-0.012345678, -2.9e-7) == "(x -12.35 um, y +0 um)"
    assert [short_length(value) for value in (7.11e-15, 2.95e-6, 0.0054321)] == ["0 um", "0.003 um", "5.43 um"]


@pytest.mark.parametrize(
    ("name", "suffix"), [case(name, suffix) for name in ("4", "5", "12", "L alike") for suffix in SUFFIXES]
)
def test_a_dot_out_of_place_is_named(markers, tmp_path, name, suffix):
    marker = markers[name]
    path = tmp_path / f"moved{suffix}"
    save(edited(marker, x=marker.control_points[3].x + 2e-4), [path], ExportOptions(dpi=DPI))
    check = verify(marker, path)
    assert kinds(check) == ["shifted"]
    assert check.findings[0].sentence.startswith(sentence("dot off", 3, "0.2 mm") + " (x +200")
    assert check.worst == 3
    assert check.largest == pytest.approx(2e-4, abs=2e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_dot_of_another_size_or_kind_is_named(markers, tmp_path, suffix):
    marker = markers["5 skew"]
    path = tmp_path / f"other{suffix}"
    for feature, expected in (
        (Feature(0.0125), "dot 3 has a diameter of 12.5"),
        (Feature(0.012, 0.006), "dot 3 is a ring, not a dot"),
    ):
        save(edited(marker, feature=feature), [path], ExportOptions(dpi=DPI))
        check = verify(marker, path)
        assert len(check.findings) == 1
        assert check.findings[0].sentence.startswith(expected)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_extra_dot_is_named(markers, tmp_path, suffix):
    marker = markers["5 skew"]
    points = (*marker.control_points, replace(marker.control_points[1], id=9, x=0.0, y=0.0))
    path = tmp_path / f"more{suffix}"
    save(replace(marker, control_points=points), [path], ExportOptions(dpi=DPI))
    check = verify(marker, path)
    assert kinds(check) == ["extra"]
    assert check.dots == 6
    assert check.largest < LIMIT[suffix]


def test_a_scale_and_a_dot_out_of_place(markers, tmp_path):
    marker = markers["12"]
    changed = edited(marker, y=marker.control_points[3].y + 1e-4)
    save(changed, [tmp_path / "a.svg"])
    data = Spoiler(marker, DPI).scaled((tmp_path / "a.svg").read_bytes(), ".svg", 0.998, 0.999)
    (tmp_path / "b.svg").write_bytes(data)
    check = verify(marker, tmp_path / "b.svg")
    assert kinds(check) == ["scaled", "shifted"]
    assert check.findings[1].sentence.startswith(sentence("dot off", 3, "0.1 mm"))


def test_the_files_own_labels_are_not_asked(markers, files, tmp_path):
    marker = markers["5 skew"]
    text = files("5 skew", ".svg").read_text()
    (tmp_path / "a.svg").write_text(text.replace('id="dot-', 'id="thing-'))
    assert verify(marker, tmp_path / "a.svg").passed
    rotated = re.sub(r"(<svg[^>]*>)", r'\1<g transform="translate(2 7) rotate(33 74 105)">', text, count=1)
    (tmp_path / "b.svg").write_text(rotated.replace("</svg>", "</g></svg>"))
    assert verify(marker, tmp_path / "b.svg").passed


def test_a_rescaled_marker_is_drawn_as_designed_or_for_the_printer(markers, tmp_path):
    design = markers["5 skew"]
    marker, _ = rescale_body(design, Rulers(0.1986, 0.1991))
    save(marker, [tmp_path / "a.svg", tmp_path / "a.csv"])
    assert verify(marker, tmp_path / "a.svg").passed
    assert verify(design, tmp_path / "a.svg").passed
    # A table has the places of the print.
    assert verify(marker, tmp_path / "a.csv").passed
    assert not verify(design, tmp_path / "a.csv").passed
    save(marker, [tmp_path / "b.svg"], ExportOptions(sheet=SheetOptions(compensate=True)))
    check = verify(marker, tmp_path / "b.svg")
    assert check.passed
    assert "99.3 % along x" in check.notes[0]
    assert kinds(verify(design, tmp_path / "b.svg")) == ["scaled"]


def test_tiles_are_put_together_by_their_marks(make_ngon, tmp_path):
    marker, path = make_ngon(5, 0.1, 0.03), tmp_path / "tiles.pdf"
    save(marker, [path], ExportOptions(sheet=SheetOptions(paper="A5")))
    check = verify(marker, path)
    assert check.passed, check.findings
    assert len(check.pages) > 2
    # What tiles add is rounding: 24 bits of a page's coordinates.
    assert check.largest < 5e-8
    data = Spoiler(marker, DPI).scaled(path.read_bytes(), ".pdf", 0.999, 0.999)
    path.write_bytes(data)
    assert sentence("scaled", "0.999 along x and y") in [finding.sentence for finding in verify(marker, path).findings]


def test_a_dot_that_seams_cut_is_put_together(make_marker, tmp_path):
    points = np.array([[0, 0], [0.1, 0.02], [-0.09, 0.05], [0.03, -0.1], [-0.05, -0.09]])
    marker, path = make_marker(points, 0.15, 0.055), tmp_path / "cut.pdf"
    notes = dict(save(marker, [path], ExportOptions(sheet=SheetOptions(paper="A5"))))[path]
    assert any("A seam cuts" in note for note in notes)
    check = verify(marker, path)
    assert check.passed, check.findings
    assert check.dots == 5
    # Clipped circles are polygons of chords, at most 0.1 um off them.
    assert check.largest < 5e-7


def test_several_markers_on_a_page(make_marker, tmp_path):
    points = np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012]])
    marker = make_marker(points, 0.05, 0.012)
    family = [replace(marker, tag=Tag("apriltag:36h11", k, 0.015)) for k in range(5)]
    save(family, [tmp_path / "all.pdf"])
    check = verify(family[2], tmp_path / "all.pdf")
    assert check.copies == 5
    assert check.dots == 20
    assert check.passed
    # None of them has this one.
    check = verify(replace(marker, tag=Tag("apriltag:36h11", 7, 0.015)), tmp_path / "all.pdf")
    assert kinds(check) == ["tag"] * 5


@pytest.mark.parametrize("suffix", [".dxf", ".3mf"])
def test_holes_as_many_and_as_large_as_the_dots_are_no_marker(make_ngon, tmp_path, suffix):
    around = 0.04 * np.exp(1j * np.pi / 3 * np.arange(6))
    holes = tuple(Hole(x, y, 0.0066) for x, y in zip(around.real, around.imag, strict=True))
    marker = make_ngon(6, 0.05, 0.008)
    inward = tuple(replace(point, x=0.7 * point.x, y=0.7 * point.y) for point in marker.control_points)
    marker = replace(marker, control_points=inward, substrate=Substrate(0.008, holes=holes))
    save([marker], [tmp_path / f"plate{suffix}"], ExportOptions(fabrication=Fabrication("cnc", engrave=False)))
    check = verify(marker, tmp_path / f"plate{suffix}")
    assert (kinds(check), check.dots, check.copies) == ([], 6, 1)


@pytest.mark.parametrize("suffix", some(".pdf", ".dxf", ".png", ".svg", core=3))
def test_the_tag_is_looked_at(markers, tmp_path, suffix):
    tag = Tag("apriltag:36h11", 3, 0.02)
    marker = replace(markers["5"], tag=tag)
    shifted = replace(marker, tag=replace(tag, center=(1e-4, 0.0)))
    for number, (drawn, expected) in enumerate(
        [
            (marker, []),
            (replace(marker, tag=replace(tag, id=4)), ["the tag apriltag:36h11:3 is not in its place"]),
            (replace(marker, tag=None), ["the tag apriltag:36h11:3 is not in its place"]),
            (shifted, [f"the {side} corner of the tag is 100 um off" for side in NAMES_OF_CORNERS]),
        ]
    ):
        path = tmp_path / f"{number}{suffix}"
        save(drawn, [path], ExportOptions(dpi=DPI))
        sentences = [finding.sentence for finding in verify(marker, path).findings]
        # Edges of pixels are told to 1 um or so.
        assert [re.sub(r" \d[\d.]* um", " 100 um", text) for text in sentences] == expected
        assert all(abs(float(text.split()[-3]) - 100) < 2 for text in sentences if "corner" in text)


@pytest.mark.parametrize("n", [60, 400])
def test_many_dots_take_no_time(make_marker, tmp_path, n):
    places = np.stack(np.meshgrid(np.arange(20), np.arange(-(-n // 20))), axis=-1).reshape(-1, 2)[:n] * 0.012 - 0.12
    marker = make_marker(places + 1e-3 * np.random.default_rng(0).random((n, 2)), 0.3, 0.008)
    save(marker, [tmp_path / "a.dxf"])
    start = time.process_time()
    assert verify(marker, tmp_path / "a.dxf").passed
    # Measured: 0.1 and 0.9 s.
    assert time.process_time() - start < 4


def test_what_has_no_reader_or_no_file(markers, tmp_path):
    with pytest.raises(InputError, match=r"Known: .*\.svg"):
        verify(markers["4"], tmp_path / "a.sgv")
    with pytest.raises(InputError, match="No such file"):
        verify(markers["4"], tmp_path / "a.svg")
    with pytest.raises(InputError, match="tolerance"):
        verify(markers["4"], tmp_path / "a.svg", Settings(-1.0))
