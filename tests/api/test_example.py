"""Examples are copied out of the installation as they are."""

import filecmp

import pytest

from markergen.api.shipped import copied_example, examples, summary_of
from markergen.cli import main
from markergen.errors import InputError, OutputError


def test_all_kinds_are_there():
    assert {"take_photos", "first_marker", "ros2", "plugin", "desk-a4"} <= set(examples())


def test_each_says_what_it_is():
    assert summary_of(examples()["take_photos"]).startswith("Take synthetic photos of a marker")
    assert all(map(summary_of, examples().values()))


@pytest.mark.parametrize("name", ["take_photos", "first_marker", "desk-a4"])
def test_a_file_is_copied_once(name, tmp_path):
    [written] = copied_example(name, tmp_path).written
    assert filecmp.cmp(written.path, examples()[name], shallow=False)
    with pytest.raises(OutputError):
        copied_example(name, tmp_path)


def test_a_package_is_copied_whole(tmp_path, capsys):
    assert main(["example", "ros2", str(tmp_path)]) == 0
    assert (tmp_path / "ros2" / "package.xml").is_file()
    assert "package.xml" in capsys.readouterr().out


def test_the_nearest_name_is_suggested(tmp_path):
    with pytest.raises(InputError, match="take_photos"):
        copied_example("take_photo", tmp_path)


def test_without_a_name_all_are_listed(capsys):
    assert main(["example"]) == 0
    assert set(examples()) == {line.split()[0] for line in capsys.readouterr().out.splitlines()}
