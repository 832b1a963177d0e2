"""Tiles: put together by their marks they are the marker, and every page says what it is and proves its size."""

import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from sentences import sentence

from markergen.drawing.colors import INVERTED
from markergen.drawing.figure import Figure
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import Disk, Line, bounds, clipped
from markergen.drawing.sheet_layout import pages_for, sheet_for
from markergen.errors import InputError
from markergen.exporters.formats.sheets import write_pdf
from markergen.model.tag import Tag

MICROMETER = 1e-3  # mm; pdfium holds coordinates as 32-bit floats, 0.03 um on A4


def assembled(pages, columns: int) -> np.ndarray:
    """Dots (n, 2) of tiles in reading order, moved so that the crosses on their seams coincide."""
    shifts: list[np.ndarray] = []
    for index, (_, _, crosses) in enumerate(pages):
        joints = []
        if index % columns:
            joints.append((index - 1, 0, 1))
        if index >= columns:
            joints.append((index - columns, 1, -1))
        results = []
        for neighbor, axis, side in joints:
            theirs, ours = (on_edge(marks, axis, way) for marks, way in ((pages[neighbor][2], side), (crosses, -side)))
            assert len(theirs) == len(ours) > 0
            gaps = theirs + shifts[neighbor] - ours
            assert np.ptp(gaps, axis=0).max() < MICROMETER
            results.append(gaps.mean(axis=0))
        shifts.append(np.mean(results, axis=0) if results else np.zeros(2))
        assert all(np.hypot(*(offset - shifts[-1])) < MICROMETER for offset in results), "all seams close"
    return np.concatenate([dots + offset for (_, dots, _), offset in zip(pages, shifts, strict=True)])


def on_edge(crosses: np.ndarray, axis: int, side: int) -> np.ndarray:
    """The outermost crosses on one side, in order along it."""
    along = crosses[:, axis] * side
    edge = crosses[along > along.max() - 0.01]
    return edge[np.argsort(edge[:, 1 - axis])]


CASES = [
    (5, 0.15, 0.036, "A4", "2 rows of 2", 4),
    pytest.param(5, 0.15, 0.036, "A4-landscape", "2 rows of 2", 4, marks=pytest.mark.long),
    pytest.param(5, 0.15, 0.036, "A5", "2 rows of 3", 6, marks=pytest.mark.long),
    (12, 0.15, 0.03, "letter", "2 rows of 2", 4),
    (9, 0.4, 0.08, "A3", None, None),
]


@pytest.mark.parametrize(("n", "radius", "diameter", "paper", "grid", "count"), CASES)
def test_tiles_put_together_by_their_marks_are_the_marker(
    make_ngon, read_pdf, check_page, n, radius, diameter, paper, grid, count
):
    marker = make_ngon(n, radius, diameter)
    sheets = pages_for([marker], SheetOptions(paper))
    rows, columns = map(int, re.search(r"(\d+) rows of (\d+)", sheets[0].notes[0]).groups())
    if grid:
        assert grid in sheets[0].notes[0]
        assert len(sheets) == 1 + count
    assert len(sheets) == 1 + rows * columns
    assert not any("seam cuts" in note for note in sheets[0].notes)
    plan, *pages = read_pdf(write_pdf(sheets))
    assert not len(plan[1]), "the picture has no circles that could be taken for dots"
    for size, _, _ in (plan, *pages):
        assert size == pytest.approx((sheets[0].paper.width, sheets[0].paper.height), rel=1e-6)
    whole = read_pdf(write_pdf([sheet_for(marker, "5000x5000mm")]))[0][1]
    results = assembled(pages, columns)
    assert len(results) == len(whole) == n
    order = [int(np.argmin(np.hypot(*(results - results.mean(axis=0) - p).T))) for p in whole - whole.mean(axis=0)]
    moved = results[order] - results.mean(axis=0)
    assert np.max(np.hypot(*(moved - (whole - whole.mean(axis=0))).T)) < MICROMETER
    for sheet in sheets:
        check_page(sheet)


def test_every_tile_has_rulers_labels_and_what_to_do(make_ngon):
    for paper in ("A4", "A5", "A3", "letter-landscape"):
        for sheet in pages_for([make_ngon(7, 0.19, 0.04)], SheetOptions(paper))[1:]:
            assert min(sheet.rulers_mm) >= 50
            names = {shape.name for shape in sheet.scene}
            assert {"ruler-0", "ruler-y-0", "remedy-0-0", "remedy-1-0", "tile-number", "tile-page", "tile-cut"} <= names
            for name, length in zip(("ruler", "ruler-y"), sheet.rulers_mm, strict=True):
                axis = 0 if name == "ruler" else 1
                ends = [next(s for s in sheet.scene if s.name == f"{name}-{mm}").points[0] for mm in (0, length)]
                assert ends[1][axis] - ends[0][axis] == pytest.approx(length, abs=1e-9)
            rulers = [s for s in sheet.scene if s.name in ("ruler", "ruler-y")]
            others = [s for s in sheet.scene["marks"] if not s.name.startswith("ruler")]
            for ruler in rulers:
                assert all(not overlap(bounds(ruler), bounds(s)) for s in others if isinstance(s, Line))


def test_words_fit_the_number_of_tiles(make_ngon):
    marker = make_ngon(5, 0.09, 0.02)
    plan, page = pages_for([marker], SheetOptions("240x245mm"))
    assert "1 tiles" not in plan.notes[0]
    assert "larger than" not in plan.notes[0], "the disk is smaller than the paper"
    assert not any(shape.name.startswith("step-number-2") for shape in plan.scene["text"]), "nothing to glue"
    assert not any("crop" in shape.name for shape in page.scene["marks"])
    assert (
        "2 tiles of A4-landscape (297 x 210 mm): 2 rows of 1"
        in pages_for([marker], SheetOptions("A4-landscape"))[0].notes[0]
    )
    assert "1 row of 2" in pages_for([marker], SheetOptions("A4"))[0].notes[0]


def overlap(a, b) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_a_dot_is_printed_once_and_no_number_is_cut(make_ngon):
    marker = make_ngon(11, 0.2, 0.03)
    sheets = pages_for([marker], SheetOptions("A4"))
    dots = [shape for sheet in sheets for shape in sheet.scene["dots"]]
    assert sorted(dot.name for dot in dots) == sorted(f"dot-{point.id}" for point in marker.control_points)
    assert all(isinstance(dot, Disk) for dot in dots)
    for sheet in sheets[1:]:
        left, bottom, right, top = sheet.trim_mm
        numbers = {s.name.removeprefix("number-") for s in sheet.scene["text"] if s.name.startswith("number-")}
        assert numbers == {dot.name.removeprefix("dot-") for dot in sheet.scene["dots"]}, "each beside its dot"
        for shape in (*sheet.scene["dots"], *(s for s in sheet.scene["text"] if s.name.startswith("number-"))):
            box = bounds(shape)
            assert left < box[0]
            assert bottom < box[1]
            assert box[2] < right
            assert box[3] < top


@pytest.mark.long
def test_a_dot_that_no_seam_can_miss_is_named_and_put_together_whole(make_marker):
    # One dot wider than the paper, so every seam runs through it.
    marker = make_marker(np.array([[0.0, 0.0], [0.3, 0.3], [-0.3, 0.3], [0.3, -0.3]]), 0.5, 0.25)
    sheets = pages_for([marker], SheetOptions("A4"))
    assert any(re.search(r"A seam cuts dots? .*0", note) for note in sheets[0].notes)
    parts = []
    for sheet in sheets[1:]:
        (dx, dy), (left, bottom, right, top) = sheet.origins_mm[0], sheet.trim_mm
        for shape in sheet.scene["dots"]:
            if shape.name == "dot-0":
                rings, ring = [], []
                for _, points in shape.segments:
                    if points:
                        ring.append(points[0])
                    else:
                        rings.append(shapely.Polygon(ring))
                        ring = []
                region = rings[0]
                for other in rings[1:]:
                    region = region.symmetric_difference(other)
                visible = shapely.intersection(region, shapely.box(left, bottom, right, top))
                parts.append(shapely.affinity.translate(visible, -dx, -dy))
    whole = shapely.union_all(parts)
    # The parts do not overlap, and are within 1e-4 mm of the ring: its rims are 1178 mm long.
    assert sum(part.area for part in parts) == pytest.approx(whole.area, rel=1e-9)
    assert whole.area == pytest.approx(np.pi * (125**2 - 62.5**2), abs=1178 * 2e-4)
    assert np.hypot(whole.centroid.x, whole.centroid.y) < 1e-3


@pytest.mark.parametrize(("radius", "side", "paper"), [(0.15, 60, "A4"), (0.089, 29, "A5")], ids=["apart", "near"])
def test_a_tag_is_one_with_the_dots(make_ngon, radius, side, paper):
    """No seam need run through it: it is whole on one tile, even if it reaches into the overlap with the next."""
    marker = replace(make_ngon(5, radius, 0.036), tag=Tag("aruco:DICT_4X4_50", 3, side / 1e3))
    sheets = pages_for([marker], SheetOptions(paper))
    tags = [(sheet.origins_mm[0], shape) for sheet in sheets[1:] for shape in sheet.scene["tag"]]
    assert len(tags) == 1
    (x, y), shape = tags[0]
    assert bounds(shape) == pytest.approx((x - side / 2, y - side / 2, x + side / 2, y + side / 2), abs=1e-6)
    assert not any("seam cuts" in note for note in sheets[0].notes)
    # In the plan's picture it is blank, so that nothing can take it for a tag.
    (square,) = (shape for shape in sheets[0].scene if shape.name == "plan-tag")
    assert len(square.segments) == 5


def test_a_tag_that_no_seam_can_miss_is_named(make_ngon):
    marker = replace(make_ngon(5, 0.15, 0.02), tag=Tag("aruco:DICT_4X4_50", 3, 0.15))
    sheets = pages_for([marker], SheetOptions("A5"))
    assert any(note.startswith("A seam cuts") for note in sheets[0].notes)
    assert sum(bool(sheet.scene["tag"]) for sheet in sheets) > 1


def test_a_cut_tag_keeps_its_area(make_marker):
    marker = replace(make_marker(np.array([[0.2, 0.2], [-0.2, 0.2]]), 0.3, 0.03), tag=Tag("aruco:DICT_4X4_50", 3, 0.1))
    tag = Figure(marker).tag
    halves = [list(clipped(tag, box)) for box in ((-99, -99, 10, 99), (10, -99, 99, 99))]
    cells = marker.tag.ink.sum() * (100 / marker.tag.cells) ** 2

    def area(shapes) -> float:
        total = 0.0
        for shape in shapes:
            ring = []
            for _, points in shape.segments:
                if points:
                    ring.append(points[0])
                else:
                    x, y = np.array(ring).T
                    total += float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)
                    ring = []
        return abs(total)

    assert sum(area(half) for half in halves) == pytest.approx(cells, rel=1e-9)


def test_inverted_tiles_print_their_ground(make_ngon, check_page):
    sheets = pages_for([make_ngon(5, 0.15, 0.036)], SheetOptions("A4", colors=INVERTED))
    area = 0.0
    for sheet in sheets[1:]:
        check_page(sheet)
        left, bottom, right, top = bounds(sheet.scene["ground"][0])
        box = (
            max(left, sheet.trim_mm[0]),
            max(bottom, sheet.trim_mm[1]),
            min(right, sheet.trim_mm[2]),
            min(top, sheet.trim_mm[3]),
        )
        area += (box[2] - box[0]) * (box[3] - box[1])
    whole = bounds(pages_for([make_ngon(5, 0.15, 0.036)], SheetOptions("A1", colors=INVERTED))[0].scene["ground"][0])
    # The pad around it grows with the paper; on A4 it is 5.5 mm.
    pad = 5.5 * (np.sqrt(594 / 210) - 1)
    assert area == pytest.approx((whole[2] - whole[0] - 2 * pad) * (whole[3] - whole[1] - 2 * pad), rel=1e-9)


def test_without_a_paper_the_largest_is_tiled(make_ngon):
    sheets = pages_for([make_ngon(8, 0.7, 0.1)], SheetOptions())
    assert sheets[0].notes[0].startswith(sentence("no paper", "1400 mm", 4))
    with pytest.raises(InputError, match=r"100 tiles hold, found 3000 mm across on A5 .*"):
        pages_for([make_ngon(8, 1.5, 0.1)], SheetOptions("A5"))


@pytest.mark.parametrize("overlap", [0.0, 0.003, 0.09])
def test_an_overlap_of_no_use_is_refused(make_ngon, overlap):
    with pytest.raises(InputError, match=r"overlap of 4 to \d\d mm"):
        pages_for([make_ngon(5, 0.15, 0.036)], SheetOptions("A4", overlap=overlap))
    # It does not matter to what is not tiled.
    assert len(pages_for([make_ngon(5, 0.15, 0.036)], SheetOptions("A2", overlap=overlap))) == 1
