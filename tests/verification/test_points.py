"""Bundles of AprilTags, read back: what each wrong value is called."""

from dataclasses import replace

import pytest
from sentences import sentence

from markergen.errors import InputError
from markergen.exporters.formats.points import write_bundle
from markergen.model.tag import Tag
from markergen.verification.check import verify


@pytest.fixture(scope="module")
def marker(make_ngon):
    return replace(make_ngon(5, 0.06, 0.012), tag=Tag("apriltag:36h11", 3, 0.03, (0.004, -0.002)))


def check(marker, folder, text):
    (folder / "m.apriltag.yaml").write_text(text)
    return verify(marker, folder / "m.apriltag.yaml")


def test_what_was_written_passes(marker, tmp_path):
    found = check(marker, tmp_path, write_bundle(marker))
    assert found.passed
    assert (found.kind, found.dots, found.notes) == ("AprilTag", 0, (sentence("tag alone"),))
    printed = replace(marker, print_scale=(1.01, 1.03))
    assert check(printed, tmp_path, write_bundle(printed)).passed
    assert not check(marker, tmp_path, write_bundle(printed)).passed


NAME = "the tag apriltag:36h11:3"
OTHER = "{id: 7, size: 1, x: 0, y: 0, z: 0, qw: 1, qx: 0, qy: 0, qz: 0}\n"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("id: 3", "id: 4", "its tag is 4, not 3"),
        ("size: 0.03", "size: 0.0301", f"{NAME} is 30.1 mm large, not 30 mm"),
        ("x: 0.004", "x: 0.0045", f"{NAME} is off by x +0.5 mm, y +0 mm, z +0 mm"),
        ("y: -0.002", "y: -0.003", f"{NAME} is off by x +0 mm, y -1 mm, z +0 mm"),
        ("z: 0.0,", "z: 0.001,", f"{NAME} is off by x +0 mm, y +0 mm, z +1 mm"),
        ("qw: 0.0, qx: 0.0, qy: 0.0, qz: 1.0", "qw: 1.0, qx: 0.0, qy: 0.0, qz: 0.0", "turned by 180 degrees"),
        ("qw: 0.0", "qw: 1.0", "turned by 90 degrees"),
        ("qx: 0.0", "qx: 1.0", "turned by 90 degrees"),
        ("'tag36h11'", "'tag25h9'", "its tags are of the family 25h9, not 36h11"),
        ("layout:\n", "layout:\n  - " + OTHER, "2 tags, and the marker one"),
    ],
)
def test_a_wrong_value_is_named(marker, tmp_path, old, new, said):
    good = write_bundle(marker)
    assert old in good
    (finding,) = check(marker, tmp_path, good.replace(old, new)).findings
    assert finding.kind == "tag"
    assert said in finding.sentence


def test_a_quaternion_of_the_other_sign_is_the_same_turn(marker, tmp_path):
    assert check(marker, tmp_path, write_bundle(marker).replace("qz: 1.0", "qz: -1.0")).passed


@pytest.mark.parametrize("text", ["x", "[", "tag_bundles: 3", "tag_bundles: [{layout: [{id: x}]}]", "a: &a [*a]"])
def test_what_is_no_bundle_is_refused(marker, tmp_path, text):
    with pytest.raises(InputError, match=r"a bundle of tags|complete YAML"):
        check(marker, tmp_path, text)


def test_numbers_without_sense_are_refused(marker, tmp_path):
    for old, new in (("x: 0.004", "x: .nan"), ("qz: 1.0", "qz: 0.0")):
        with pytest.raises(InputError, match="unit quaternions"):
            check(marker, tmp_path, write_bundle(marker).replace(old, new))


@pytest.mark.parametrize("tag", [None, Tag("aruco:DICT_4X4_50", 3, 0.03)])
def test_a_marker_without_an_apriltag_has_no_bundle(marker, tmp_path, tag):
    (finding,) = check(replace(marker, tag=tag), tmp_path, write_bundle(marker)).findings
    assert "an AprilTag" in finding.sentence
