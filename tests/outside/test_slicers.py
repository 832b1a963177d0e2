"""3MF in slicers: one object, each of whose parts is printed where it belongs and in its material.

PrusaSlicer slices the file itself. Cura's reader opens it without its window, and CuraEngine slices the reader's meshes
with the reader's extruders. OrcaSlicer and Bambu Studio are not tested.
"""

from dataclasses import replace

import numpy as np
import pytest
from slicers import LAYER, WIDTH, by_curaengine, by_prusaslicer, nodes_of_cura, objects_of_prusaslicer

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.tag import Tag, to_plane
from markergen.solid.primitives import span_of
from markergen.workshop.processes import parts_of

MATERIALS = ("light", "dark")
"""In the order of their extruders."""

MADE = {
    "plain": Fabrication("fdm"),
    "tag": Fabrication("fdm"),
    "relief": Fabrication("fdm"),
    "dome": Fabrication("dome"),
}
FLAT = ("plain", "tag")


@pytest.fixture(scope="module")
def markers(make_ngon):
    plain = make_ngon(5, 0.03, 0.008)
    raised = tuple(replace(p, z=0.005 * (p.id % 3)) for p in plain.control_points)
    return {
        "plain": plain,
        "tag": replace(plain, tag=Tag("aruco:DICT_4X4_50", 7, 0.018)),
        "relief": replace(plain, control_points=raised),
        "dome": plain,
    }


@pytest.fixture(scope="module", params=MADE)
def case(request, markers, tmp_path_factory):
    """Name, marker, its parts, and the folder of its files."""
    name = request.param
    folder = tmp_path_factory.mktemp(name)
    marker, made = markers[name], replace(MADE[name], tolerance=2e-5)
    save(marker, [folder / "marker.3mf"], ExportOptions(fabrication=made))
    return name, marker, parts_of(marker, made).parts, folder


def box_of(part):
    lefts, bottoms, rights, tops = zip(*(body.box for body in part.add), strict=True)
    return np.array([[min(lefts), min(bottoms)], [max(rights), max(tops)]])


def inside(places, box, room=0.0):
    return ((places > box[0] - room) & (places < box[1] + room)).all(axis=-1)


def check_lines(lines, name, marker, parts):
    """Each material is printed in its parts, from their bottom to their top, and nowhere else."""
    assert set(lines.extruder) == {0, 1}
    middles = lines.ends.mean(axis=1)
    owned = np.zeros(len(lines.top), dtype=bool)
    # The last of a ball's ring is narrower than a line.
    room = 2 * LAYER if name == "dome" else LAYER
    for part in parts:
        (low, high), box = part.span, box_of(part)
        mine = (lines.extruder == MATERIALS.index(part.material)) & inside(middles, box)
        mine &= (lines.top > low + 1e-3) & (lines.top < high + LAYER)
        tops = lines.top[mine]
        assert abs(tops.max() - high) <= room
        owned |= mine
        if part.material == "light" and not part.is_plate:
            continue  # of one piece with the plate around it
        assert abs(tops.min() - LAYER - low) <= LAYER
        if name != "dome" and part.name.startswith("dot"):
            ends = lines.ends[mine & (lines.top == tops.max())].reshape(-1, 2)
            extent = np.array([ends.min(axis=0), ends.max(axis=0)])
            assert np.abs(extent.mean(axis=0) - box.mean(axis=0)).max() < 0.1
            # Lines end half their width from the edge; Cura lets touching parts overlap by 0.15 mm.
            margin = np.ptp(box, axis=0) - np.ptp(extent, axis=0)
            assert margin.min() > WIDTH - 0.25
            assert margin.max() < WIDTH + 0.1
    assert owned[lines.extruder == 1].all()
    low, high = span_of(parts)
    assert lines.top.min() == pytest.approx(low + LAYER)
    assert abs(lines.top.max() - high) <= LAYER
    if name in FLAT:
        check_face(lines, marker, span_of(parts)[1])


def check_face(lines, marker, top):
    """The last layer is dark at the middle of each dark dot and cell, and light elsewhere."""
    ring = 1e3 * marker.control_points[0].feature.diameter / 2 * 0.75
    dots = 1e3 * marker.xyz[:, :2]
    np.testing.assert_array_equal(lines.extruder_at(dots, top), [0, 1, 1, 1, 1])
    np.testing.assert_array_equal(lines.extruder_at(dots[:1] + [[ring, 0], [0, ring], [-ring, 0]], top), 1)
    between = np.array([-1.0, 1.0]) * dots[0] @ np.array([[0.809, 0.588], [-0.588, 0.809]])
    np.testing.assert_array_equal(lines.extruder_at(between[None], top), 0)
    if marker.tag:
        ink = marker.tag.ink
        cells = np.stack(np.meshgrid(np.arange(ink.shape[1]) + 0.5, np.arange(ink.shape[0]) + 0.5), axis=-1)
        side = 1e3 * marker.tag.side / len(ink)
        places = to_plane(cells.reshape(-1, 2), ink.shape[1], ink.shape[0], side)
        np.testing.assert_array_equal(lines.extruder_at(places, top), ink.ravel())


def test_prusaslicer_prints_parts_in_their_places_and_materials(case):
    name, marker, parts, folder = case
    (only,) = objects_of_prusaslicer(folder / "marker.3mf")
    assert int(only["number_of_parts"]) == len(parts)
    assert only["manifold"] == "yes"
    check_lines(by_prusaslicer(folder / "marker.3mf", span_of(parts)[0]), name, marker, parts)


def test_cura_prints_parts_in_their_places_and_materials(case):
    name, marker, parts, folder = case
    (group,) = nodes_of_cura(folder / "marker-parts.3mf")
    assert group["group"]
    results = group["children"]
    assert [(item["name"], item["extruder"]) for item in results] == [
        (part.name, MATERIALS.index(part.material)) for part in parts
    ]
    for item, part in zip(results, parts, strict=True):
        box = np.array(item["box"])
        np.testing.assert_allclose(box[:, :2], box_of(part), atol=0.03)
        np.testing.assert_allclose(box[:, 2], part.span, atol=1e-3)
    check_lines(by_curaengine(results, folder, span_of(parts)[0]), name, marker, parts)


def test_cura_takes_the_file_for_prusaslicer_as_one_object_on_the_bed(case):
    *_, parts, folder = case
    (only,) = nodes_of_cura(folder / "marker.3mf")
    assert not only["group"]
    assert not only["sunk"]
    low, high = span_of(parts)
    assert np.ptp(np.array(only["box"]), axis=0)[2] == pytest.approx(high - low, abs=1e-3)
