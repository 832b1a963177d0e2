import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markergen.errors import InputError
from markergen.geometry.region import Region
from markergen.model.boundary import Circle, Polygon
from markergen.model.tag import FAMILIES, Board, Tag, cell_outlines, family_size, parse_ids, parse_tag, place_tag


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
    ("text", "message"),
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
def test_what_is_no_tag_is_refused(text, message):
    with pytest.raises(InputError, match="expected") as error:
        parse_tag(text, 0.05)
    assert message in str(error.value)


@pytest.mark.parametrize("side", [0.0, -1.0, float("nan"), float("inf")])
def test_sides_that_are_none_are_refused(side):
    with pytest.raises(InputError, match="tag side above 0"):
        Tag("apriltag:36h11", 0, side)


def test_the_quiet_zone_is_one_cell_all_around():
    tag = Tag("aruco:DICT_4X4_50", 3, 0.12, (0.1, -0.2))
    assert tag.quiet == pytest.approx(0.02)
    # Just outside the black square, within the quiet zone, on its edge, and outside.
    points = np.array([[0.161, -0.2], [0.1, -0.279], [0.18, -0.2], [0.1, -0.281]])
    assert tag.quiet_zone.depth(points) == pytest.approx([0.019, 0.001, 0.0, -0.001])
    assert tag.corners.mean(axis=0) == pytest.approx([0.1, -0.2])
    assert np.concatenate(tag.outlines).mean(axis=0) == pytest.approx([0.1, -0.2], abs=0.03)


def rectangle(width, height, x=0.0, y=0.0):
    w, h = width / 2, height / 2
    return Polygon((((x - w, y - h), (x + w, y - h), (x + w, y + h), (x - w, y + h)),))


@pytest.mark.parametrize(
    ("boundary", "side"),
    [
        # A third of the radius; or half of the largest: 40 mm of room hold 30 mm of six cells with one on either side.
        (Circle(0.15), 0.05),
        (rectangle(0.2, 0.04), 0.015),
    ],
)
def test_a_tag_without_a_size_leaves_most_of_the_room(boundary, side):
    tag = place_tag("aruco:DICT_4X4_50:7", None, boundary)
    # The largest is found to a thousandth.
    assert tag.side == pytest.approx(side, rel=2e-3)
    assert tag.center == (0.0, 0.0)


def test_a_tag_stands_in_the_middle_of_a_boundary_with_an_origin_of_its_own():
    tag = place_tag("aruco:DICT_4X4_50", 0.02, rectangle(0.1, 0.05, 0.3, 0.4))
    assert tag.center == pytest.approx((0.3, 0.4))


@pytest.mark.parametrize(
    ("boundary", "side", "fits"),
    [
        # With its quiet zone 8/6 of the side; in the disk its half diagonal is the radius.
        (Circle(0.15), 0.15 * 2**0.5 * 6 / 8 * 0.9999, True),
        (Circle(0.15), 0.15 * 2**0.5 * 6 / 8 * 1.001, False),
        (rectangle(0.2, 0.04), 0.03, True),
        (rectangle(0.2, 0.04), 0.0301, False),
    ],
)
def test_a_tag_fits_with_its_quiet_zone_or_is_refused(boundary, side, fits):
    if fits:
        assert place_tag("aruco:DICT_4X4_50", side, boundary).side == side
    else:
        with pytest.raises(InputError, match=r"with its quiet zone.* --tag-size"):
            place_tag("aruco:DICT_4X4_50", side, boundary)


def test_the_size_that_is_told_fits():
    with pytest.raises(InputError) as error:
        place_tag("aruco:DICT_4X4_50", 0.3, Circle(0.15))
    output = float(str(error.value).split("--tag-size ")[1].split("mm")[0]) / 1e3
    # Exactly 0.15 sqrt(2) 6/8 = 159.1 mm; found to a thousandth, and rounded down.
    assert 0.1588 <= output <= 0.1591
    assert place_tag("aruco:DICT_4X4_50", output, Circle(0.15)).side == output


def test_a_hole_in_the_middle_leaves_no_room():
    hole = Circle(0.01)
    for side in (None, 0.05):
        with pytest.raises(InputError, match=r"in the middle: .* --tag"):
            place_tag("aruco:DICT_4X4_50", side, Circle(0.15), [hole])
    # One beside the tag does not matter.
    assert place_tag("aruco:DICT_4X4_50", None, Circle(0.15), [Circle(0.01, (0.1, 0))]).side == 0.05


@pytest.mark.parametrize(
    ("text", "ids"),
    [("0-9", tuple(range(10))), ("0,3,7", (0, 3, 7)), (" 4 - 5 , 1", (4, 5, 1)), ("49", (49,)), ("3-3", (3,))],
)
def test_lists_of_ids_are_read(text, ids):
    assert parse_ids(text, "aruco:DICT_4X4_50") == ids


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0-50", "ids of 0 to 49 in aruco:DICT_4X4_50, found id=50"),
        ("0-999999999", "found id=999999999"),
        ("0-99999999999999", "ids such as 0-9"),
        ("9-0", "ranges that count upward, found '9-0'; write 0-9"),
        ("1,2,1", "each id once, found id 1 twice"),
        ("", "ids such as 0-9"),
        ("1,,2", "ids such as 0-9"),
        ("-3", "ids such as 0-9"),
        ("a", "ids such as 0-9"),
        ("1-2-3", "ids such as 0-9"),
    ],
)
def test_what_is_no_list_of_ids_is_refused(text, message):
    with pytest.raises(InputError) as error:
        parse_ids(text, "aruco:DICT_4X4_50")
    assert message in str(error.value)


@pytest.mark.parametrize(("columns", "rows"), [(5, 5), (4, 6), (3, 7), (6, 4)])
@pytest.mark.parametrize(
    ("family", "bits", "number"), [("aruco:DICT_4X4_50", 4, "4X4_50"), ("aruco:DICT_6X6_250", 6, "6X6_250")]
)
def test_ink_and_corners_are_opencv_s(columns, rows, family, bits, number):
    import cv2

    board = Board(family, columns, rows, 0.04)
    s = bits + 4
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{number}"))
    theirs = cv2.aruco.CharucoBoard((columns, rows), float(s), float(s - 2), dictionary)
    # Ten pixels a cell; the middle of each is far from any edge that their drawing may round.
    drawn = theirs.generateImage((columns * s * 10, rows * s * 10), None, 0, 1)
    # Even-odd: a point is black if an odd number of outlines go around it.
    x, y = np.meshgrid(np.arange(columns * s) + 0.5 - columns * s / 2, rows * s / 2 - np.arange(rows * s) - 0.5)
    middles = np.stack([x.ravel(), y.ravel()], axis=-1) * 0.04 / s
    around = [Region.polygon(outline, mend=True).contains(middles) for outline in board.outlines]
    assert np.array_equal(drawn[5::10, 5::10] == 0, (np.sum(around, axis=0) % 2 == 1).reshape(x.shape))
    # Theirs count from the top left with y down.
    corners = theirs.getChessboardCorners()[:, :2] / s * 0.04
    expected = (corners - [columns * 0.02, rows * 0.02]) * [1, -1]
    assert board.corners == pytest.approx(expected, abs=1e-7)  # theirs are of single precision


def test_geometry_of_a_board():
    board = Board("aruco:DICT_4X4_50", 5, 5, 0.04)
    assert board.tags == 12
    assert board.tag_side == pytest.approx(0.03)
    assert Board("aruco:DICT_4X4_50", 5, 5, 0.04, 0.6).tag_side == pytest.approx(0.024)
    corners = np.concatenate(board.outlines)
    assert np.hypot(*corners.T).max() == pytest.approx(0.1 * 2**0.5)


@pytest.mark.parametrize(
    ("family", "columns", "rows", "square", "message"),
    [
        ("aruco:DICT_4X4_50", 2, 5, 0.04, "3x3 squares or more"),
        ("aruco:DICT_4X4_50", 11, 11, 0.04, "at most 50 tags"),
        ("aruco:DICT_9X9", 5, 5, 0.04, "a known family"),
        ("aruco:DICT_4X4_50", 5, 5, 0.0, "square side above 0"),
    ],
)
def test_boards_that_cannot_be_are_refused(family, columns, rows, square, message):
    with pytest.raises(InputError, match=message):
        Board(family, columns, rows, square)
    with pytest.raises(InputError, match="of its square"):
        Board("aruco:DICT_4X4_50", 5, 5, 0.04, 1.0)
