import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markergen.errors import InputError
from markergen.model.tag import FAMILIES, Tag, cell_outlines, family_size, parse_tag


def area(outline):
    x, y = outline.T
    return (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2


def inside(points, outline):
    """Whether a ray to the right crosses the outline an odd number of times."""
    (x, y), after = outline.T, np.roll(outline, -1, axis=0).T
    px, py = points[:, :1], points[:, 1:]
    spans = (y <= py) != (after[1] <= py)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x + (py - y) / (after[1] - y) * (after[0] - x)
    return (spans & (px < crossing)).sum(axis=1) % 2 == 1


@given(arrays(bool, st.tuples(st.integers(1, 7), st.integers(1, 7))))
@settings(max_examples=60)
def test_outlines_hold_the_black_cells_and_nothing_else(ink):
    outlines = cell_outlines(ink)
    # Holes run the other way round, so their area is negative and the sum is what is black.
    assert sum(area(outline) for outline in outlines) == ink.sum()
    rows, columns = np.indices(ink.shape)
    middles = np.stack([columns.ravel(), rows.ravel()], axis=-1) + 0.5
    filled = np.zeros(ink.size, dtype=bool)
    for outline in outlines:
        filled ^= inside(middles, outline)
    assert np.array_equal(filled.reshape(ink.shape), ink)
    for outline in outlines:
        steps = np.roll(outline, -1, axis=0) - outline
        assert np.all((steps == 0).sum(axis=1) == 1), "edges run along the grid"
        turns = steps[:, 0] * np.roll(steps, -1, axis=0)[:, 1] - steps[:, 1] * np.roll(steps, -1, axis=0)[:, 0]
        assert np.all(turns != 0), "no corner lies on a straight edge, where a seam could show"


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_there_and_drawn_with_its_border(family):
    tag = Tag(family, family_size(family) - 1, 0.1)
    ink = tag.ink
    assert ink.shape == (tag.cells, tag.cells)
    assert ink[[0, -1]].all()
    assert ink[:, [0, -1]].all()
    assert not ink.all()


def test_all_of_opencv_s_families_are_known():
    import cv2

    dictionaries = {getattr(cv2.aruco, name): name for name in dir(cv2.aruco) if name.startswith("DICT_")}
    assert {getattr(cv2.aruco, name) for name in FAMILIES.values()} == set(dictionaries)


def test_geometry_of_a_tag():
    tag = Tag("aruco:DICT_4X4_50", 3, 0.12)
    assert tag.cells == 6
    assert tag.outer_side == pytest.approx(0.16)
    # Top left, top right, bottom right, bottom left: clockwise as seen with y up.
    assert tag.corners.tolist() == [[-0.06, 0.06], [0.06, 0.06], [0.06, -0.06], [-0.06, -0.06]]
    corners = np.concatenate(tag.outlines)
    assert corners.min() == pytest.approx(-0.06)
    assert corners.max() == pytest.approx(0.06)
    # The outlines hold the area of the black cells, each 20 mm square; rounding alone is allowed.
    assert abs(sum(area(outline) for outline in tag.outlines)) == pytest.approx(tag.ink.sum() * 0.02**2)


def test_a_tag_stands_upright_in_the_marker_frame():
    tag = Tag("apriltag:36h11", 0, 0.08)
    filled = np.zeros(64, dtype=bool)
    y, x = np.meshgrid(0.035 - 0.01 * np.arange(8), -0.035 + 0.01 * np.arange(8), indexing="ij")
    for outline in tag.outlines:
        filled ^= inside(np.stack([x.ravel(), y.ravel()], axis=-1), outline)
    assert np.array_equal(filled.reshape(8, 8), tag.ink)


@pytest.mark.parametrize(
    ("text", "family", "number"),
    [
        ("aruco:DICT_4X4_50", "aruco:DICT_4X4_50", 0),
        ("aruco:DICT_7X7_1000:999", "aruco:DICT_7X7_1000", 999),
        ("apriltag:36h11:586", "apriltag:36h11", 586),
    ],
)
def test_tags_are_read(text, family, number):
    tag = parse_tag(text, 0.05)
    assert (tag.family, tag.id, tag.side) == (family, number, 0.05)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("aruco:DICT_4X4_50:50", "an id of 0 to 49 in aruco:DICT_4X4_50, found id=50"),
        ("apriltag:36h11:587", "an id of 0 to 586"),
        ("apriltag:36h12", "did you mean 'apriltag:36h11'"),
        ("aruco:4X4_50", "did you mean 'aruco:DICT_4X4_50'"),
        ("aruco", "known: aruco:DICT_4X4_50"),
        ("apriltag:36h11:x", "write the id as a number"),
        ("apriltag:36h11:-1", "write the id as a number"),
        ("apriltag:36h11:", "write the id as a number"),
    ],
)
def test_what_is_no_tag_is_refused(text, said):
    with pytest.raises(InputError, match="expected") as error:
        parse_tag(text, 0.05)
    assert said in str(error.value)


@pytest.mark.parametrize("side", [0.0, -1.0, float("nan"), float("inf")])
def test_sides_that_are_none_are_refused(side):
    with pytest.raises(InputError, match="tag side above 0"):
        Tag("apriltag:36h11", 0, side)
