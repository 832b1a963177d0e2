from dataclasses import replace
from math import pi

import numpy as np
import pytest
from cad import solids_of
from sentences import sentence

from markergen.errors import InputError
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Hole, Substrate
from markergen.solid.plate import plate_of
from markergen.workshop.formats import solids
from markergen.workshop.processes import parts_of

PLAIN = Fabrication(engrave=False)

VOLUME = 1e-9
"""Open CASCADE integrates by quadrature, which is exact to this for planes and cylinders."""

POCKET = 0.6


@pytest.mark.parametrize(("n", "radius", "diameter"), [(5, 0.15, 0.036), (8, 0.03, 0.005)])
def test_volumes_in_closed_form(make_ngon, n, radius, diameter):
    marker = make_ngon(n, radius, diameter)
    solids = solids_of(parts_of(marker, PLAIN).parts)
    assert [solid.name for solid in solids] == ["plate", "dot-0", "dot-0-core", *(f"dot-{i}" for i in range(1, n))]
    disk = pi / 4 * (1e3 * diameter) ** 2 * POCKET
    plate = pi * plate_of(marker).outlines[0][0].as_circle[2] ** 2 * 3 - n * disk
    volumes = [solid.shape.Volume() for solid in solids]
    assert volumes == pytest.approx([plate, 0.75 * disk, 0.25 * disk, *[disk] * (n - 1)], rel=VOLUME)


def test_face_is_flush_at_zero_and_nothing_overlaps(make_ngon):
    marker = make_ngon(5, 0.05, 0.01)
    solids = solids_of(parts_of(marker, Fabrication()).parts)
    boxes = [solid.shape.BoundingBox() for solid in solids]
    # Bounding boxes are widened by the shapes' tolerance of 1e-7 mm.
    assert [box.zmax for box in boxes] == pytest.approx([0] * 7, abs=1e-6)
    assert [box.zmin for box in boxes] == pytest.approx([-3, *[-POCKET] * 6], abs=1e-6)
    plate, *dots = (solid.shape for solid in solids)
    assert all(plate.intersect(dot).Volume() < 1e-6 for dot in dots)
    whole = plate.fuse(*dots).Volume()
    assert whole == pytest.approx(plate.Volume() + sum(dot.Volume() for dot in dots), rel=VOLUME)
    # Together they are the plate without what is engraved.
    letters = parts_of(marker, Fabrication()).parts[0].cut[len(dots) - 1 :]
    engraved = 3 * pi * plate_of(marker).outlines[0][0].as_circle[2] ** 2 - sum(letter.volume for letter in letters)
    assert whole == pytest.approx(engraved, rel=VOLUME)


def test_any_outline_is_a_plate(shape, make_in):
    marker = make_in(shape, 5, 0.01)
    made = parts_of(marker, Fabrication())
    solids = solids_of(parts_of(marker, Fabrication()).parts)
    for part, solid in zip(made.parts, solids, strict=True):
        assert solid.shape.isValid()
        assert solid.shape.ShapeType() == "Solid"
        assert solid.shape.Volume() == pytest.approx(part.volume, rel=VOLUME)
    boxes = [solid.shape.BoundingBox() for solid in solids if solid.name.startswith("plate")]
    corners = 1e3 * np.concatenate(shape.outlines())
    results = [min(box.xmin for box in boxes), max(box.ymax for box in boxes)]
    # An edge is around a rectangle only; any other outline is the plate's.
    edge = 2.0 if len(corners) == 4 else 0.0
    assert results[0] == pytest.approx(corners[:, 0].min() - edge, abs=1e-6)
    assert results[1] == pytest.approx(corners[:, 1].max() + edge, abs=1e-6)
    assert {(round(box.zmin, 6), round(box.zmax, 6)) for box in boxes} == {(-3.0, 0.0)}


def test_engraving_can_be_left_out_and_says_what_has_no_room(make_ngon, shapes, make_in):
    marker = make_ngon(5, 0.05, 0.01)
    assert len(parts_of(marker, Fabrication()).parts[0].cut) > 5
    assert len(parts_of(marker, PLAIN).parts[0].cut) == 5
    marker = make_in(shapes["annulus"], 5, 0.01)
    assert parts_of(marker, Fabrication()).notes[-1] == sentence("back full", "origin and x-axis")
    assert parts_of(marker, PLAIN).notes == ()


def test_holes_that_hit_dots_and_bare_points_are_refused(make_ngon):
    marker = make_ngon(4, 0.05, 0.01)
    x, y = marker.control_points[1].x, marker.control_points[1].y
    with pytest.raises(InputError, match="over dot 1"):
        parts_of(replace(marker, substrate=Substrate(holes=(Hole(x, y, 0.003),))), PLAIN)
    with pytest.raises(InputError, match="diameter 0"):
        parts_of(make_ngon(4, 0.05, 0.0), PLAIN)


def test_solids_of_one_marker_are_made_once(make_ngon):
    marker = make_ngon(4, 0.05, 0.01)
    first = solids.solids_of(parts_of(marker, PLAIN).parts)
    assert solids.solids_of(parts_of(replace(marker, clearance=0.002), PLAIN).parts) is first
    assert solids.solids_of(parts_of(marker, Fabrication(depth=0.001, engrave=False)).parts) is not first
