"""What sheets and errors say about paper: which is needed, and what would fit."""

import pytest
from sentences import sentence

from markergen.drawing.paper import PAPERS, SheetOptions
from markergen.drawing.sheet_layout import check_paper, fits, largest_disk, pages_for, sheet_for
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.read.outlines.boundary import parse_boundary


def test_notes_say_which_paper_and_why(make_ngon):
    sheet = sheet_for(make_ngon(5, 0.15, 0.036))
    tiled = " With --paper A4, a .pdf has it on tiles; " + sentence("page holds", "A4", 89, 89)
    assert sheet.notes[0] == sentence("needs paper", "A2 (420 x 594 mm)", "disk is 300 mm across") + tiled
    assert "200 mm" in sheet.notes[1]
    larger = sheet_for(make_ngon(5, 0.15, 0.036), "A1")
    assert larger.notes[0] == sentence("stands on", "A1 (594 x 841 mm)", "300 mm") + "."
    assert not any("design" in note for note in larger.notes)


def test_too_small_paper_says_the_size_needed(make_ngon):
    with pytest.raises(InputError, match=r"3\d\d x 3\d\d mm .* found A4 \(210 x 297 mm\); use --paper A2.*89 mm"):
        sheet_for(make_ngon(5, 0.15, 0.036), "A4")
    with pytest.raises(InputError, match=r"A0 paper .* 2000 mm across that needs \d+ x \d+"):
        sheet_for(make_ngon(5, 1.0, 0.1))
    with pytest.raises(InputError, match="no known paper"):
        sheet_for(make_ngon(5, 1.0, 0.1), "A4")


def test_too_small_paper_is_known_before_there_are_dots():
    check_paper(Circle(0.15), SheetOptions("A4"))
    check_paper(Circle(0.15), SheetOptions("A2", tile=False))
    with pytest.raises(InputError, match=r"found A4 \(210 x 297 mm\); use --paper A2, .* --no-tile"):
        check_paper(Circle(0.15), SheetOptions("A4", tile=False))
    with pytest.raises(InputError, match=r"a disk of radius 89 mm: design it with --radius 89mm"):
        check_paper(Circle(0.15), SheetOptions("A4", tile=False), sized=True)


def test_a_page_too_small_for_a_family_is_known_before_there_are_dots(make_ngon):
    alone, options = make_ngon(5, 0.05, 0.012), SheetOptions("A4")
    assert len(pages_for([alone] * 2, options)) == 1
    check_paper(alone.boundary, options, many_pages=False, count=2)
    check_paper(alone.boundary, options, count=3)
    with pytest.raises(InputError, match=r"3 markers 100 mm across, found A4.* for 2"):
        check_paper(alone.boundary, options, many_pages=False, count=3)


@pytest.mark.parametrize("paper", sorted(PAPERS))
@pytest.mark.parametrize("dot", [0.002, 0.03])
def test_the_largest_disk_fits_and_no_larger_one(make_ngon, paper, dot):
    options = SheetOptions(paper, "landscape" if paper.endswith("landscape") else "portrait")
    # A dot straight up and a square's other three reach as far as any can.
    radius = largest_disk(options, 1e3 * (dot / 2 - dot / 10))
    assert fits(make_ngon(4, radius / 1e3, dot), options)
    assert not fits(make_ngon(4, (radius + 1) / 1e3, dot), options)


def test_tiles_say_what_a_page_holds(make_ngon, make_in, shapes):
    notes = pages_for([make_ngon(5, 0.15, 0.036)], SheetOptions("letter"))[0].notes
    assert notes[1] == sentence("print on one", "A2", sentence("page holds", "letter", 91, 91))
    notes = pages_for([make_in(shapes["two squares"], 6, 0.015)], SheetOptions("A5"))[0].notes
    assert notes[1] == sentence("print on one", "A4-landscape", sentence("page has room", "A5", "121 x 144 mm"))
    # Nobody is sent where the dots have no room.
    notes = pages_for([make_ngon(5, 0.15, 0.07)], SheetOptions("A4"))[0].notes
    assert notes[1].startswith("To print it on one: use --paper A2; a page of A4 holds a disk of radius ")
    assert "--radius" not in notes[1]
    # Without quiet zones, which dots at the edges need, there is room for 2 mm more.
    portrait = SheetOptions("A5", "portrait", tile=False)
    check_paper(parse_boundary("rect:121mmx146mm"), portrait)
    for larger in ("rect:122mmx146mm", "rect:121mmx147mm"):
        with pytest.raises(InputError, match="121 x 146 mm"):
            check_paper(parse_boundary(larger), portrait)
