import errno
import os
from pathlib import Path

import pytest

from markergen.errors import InputError, OutputError
from markergen.export import ExportOptions, save
from markergen.model.marker_json import read_marker


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


def test_paper_is_passed_on(make_ngon, tmp_path):
    save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg"], ExportOptions(paper="letter"))
    assert b'width="215.9mm" height="279.4mm"' in (tmp_path / "m.svg").read_bytes()


@pytest.mark.parametrize("name", ["m.pfd", "m", "pdf"])
def test_unknown_suffix_lists_the_known_and_writes_nothing(make_ngon, tmp_path, name):
    with pytest.raises(InputError, match=r"known output suffix.*\.json, \.pdf, \.step, \.stp, \.svg"):
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
        save(make_ngon(5, 0.15, 0.036), [tmp_path / "m.json", tmp_path / "m.pdf"], ExportOptions(paper="A4"))
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
    with pytest.raises(OutputError, match="No space left on device"):
        save(make_ngon(5, 0.05, 0.01), [tmp_path / "m.svg", tmp_path / "m.json"])
    assert (tmp_path / "m.svg").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["m.svg"]


def test_a_target_that_is_a_folder_is_refused(make_ngon, tmp_path):
    target = Path(tmp_path / "m.svg")
    target.mkdir()
    with pytest.raises(OutputError, match="Is a directory"):
        save(make_ngon(5, 0.05, 0.01), [target])
