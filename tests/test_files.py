import errno
import os
import stat
from pathlib import Path

import pytest
from sentences import pattern

from markergen import files
from markergen.errors import InputError, OutputError
from markergen.files import check_outputs, folders_for, make_folder, sorted_by_suffix, write_all, write_atomic


def test_new_and_old_files_end_up_complete(tmp_path):
    target = tmp_path / "a.bin"
    write_atomic(target, b"one")
    target.chmod(0o640)
    write_atomic(target, b"two")
    assert target.read_bytes() == b"two"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_a_missing_folder_is_one_line(tmp_path):
    with pytest.raises(OutputError, match=r"the folder .*none does"):
        write_atomic(tmp_path / "none" / "a.bin", b"")


def test_a_folder_is_no_target(tmp_path):
    with pytest.raises(OutputError, match="directory"):
        write_atomic(tmp_path, b"")


def test_a_full_disk_changes_nothing(tmp_path, monkeypatch):
    first, second = tmp_path / "a.bin", tmp_path / "b.bin"
    first.write_bytes(b"old")
    calls = []

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_all({first: b"new", second: b"new"})
    assert first.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_when_one_of_several_cannot_be_replaced_the_others_are_put_back(tmp_path, monkeypatch):
    old, new, stuck = tmp_path / "old.bin", tmp_path / "new.bin", tmp_path / "stuck.bin"
    old.write_bytes(b"old")
    replace = files.Path.replace

    def refuse(self, target):
        if target.name == "stuck.bin":
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
        return replace(self, target)

    monkeypatch.setattr(files.Path, "replace", refuse)
    with pytest.raises(OutputError, match=r"stuck\.bin, found: Operation not permitted"):
        write_all({old: b"1", new: b"2", stuck: b"3"})
    assert old.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["old.bin"]


def test_links_are_followed(tmp_path):
    real, link = tmp_path / "real.bin", tmp_path / "link.bin"
    real.write_bytes(b"old")
    link.symlink_to(real)
    write_atomic(link, b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"


def test_a_pipe_stays_a_pipe(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_atomic(pipe, b"through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize(
    ("path", "phrase"), [("none/a.json", "none does not exist"), (".", "Is a directory"), ("f/a", "Not a dir")]
)
def test_folders_are_checked_before_the_work(tmp_path, path, phrase):
    (tmp_path / "f").write_bytes(b"")
    with pytest.raises(OutputError, match=phrase):
        files.check_folder(tmp_path / path)
    files.check_folder(tmp_path / "fine.json")


def test_outputs_must_differ_from_inputs_and_from_each_other(tmp_path):
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    check_outputs([first, second], [tmp_path / "c.json"])
    with pytest.raises(OutputError, match=pattern("input overwritten")):
        check_outputs([first, second], [tmp_path / "." / "b.json"])
    (tmp_path / "x").mkdir()
    with pytest.raises(OutputError, match="asked for twice"):
        check_outputs([first, tmp_path / "x" / ".." / "a.json"])
    assert not first.exists()


def test_folders_are_made_or_refused_in_one_line(tmp_path):
    make_folder(tmp_path / "new" / "deep")
    assert (tmp_path / "new" / "deep").is_dir()
    make_folder(tmp_path / "new")
    (tmp_path / "file").write_bytes(b"")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match="expected to write"):
            make_folder(path)


def test_folders_are_made_and_go_again_if_what_follows_fails(tmp_path):
    (tmp_path / "there").mkdir()
    paths = [tmp_path / "there" / "a", tmp_path / "one" / "two" / "a", tmp_path / "one" / "b", tmp_path / "c"]
    with pytest.raises(OutputError), folders_for(paths):
        write_all(dict.fromkeys([*paths, tmp_path / "one" / "two"], b"1"))
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]
    with folders_for(paths):
        write_all(dict.fromkeys(paths, b"1"))
    assert all(path.read_bytes() == b"1" for path in paths)


def test_a_file_in_the_place_of_a_folder_is_told_and_no_folder_stays(tmp_path):
    (tmp_path / "file").write_bytes(b"1")
    paths = [tmp_path / "new" / "a", tmp_path / "file" / "sub" / "a"]
    with pytest.raises(OutputError, match=r"Not a directory|File exists"), folders_for(paths):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_what_others_put_into_a_new_folder_stays(tmp_path):
    def fill(path):
        path.write_bytes(b"1")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), folders_for([tmp_path / "new" / "a"]):
        fill(tmp_path / "new" / "theirs")
    assert (tmp_path / "new" / "theirs").read_bytes() == b"1"


def test_a_suffix_says_what_a_file_holds():
    kinds = {".json": "data", ".svg": "plot"}
    assert sorted_by_suffix([Path("a.SVG"), Path("b.json")], kinds) == [
        ("plot", Path("a.SVG")),
        ("data", Path("b.json")),
    ]
    for name in ("a.txt", "a", ".svg"):
        with pytest.raises(InputError, match=r"ends in \.json, \.svg"):
            sorted_by_suffix([Path(name)], kinds)
