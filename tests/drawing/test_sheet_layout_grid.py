"""Several markers on a page."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.drawing.colors import INVERTED
from markergen.drawing.paper import SheetOptions
from markergen.drawing.scene import bounds
from markergen.drawing.sheet_layout import pages_for
from markergen.model.tag import Tag


@pytest.fixture(scope="module")
def family(make_ngon):
    marker = make_ngon(5, 0.03, 0.007)
    return [replace(marker, tag=Tag("apriltag:36h11", number, 0.015)) for number in range(10)]


@pytest.mark.parametrize(
    ("options", "paper", "pages"),
    [
        (SheetOptions(), "A4", 3),
        (SheetOptions("A3"), "A3", 2),
        (SheetOptions("letter", "landscape"), "letter-landscape", 4),
        (SheetOptions("A4", colors=INVERTED), "A4", 3),
        (SheetOptions("A4", margin=0.005), "A4", 3),
    ],
)
def test_as_many_as_fit_then_the_next_page(family, check_page, options, paper, pages):
    sheets = pages_for(family, options)
    assert {sheet.paper.name for sheet in sheets} == {paper}
    assert len(sheets) == pages
    assert sum(len(sheet.origins_mm) for sheet in sheets) == 10
    assert len({len(sheet.origins_mm) for sheet in sheets[:-1]}) <= 1, "all but the last are full"
    place = iter(family)
    for sheet in sheets:
        check_page(sheet, 9.4 if options.margin is None else options.margin * 1e3)
        dots = list(sheet.scene["dots"])
        assert len(sheet.scene["tag"]) == len(sheet.origins_mm)
        for origin in sheet.origins_mm:
            marker = next(place)
            mine, dots = dots[: len(marker)], dots[len(marker) :]
            np.testing.assert_allclose(
                [(dot.x, dot.y) for dot in mine], marker.xyz[:, :2] * 1e3 + origin, atol=1e-6, rtol=0
            )
        assert not dots
        boxes = [shape for shape in sheet.scene["text"] if shape.name.endswith("caption-name-0")]
        assert len(boxes) == len(sheet.origins_mm)
        assert sheet.notes == () or sheet is sheets[0]
        # The caption stands below its marker, nearer to it than to any other.
        for box, origin in zip(boxes, sheet.origins_mm, strict=True):
            left, _, right, top = bounds(box)
            away = [np.hypot((left + right) / 2 - x, top - y) for x, y in sheet.origins_mm]
            assert int(np.argmin(away)) == sheet.origins_mm.index(origin)
    phrase = f"10 markers stand on {f'{pages} pages' if pages > 1 else 'one page'} of "
    assert sheets[0].notes[0].startswith(phrase)


def test_every_caption_has_the_tag_and_the_hash_of_the_spec(family, monkeypatch):
    from markergen.drawing import sheet_layout

    written = []
    monkeypatch.setattr(sheet_layout, "paragraph", lambda phrase, *_: written.append(phrase) or [])
    specs = [replace(marker, provenance={"spec_hash": f"{k:08x}"}) for k, marker in enumerate(family)]
    pages_for(specs, SheetOptions("A3"))
    names = [phrase for phrase in written if "apriltag" in phrase]
    assert names == [f"apriltag:36h11:{k}, spec {k:08x}" for k in range(10)]


def test_markers_of_different_sizes_share_cells_of_the_largest(make_ngon, check_page):
    markers = [make_ngon(4 + i, 0.02 + 0.004 * i, 0.005) for i in range(5)]
    sheets = pages_for(markers, SheetOptions("A4"))
    assert sum(len(sheet.origins_mm) for sheet in sheets) == 5
    for sheet in sheets:
        check_page(sheet)
    with pytest.raises(StopIteration):
        next(shape for shape in sheets[0].scene if shape.name == "block-size")


def test_markers_that_need_a_page_each_get_one(make_ngon):
    sheets = pages_for([make_ngon(5, 0.08, 0.016), make_ngon(6, 0.08, 0.016)], SheetOptions("A4"))
    assert [len(sheet.origins_mm) for sheet in sheets] == [1, 1]
    assert [len(sheet.scene["dots"]) for sheet in sheets] == [5, 6]


def test_markers_larger_than_the_paper_are_tiled_one_by_one(make_ngon):
    sheets = pages_for([make_ngon(5, 0.15, 0.036), make_ngon(6, 0.15, 0.036)], SheetOptions("A4"))
    assert [len(sheet.origins_mm) for sheet in sheets].count(0) == 2
    assert sum(len(sheet.scene["dots"]) for sheet in sheets) == 11
