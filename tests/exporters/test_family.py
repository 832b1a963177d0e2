"""Tags on printed sheets, read back from pixels by cv2.aruco; and families of markers on one sheet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.comparison.fiducials import FiducialSettings, find_tags
from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import pages_for
from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.formats.sheets import write_pdf
from markergen.exporters.saving import family_paths, save_family
from markergen.model.body_json import from_json, read_marker, to_json
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.model.tag import parse_tag, place_tag

CORNER_PX = 0.3
"""cornerSubPix finds the corner of two edges drawn with smoothing; measured are 0.20 px at most."""


def pentagon(radius, diameter, tag):
    angle = np.pi / 2 + 2 * np.pi * np.arange(5) / 5
    reach = radius - 0.6 * diameter
    marker = build_marker(
        reach * np.stack([np.cos(angle), np.sin(angle)], axis=-1), Circle(radius), diameter, diameter / 10
    )
    return replace(marker, tag=place_tag(tag, None, marker.boundary))


def family(count=10):
    return [pentagon(0.04, 0.016, f"aruco:DICT_4X4_50:{k}") for k in range(count)]


def corner_errors(markers, options=None):
    """Largest distance (k,) in px of each marker's tag from where its marker.json and the page have it, at 150 dpi."""
    import pypdfium2

    markers = [from_json(to_json(marker).decode()) for marker in markers]
    sheets = pages_for(markers, options or SheetOptions())
    document = pypdfium2.PdfDocument(write_pdf(sheets))
    left, errors = list(markers), []
    for sheet, page in zip(sheets, document, strict=True):
        image = page.render(scale=150 / 72, grayscale=True).to_numpy().squeeze()
        # The picture has whole pixels: in a page's width are not exactly 150 to the inch.
        pitch = np.array([sheet.paper.width / image.shape[1], sheet.paper.height / image.shape[0]])
        results = find_tags(image, markers[0].tag.family, FiducialSettings("subpix"))
        assert len(results) == len(sheet.origins_mm)
        for origin in sheet.origins_mm:
            marker = left.pop(0)
            x, y = (1e3 * marker.tag.corners + origin).T
            exact = np.stack([x, sheet.paper.height - y], axis=-1) / pitch - 0.5
            (corners,) = (quad for number, quad in results if number == marker.tag.id)
            errors.append(np.linalg.norm(corners - exact, axis=-1).max())
    document.close()
    assert not left
    return errors


@pytest.mark.parametrize(
    "tag",
    ["aruco:DICT_4X4_50:7", "aruco:DICT_5X5_100:42", "aruco:DICT_6X6_250:200", "apriltag:36h11:3", "apriltag:16h5:5"],
)
def test_a_printed_tag_is_read_where_marker_json_has_it(tag):
    marker = pentagon(0.1, 0.03, tag)
    assert str(marker.tag) == tag
    assert max(corner_errors([marker])) < CORNER_PX


def test_ten_on_one_sheet_are_read():
    errors = corner_errors(family(), SheetOptions(paper="A1"))
    assert len(errors) == 10
    assert max(errors) < CORNER_PX


def test_a_family_is_one_sheet_and_a_file_for_each(tmp_path):
    markers = family(3)
    paths = [tmp_path / "some.pdf", tmp_path / "some.json", tmp_path / "some.svg"]
    written = save_family(markers, paths, ExportOptions(SheetOptions(paper="A2")))
    names = ["some.pdf", "some.svg", "some-0.json", "some-1.json", "some-2.json"]
    assert [path.name for path, _ in written] == names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert [read_marker(tmp_path / name).tag.id for name in names[2:]] == [0, 1, 2]
    assert sorted(family_paths(paths, [0, 1, 2])) == sorted(path for path, _ in written)


def test_each_page_names_the_file_of_its_first_member(tmp_path, monkeypatch):
    from markergen.drawing import print_measurements

    names = []
    draw = print_measurements.draw_remedy
    monkeypatch.setattr(
        print_measurements,
        "draw_remedy",
        lambda frame, lengths, record, *a: names.append(record) or draw(frame, lengths, record, *a),
    )
    markers = family(5)
    save_family(markers, [tmp_path / "some.pdf", tmp_path / "some.json"], ExportOptions())
    assert names == ["some-0.json", "some-2.json", "some-4.json"]
    names.clear()
    files = [tmp_path / f"some-{k}.json" for k in (3, 1, 4)]
    mg.export([*files[:2], markers[2], files[2]], tmp_path / "others.pdf")
    assert names == ["some-3.json", "marker.json"]


@pytest.mark.parametrize(
    ("count", "paper", "phrase"),
    [
        (10, None, "10 markers stand on 5 pages of A4 (210 x 297 mm), up to 2 on each."),
        (3, "letter", "3 markers stand on 2 pages of letter-landscape (279.4 x 215.9 mm), up to 2 on each."),
        (2, None, "2 markers stand on one page of A4 (210 x 297 mm)."),
    ],
)
def test_they_fill_pages_of_a4_or_of_the_paper(count, paper, phrase):
    sheets = pages_for(family(count), SheetOptions(paper))
    assert sheets[0].notes[0] == phrase
    assert [len(sheet.origins_mm) for sheet in sheets] == [2] * (count // 2) + [1] * (count % 2)
    # With each its number and the ids on it.
    named = [{shape.name for shape in sheet.scene["text"]} for sheet in sheets]
    assert all("block-tag" in names and ("block-page" in names) == (len(sheets) > 1) for names in named)


@pytest.mark.long
def test_a_file_of_one_page_has_them_all_on_the_smallest_that_holds_them(tmp_path):
    markers = family(5)
    ((_, notes),) = save_family(markers, [tmp_path / "five.svg"], ExportOptions())
    assert notes[0] == sentence("one page", 5, "A2 (420 x 594 mm)")
    assert notes[-1] == sentence("svg page", "A4")
    assert len(pages_for(markers, SheetOptions(paper="A3"))) > 1


@pytest.mark.parametrize(("radius", "paper", "count"), [(0.085, "A4", 2), (0.15, "A2", 2), (0.4, "A0", 6)])
def test_what_a_grid_cannot_hold_has_pages_of_its_own(radius, paper, count):
    markers = [pentagon(radius, 0.03, f"aruco:DICT_4X4_50:{k}") for k in (3, 7)]
    sheets = pages_for(markers, SheetOptions())
    assert {sheet.paper.name for sheet in sheets} == {paper}
    assert len(sheets) == count
    assert f"2 markers have {count} pages" in sheets[0].notes[0]


def test_pages_of_several_tiled_markers_are_numbered_through(monkeypatch):
    from markergen.drawing import tile_sheets

    written = []
    draw = tile_sheets.text
    monkeypatch.setattr(tile_sheets, "text", lambda phrase, *a, **k: written.append(phrase) or draw(phrase, *a, **k))
    markers = [pentagon(0.1, 0.02, f"aruco:DICT_4X4_50:{k}") for k in (3, 7)]
    sheets = pages_for(markers, SheetOptions("A4"))
    assert len(sheets) == 6
    message = " ".join(written)
    assert "Print pages 2 to 3 at 100 %" in message
    assert "Print pages 5 to 6 at 100 %" in message


def test_names_of_files_for_each_keep_their_suffixes():
    assert family_paths([Path("a.opencv.yaml"), Path("b.JSON")], [4, 12]) == [
        Path("a-4.opencv.yaml"),
        Path("a-12.opencv.yaml"),
        Path("b-4.JSON"),
        Path("b-12.JSON"),
    ]


def test_nothing_is_written_when_a_sheet_is_refused(tmp_path):
    with pytest.raises(InputError, match="page"):
        save_family(family(), [tmp_path / "a.svg", tmp_path / "a.json"], ExportOptions(SheetOptions(paper="A4")))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="markers with tags"):
        save_family([replace(family(1)[0], tag=None)], [tmp_path / "a.json"], ExportOptions())


def test_a_tag_of_its_own_place():
    marker = pentagon(0.1, 0.03, "aruco:DICT_4X4_50:7")
    marker = replace(marker, tag=replace(parse_tag("aruco:DICT_4X4_50:9", 0.04), center=(0.01, -0.005)))
    assert max(corner_errors([marker])) < CORNER_PX
