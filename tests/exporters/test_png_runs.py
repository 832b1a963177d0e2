import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from markergen.drawing.scene import Disk, FilledPath, Line
from markergen.drawing.text import text
from markergen.exporters.png import shape_runs

WIDTH, HEIGHT = 40, 30


def painted(shape, per_mm=1.0, page=30.0, width=WIDTH, height=HEIGHT) -> np.ndarray:
    """Share of each pixel; runs must not overlap."""
    shares = np.zeros((height, width))
    runs = shape_runs(shape, per_mm, page, width, height)
    for row, column, length, share in zip(runs.row, runs.column, runs.length, runs.share, strict=True):
        assert np.all(shares[row, column : column + length] == 0)
        shares[row, column : column + length] = share
    return shares


def exact(region: shapely.Geometry, width=WIDTH, height=HEIGHT) -> np.ndarray:
    """The same by intersecting the region with every pixel."""
    x, y = np.meshgrid(np.arange(width), height - 1 - np.arange(height))
    return shapely.area(shapely.intersection(shapely.box(x, y, x + 1, y + 1), region))


def outline(*rings) -> FilledPath:
    segments = []
    for ring in rings:
        segments += [("M", (tuple(ring[0]),)), *(("L", (tuple(p),)) for p in ring[1:]), ("Z", ())]
    return FilledPath(tuple(segments))


# Rounded: at coordinates such as 1e-238 the intersections of shapely, the reference, underflow.
corner = st.tuples(st.floats(-10, 50), st.floats(-10, 40)).map(lambda point: (round(point[0], 9), round(point[1], 9)))


@given(st.lists(corner, min_size=3, max_size=3))
def test_triangles_anywhere_cover_what_they_intersect(corners):
    region = shapely.Polygon(corners)
    # Exact but for what is too faint to paint.
    np.testing.assert_allclose(painted(outline(corners)), exact(region), atol=1.1e-3)


def test_a_hole_runs_the_other_way():
    outer, hole = [(3.3, 2.2), (35, 2.2), (35, 25), (3.3, 25)], [(10, 5), (10, 20.5), (20.5, 20.5), (20.5, 5)]
    np.testing.assert_allclose(painted(outline(outer, hole)), exact(shapely.Polygon(outer, [hole])), atol=1.1e-3)


def test_what_lies_over_itself_counts_once():
    first, second = ([(3, 3), (20, 3), (20, 20), (3, 20)], [(10, 10), (30, 10), (30, 28), (10, 28)])
    union = shapely.union(shapely.Polygon(first), shapely.Polygon(second))
    np.testing.assert_allclose(painted(outline(first, second)), exact(union), atol=1.1e-3)


@pytest.mark.parametrize("inner", [0.0, 3.7])
def test_disks_have_their_area_and_center_to_a_millionth(inner):
    disk = Disk(20.318, 15.127, 8.41, inner)
    shares = painted(disk, per_mm=10, width=400, height=300)
    rows, columns = np.indices(shares.shape) + 0.5
    area = shares.sum() / 100
    # Faint pixels are left out: a thousandth of a pixel each, all around.
    assert area == pytest.approx(np.pi * (8.41**2 - inner**2), rel=1e-5)
    assert (shares * columns).sum() / shares.sum() / 10 == pytest.approx(20.318, abs=2e-5)
    assert 30 - (shares * rows).sum() / shares.sum() / 10 == pytest.approx(15.127, abs=2e-5)


def test_a_disk_beyond_every_edge_of_the_page_is_cut_off():
    region = shapely.Point(2, 1).buffer(60, quad_segs=2000)
    np.testing.assert_allclose(painted(Disk(2, 1, 60)), exact(region), atol=2.1e-3)
    assert not len(shape_runs(Disk(-50, 10, 20), 1.0, 30.0, WIDTH, HEIGHT).row)
    assert not len(shape_runs(Disk(20, 90, 20), 1.0, 30.0, WIDTH, HEIGHT).row)


LINES = {
    "straight": [(3, 5), (33, 24)],
    "bent": [(3, 5), (20, 25), (37, 5)],
    "closed": [(5, 5), (35, 7), (20, 25), (5, 5)],
    "twice the same point": [(3, 5), (3, 5), (33, 24)],
}


@pytest.mark.parametrize("name", LINES)
def test_strokes_are_mitered_and_have_butt_ends(name):
    points = LINES[name]
    line = shapely.LinearRing(points) if name == "closed" else shapely.LineString(points)
    region = line.buffer(0.9, cap_style="flat", join_style="mitre", mitre_limit=4)
    np.testing.assert_allclose(painted(Line(tuple(points), 1.8)), exact(region), atol=1.1e-3)


def test_a_sharp_corner_is_beveled():
    shares = painted(Line(((3, 5), (37, 6), (3, 7)), 0.6))
    assert shares[:, 38:].max() == 0


def test_letters_have_their_area_at_any_size():
    letters = text("Ring 8 \u00e9", 2, 5, 6)
    coarse, fine = painted(letters, per_mm=4, width=200, height=120), painted(letters, per_mm=16, width=800, height=480)
    # Pixels are averages of their parts, and the curve a chord fewer.
    np.testing.assert_allclose(coarse, fine.reshape(120, 4, 200, 4).mean(axis=(1, 3)), atol=3e-3)
