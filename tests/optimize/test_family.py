from dataclasses import replace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.marker_json import from_json, to_json
from markergen.model.spec import Spec
from markergen.optimize.check import breach
from markergen.optimize.design import design
from markergen.optimize.family import members

SPEC = Spec(tag="aruco:DICT_4X4_50:7", tag_side=0.06, restarts=2)


@pytest.fixture(scope="module")
def marker():
    return design(SPEC).marker


def test_the_dots_keep_clear_of_the_tag_and_stay_on_the_rim(marker):
    assert marker.tag == SPEC.placed_tag
    assert breach(marker.xyz, marker.boundary, marker.blocked, marker.dot_diameter, marker.clearance) <= 1e-9
    # The tag costs nothing: 36 mm dots with 3.6 mm of clearance are 128.4 mm out, a regular pentagon.
    assert np.hypot(*marker.xyz[:, :2].T) == pytest.approx(0.1284, abs=1e-6)
    criteria = marker.provenance["criteria"]
    # A flat optimum: a ten-thousandth is less than any print shows.
    assert criteria["design"]["pose_m"] == pytest.approx(criteria["ngon"]["pose_m"], rel=1e-4)


def test_a_tag_in_the_way_moves_the_dots():
    # With the quiet zone 8/6 of 150 mm: its corners are 141 mm out, and dots of 20 mm pass beside them alone.
    spec = Spec(n=4, tag="aruco:DICT_4X4_50", tag_side=0.15, dot=0.02, restarts=2)
    marker = design(spec).marker
    assert breach(marker.xyz, marker.boundary, marker.blocked, marker.dot_diameter, marker.clearance) <= 1e-9
    angles = np.rad2deg(np.arctan2(marker.xyz[:, 1], marker.xyz[:, 0])) % 90
    # The corners stand at 45 degrees to the axes.
    assert np.all(np.abs(angles - 45) > 10)


def test_every_member_is_as_if_designed_by_itself(marker):
    three = members(marker, SPEC, (3, 7, 12))
    assert [each.tag.id for each in three] == [3, 7, 12]
    assert all(each.control_points == marker.control_points for each in three)
    assert three[1] == marker
    alone = design(replace(SPEC, tag="aruco:DICT_4X4_50:12")).marker
    assert to_json(three[2]) == to_json(alone)
    assert len({each.spec_hash for each in three}) == 3
    assert from_json(to_json(three[0]).decode()) == three[0]


def test_a_family_needs_tags_that_there_are(marker):
    with pytest.raises(InputError, match="an id of 0 to 49"):
        members(marker, SPEC, (3, 50))
    with pytest.raises(InputError, match="--tag"):
        members(replace(marker, tag=None), SPEC, (3,))


def test_dots_of_any_size_leave_the_tag_its_place():
    with pytest.raises(InputError, match="dots that fit"):
        design(Spec(boundary=Circle(0.05), tag="aruco:DICT_4X4_50", tag_side=0.05, dot=0.03))
