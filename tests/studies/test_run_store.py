import errno
import json
import os

import numpy as np
import pytest
from study_work import cells, noise

from markergen.errors import InputError, MarkergenError, OutputError
from markergen.studies.run import cell_bytes, open_store

IDENTITY = {"study": "test", "runs": 3}


@pytest.fixture
def cell():
    return cells(1)[0]


def test_what_is_read_is_what_was_written(tmp_path, cell):
    result = {"floats": np.linspace(0, 1, 7).reshape(1, 7), "words": np.array(["a", "bc"]), "flag": np.array(True)}
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        assert not store.holds(cell)
        store.write(cell, result)
        assert store.holds(cell)
        results = store.read(cell)
    assert list(results) == list(result)
    for name, array in result.items():
        assert results[name].dtype == array.dtype
        np.testing.assert_array_equal(results[name], array)


def test_numpy_reads_the_files_too(tmp_path, cell):
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.write(cell, noise(cell))
        with np.load(store.path(cell)) as archive:
            np.testing.assert_array_equal(archive["values"], noise(cell)["values"])


def test_equal_arrays_make_equal_bytes(cell):
    assert cell_bytes(cell, noise(cell)) == cell_bytes(cell, noise(cell))


def test_objects_are_no_arrays(cell):
    with pytest.raises(ValueError, match="pickle"):
        cell_bytes(cell, {"any": np.array([object()])})


@pytest.mark.parametrize("place", [0, 5, 40, 200, -70, -65, -1])
def test_a_bit_that_fell_over_is_found_wherever_it_is(tmp_path, cell, place):
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.write(cell, noise(cell))
        data = bytearray(store.path(cell).read_bytes())
        data[place] ^= 1
        store.path(cell).write_bytes(data)
        assert not store.holds(cell)
        with pytest.raises(MarkergenError, match="changed"):
            store.read(cell)


@pytest.mark.parametrize("kept", [0, 1, 63, 64, 65, 500])
def test_a_file_that_was_cut_off_is_found(tmp_path, cell, kept):
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.path(cell).write_bytes(cell_bytes(cell, noise(cell))[:kept])
        assert not store.holds(cell)


def test_the_file_of_another_cell_is_not_taken_for_it(tmp_path, cell):
    other = cells(2)[1]
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.path(cell).write_bytes(cell_bytes(other, noise(other)))
        assert not store.holds(cell)


def snapshot(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize(
    ("file", "content"),
    [("notes.txt", b"mine"), (".hidden", b""), ("study.json", b"{"), ("study.json", b"[1]"), ("cells/00.npz", b"x")],
)
def test_a_folder_with_something_else_is_refused_untouched(tmp_path, file, content):
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_bytes(content)
    before = snapshot(tmp_path)
    for resume in (False, True):
        with pytest.raises(InputError), open_store(tmp_path, IDENTITY, resume):
            pass
    assert snapshot(tmp_path) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == [file.split("/")[0]]


def test_the_folder_of_another_study_is_refused_untouched_and_the_difference_told(tmp_path, cell):
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.write(cell, noise(cell))
    before = snapshot(tmp_path)
    with (
        pytest.raises(InputError, match="runs 3 there, 1000 here"),
        open_store(tmp_path, {**IDENTITY, "runs": 1000}, True),
    ):
        pass
    assert snapshot(tmp_path) == before


def test_other_versions_are_another_study(tmp_path):
    with open_store(tmp_path, IDENTITY, resume=False):
        pass
    content = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps({**content, "numpy": "1.0"}))
    with pytest.raises(InputError, match=r'numpy "1\.0" there'), open_store(tmp_path, IDENTITY, resume=True):
        pass


def test_the_same_study_is_continued_only_when_asked(tmp_path):
    with open_store(tmp_path, IDENTITY, resume=False):
        pass
    with pytest.raises(InputError, match="--resume"), open_store(tmp_path, IDENTITY, resume=False):
        pass
    with open_store(tmp_path, IDENTITY, resume=True):
        pass


def test_what_a_killed_run_left_half_written_is_removed(tmp_path, cell):
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        leftover = store.path(cell).with_name(f".{cell.name}.npz.abc")
        leftover.write_bytes(b"half")
    with open_store(tmp_path, IDENTITY, resume=True):
        assert not leftover.exists()


def test_a_run_that_was_killed_before_it_said_what_it_is_can_begin_anew(tmp_path):
    (tmp_path / "cells").mkdir()
    with open_store(tmp_path, IDENTITY, resume=False):
        assert (tmp_path / "study.json").exists()


def test_two_runs_of_one_study_do_not_share_a_folder(tmp_path):
    pytest.importorskip("fcntl")
    with (
        open_store(tmp_path, IDENTITY, resume=False),
        pytest.raises(InputError, match="found another in"),
        open_store(tmp_path, IDENTITY, resume=True),
    ):
        pass


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="Not a directory"), open_store(tmp_path / "file", IDENTITY, resume=True):
        pass
    assert (tmp_path / "file").read_text() == "mine"


def test_a_full_disk_leaves_what_is_finished_and_nothing_half(tmp_path, monkeypatch):
    first, second = cells(2)
    with open_store(tmp_path, IDENTITY, resume=False) as store:
        store.write(first, noise(first))

        def full(handle):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match=r"No space left.*finished cells remain.*--resume"):
            store.write(second, noise(second))
        assert store.holds(first)
    assert [path.name for path in (tmp_path / "cells").iterdir()] == [f"{first.name}.npz"]
