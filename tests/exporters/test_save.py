import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest
from sentences import pattern

from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import one_page
from markergen.errors import InputError, OutputError
from markergen.exporters import EXPORTERS, ExportOptions, Output, stem_of, suffix_of
from markergen.exporters.saving import check_exports, save, with_record, write
from markergen.model.body_json import read_marker
from markergen.model.spec import Spec


def test_each_path_in_the_format_of_its_suffix_with_notes(make_ngon, tmp_path):
    marker = make_ngon(5, 0.15, 0.036)
    paths = [tmp_path / "m.pdf", tmp_path / "m.SVG", tmp_path / "m.json"]
    results = save(marker, paths)
    assert [path for path, _ in results] == paths
    assert [bool(notes) for _, notes in results] == [True, True, False]
    assert results[0][1][0].startswith("The marker needs A2")
    assert paths[0].read_bytes().startswith(b"%PDF")
    assert paths[1].read_bytes().startswith(b"<?xml")
    assert read_marker(paths[2]) == marker


def test_a_sheet_names_the_file_of_its_marker(make_ngon, tmp_path):
    marker, names = make_ngon(5, 0.05, 0.012), []
    for record in ("marker.json", "plate.json"):
        save(marker, [tmp_path / "sheet.svg", tmp_path / record])
        names.append((tmp_path / "sheet.svg").read_text())
    save(marker, [tmp_path / "sheet.svg"])
    assert (tmp_path / "sheet.svg").read_text() == names[0] != names[1]


def test_paper_is_passed_on(make_ngon, tmp_path):
    save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg"], ExportOptions(SheetOptions(paper="letter")))
    assert b'width="215.9mm" height="279.4mm"' in (tmp_path / "m.svg").read_bytes()


@pytest.mark.parametrize("name", ["m.pfd", "m", "pdf", "m.yaml", "opencv.yaml", "m.pdf.opencv"])
def test_unknown_suffix_lists_the_known_and_writes_nothing(make_ngon, tmp_path, name):
    with pytest.raises(InputError, match=r"known output suffix.*\.dxf, .*\.opencv\.yaml, \.pdf, \.png"):
        save(make_ngon(5, 0.05, 0.01), [tmp_path / "good.svg", tmp_path / name])
    assert list(tmp_path.iterdir()) == []


def test_a_path_given_twice_is_refused(make_ngon, tmp_path):
    (tmp_path / "sub").mkdir()
    with pytest.raises(InputError, match=r"m\.svg twice"):
        save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg", tmp_path / "sub" / ".." / "m.svg"])
    assert not (tmp_path / "m.svg").exists()


def test_a_format_that_refuses_leaves_every_target_alone(make_ngon, tmp_path):
    (tmp_path / "m.json").write_bytes(b"old")
    with pytest.raises(InputError, match="A4"):
        save(
            make_ngon(5, 0.15, 0.036),
            [tmp_path / "m.json", tmp_path / "m.pdf"],
            ExportOptions(SheetOptions(paper="A4", tile=False)),
        )
    assert (tmp_path / "m.json").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["m.json"]


def test_a_folder_that_is_missing_leaves_every_target_alone(make_ngon, tmp_path):
    (tmp_path / "m.svg").write_bytes(b"old")
    with pytest.raises(OutputError, match="nothing was changed"):
        save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg", tmp_path / "none" / "m.json"])
    assert (tmp_path / "m.svg").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["m.svg"]


def test_a_full_disk_leaves_every_target_alone(make_ngon, tmp_path, monkeypatch):
    (tmp_path / "m.svg").write_bytes(b"old")
    calls = []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg", tmp_path / "m.json"])
    assert (tmp_path / "m.svg").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["m.svg"]


def test_a_target_that_is_a_folder_is_refused(make_ngon, tmp_path):
    target = Path(tmp_path / "m.svg")
    target.mkdir()
    with pytest.raises(OutputError, match="Is a directory"):
        save(make_ngon(5, 0.05, 0.01), [target])


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("board.opencv.yaml", ".opencv.yaml"), ("a.b.PDF", ".pdf"), ("a.Ros2.YAML", ".ros2.yaml"), ("1.5mm.csv", ".csv")],
)
def test_the_longest_known_ending_counts(name, suffix):
    assert suffix_of(Path(name)) == suffix


@pytest.mark.parametrize(
    ("paths", "record"),
    [
        (["m.pdf"], "m.json"),
        (["sub/board.opencv.yaml", "m.pdf"], "sub/board.json"),
        (["1.5mm.SVG"], "1.5mm.json"),
        (["m.pfd"], "m.json"),
        (["m"], "m.json"),
    ],
)
def test_the_record_is_named_after_the_first(paths, record):
    assert with_record([Path(path) for path in paths]) == [*map(Path, paths), Path(record)]


def test_the_record_comes_once():
    paths = [Path("m.opencv.yaml"), Path("m.json")]
    assert with_record(paths) == paths


def test_one_page_formats_refuse_several_pages_and_write_nothing(make_ngon, tmp_path):
    options, marker = ExportOptions(SheetOptions(paper="A4")), make_ngon(5, 0.1, 0.02)
    for names in (["m.svg"], ["m.pdf", "m.png"]):
        with pytest.raises(InputError, match=r"for \.(svg|png), found 3 pages on A4.*\.pdf.*89 mm"):
            save(marker, [tmp_path / name for name in names], options)
    assert list(tmp_path.iterdir()) == []
    save(marker, [tmp_path / "m.pdf"], options)


def test_several_markers_that_one_page_cannot_hold_go_to_a_pdf(make_ngon):
    with pytest.raises(InputError) as raised:
        one_page([make_ngon(5, 0.1, 0.02), make_ngon(5, 0.5, 0.05)], SheetOptions(), ".svg")
    assert "no known paper holds it: write a .pdf" in str(raised.value)
    assert "--no-tile" not in str(raised.value)


@pytest.mark.parametrize(
    ("dpi", "paper", "reason"), [(5, None, "a dpi of 10"), (1200, "A0", "below 2 GB"), (20_000, "A4", "a dpi of 10")]
)
def test_a_dpi_beyond_reason_is_refused_before_any_work(tmp_path, dpi, paper, reason):
    with pytest.raises(InputError, match=reason):
        check_exports([tmp_path / "m.png"], ExportOptions(SheetOptions(paper=paper), dpi=dpi))


def test_pixels_are_counted_where_there_are_any(tmp_path):
    check_exports([tmp_path / "m.pdf"], ExportOptions(SheetOptions(paper="A0"), dpi=1200))


@pytest.mark.parametrize("name", ["m.svg", "m.png"])
def test_a_spec_that_one_page_cannot_hold_is_refused_before_the_search(tmp_path, name):
    options = ExportOptions(SheetOptions(paper="A5"))
    with pytest.raises(InputError, match="A5"):
        check_exports([tmp_path / name], options, Spec())
    check_exports([tmp_path / "m.pdf"], options, Spec())


def test_files_that_come_with_others_are_written_beside_them(tmp_path):
    made = {
        tmp_path / "m.stl": Output(b"all", ("A note.",), {"m-light.stl": b"light", "meshes/m.glb": b"glb"}),
        tmp_path / "m.urdf": Output(b"urdf", (), {"meshes/m.glb": b"glb"}),
    }
    written = write(made)
    names = ["m.stl", "m.urdf", "m-light.stl", "meshes/m.glb"]
    assert written == [(tmp_path / name, ("A note.",) if name == "m.stl" else ()) for name in names]
    assert [(tmp_path / name).read_bytes() for name in names] == [b"all", b"urdf", b"light", b"glb"]


def test_what_comes_with_others_may_be_asked_for_itself(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    made = {
        tmp_path / "m.urdf": Output(b"urdf", (), {"meshes/m.glb": b"glb"}),
        folder / ".." / "meshes" / "m.glb": Output(b"glb", ("Its own note.",)),
    }
    assert [path for path, _ in write(made)] == list(made)
    assert (folder / "m.glb").read_bytes() == b"glb"


@pytest.mark.parametrize(
    "others",
    [
        {"m.dxf": Output(b"other")},
        {"m.sdf": Output(b"sdf", (), {"m.dxf": b"other"})},
    ],
)
def test_two_files_of_one_name_are_refused(tmp_path, others):
    (tmp_path / "m.dxf").write_bytes(b"old")
    made = {tmp_path / "m.step": Output(b"step", (), {"m.dxf": b"dxf", "sub/a": b""})}
    made |= {tmp_path / name: output for name, output in others.items()}
    with pytest.raises(OutputError, match=r"m\.dxf, which .*, found another output") as caught:
        write(made)
    assert "\n" not in str(caught.value)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("m.dxf", b"old")]


def test_an_input_is_not_written_over_by_what_comes_with_another(tmp_path):
    (tmp_path / "plate.dxf").write_bytes(b"input")
    made = {tmp_path / "plate.step": Output(b"step", (), {"meshes/a.glb": b"glb", "plate.dxf": b"dxf"})}
    with pytest.raises(OutputError, match=r"plate\.dxf, found: It is " + pattern("input overwritten")):
        write(made, [tmp_path / "plate.dxf"])
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("plate.dxf", b"input")]


def test_folders_that_were_made_go_again_if_nothing_is_written(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "b").mkdir()
    made = {tmp_path / "m.urdf": Output(b"urdf", (), {"new/deep/a": b"", "kept/a": b"", "kept/b": b""})}
    with pytest.raises(OutputError, match="Is a directory"):
        write(made)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["b", "kept"]
    write({tmp_path / "m.urdf": Output(b"urdf", (), {"new/deep/a": b"1", "kept/a": b""})})
    assert (tmp_path / "new" / "deep" / "a").read_bytes() == b"1"


def test_exporters_are_told_what_the_file_is_called(make_ngon, tmp_path, monkeypatch):
    stems = []
    output = replace(EXPORTERS[".csv"], write=lambda _, options: stems.append(options.stem) or Output(b"1"))
    monkeypatch.setitem(EXPORTERS._entries, ".csv", output)
    save(make_ngon(5, 0.05, 0.01), [tmp_path / "1.5mm.csv", tmp_path / "M.CSV"])
    assert stems == ["1.5mm", "M"]
    assert stem_of(Path("out/board.fab.pdf")) == "board"
    assert stem_of(Path("out/board.opencv.yaml")) == "board"


def test_a_relief_is_a_solid_but_no_drawing(tmp_path):
    check_exports([tmp_path / "m.step", tmp_path / "m.fab.pdf"], ExportOptions(), Spec(relief=0.02))
    for name in ("m.pdf", "m.dxf"):
        with pytest.raises(InputError, match=r"a relief of 20 mm for .*marker\.json"):
            check_exports([tmp_path / name], ExportOptions(), Spec(relief=0.02))
    for name in ("m.pdf", "m.stl"):
        with pytest.raises(InputError, match="found bare points"):
            check_exports([tmp_path / name], ExportOptions(), Spec(dot=0))
    check_exports([tmp_path / "m.json"], ExportOptions(), Spec(dot=0, relief=0.02))
