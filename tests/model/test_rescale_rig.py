"""Rigs printed at another size."""

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.errors import InputError
from tests.support.rigs import cube

RIG = cube()


def test_dots_move_in_their_plates_and_plates_stay():
    rescaled = mg.rescale(RIG, measured_x="99mm", measured_y="100.5mm", also="plate 2=101mm")
    for before, after in zip(RIG.markers, rescaled.marker.markers, strict=True):
        scale = [1.01, 1.01] if before.name == "plate 2" else [0.99, 1.005]
        np.testing.assert_allclose(after.marker.xyz[:, :2], before.marker.xyz[:, :2] * scale, atol=1e-15)
        assert (after.rotation_matrix == before.rotation_matrix).all()
        assert (after.translation_vector == before.translation_vector).all()
        assert after.marker.print_scale == pytest.approx(tuple(scale))
    assert rescaled.marker.relation == RIG.relation
    message = str(rescaled)
    assert message.count("plate 2: " + sentence("print scale", 101)) == 1
    assert message.count("0, plate 1, plate 3, plate 4, plate 5: " + sentence("print scale", 99)) == 1


def test_a_rescaled_rig_is_written_and_rescaled_again(tmp_path):
    RIG.save(tmp_path / "rig.json")
    rescaled = mg.rescale(tmp_path / "rig.json", tmp_path / "out.json", measured_x="99mm")
    assert mg.Rig.load(tmp_path / "out.json") == rescaled.marker
    again = mg.rescale(rescaled.marker, measured_x="100mm")
    np.testing.assert_allclose(again.marker.xyz, RIG.xyz, atol=1e-15)


def test_what_is_refused():
    for options, phrase in (
        ({"measured_x": "99mm", "also": "+z=99mm"}, "name of a marker of the rig"),
        ({"measured_x": "99mm", "also": "99mm"}, "a marker once"),
        ({"measured_x": "99mm", "also": ["plate 0=99mm", "plate 0=99mm"]}, "a marker once"),
        ({"measured_points": "dots.csv"}, "rulers of a rig"),
        ({"also": "plate 0=99mm"}, "a measured length"),
    ):
        with pytest.raises(InputError, match=phrase):
            mg.rescale(RIG, **options)
    with pytest.raises(InputError, match="of one marker"):
        mg.rescale(RIG.markers[0].marker, measured_x="99mm", also="plate 0=99mm")
