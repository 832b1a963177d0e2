"""What belongs to nothing of the marker is reported, wherever it is; what is only written otherwise passes."""

from dataclasses import replace

import numpy as np
import pytest
from damaged_sheets import drawn
from spoiled_solids import glb, gltf, stl, triangles

from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.feature import Feature
from markergen.model.tag import Tag
from markergen.verification import verify


@pytest.fixture(scope="module")
def marker(make_ngon):
    ngon = make_ngon(5, 0.05, 0.012)
    ring = replace(ngon.control_points[0], feature=Feature(0.012, 0.006))
    return replace(ngon, control_points=(ring, *ngon.control_points[1:]), tag=Tag("apriltag:36h11", 3, 0.02))


@pytest.fixture(scope="module")
def files(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    options = ExportOptions(fabrication=Fabrication(engrave=False, foot=0.0, tolerance=1e-5))
    save(marker, [folder / "a.stl", folder / "a.dxf", folder / "a.glb"], options)
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in (".stl", ".dxf", ".glb")}


def check_of(marker, folder, suffix, data):
    (folder / f"b{suffix}").write_bytes(data)
    return verify(marker, folder / f"b{suffix}")


def kinds(check):
    return {finding.kind for finding in check.findings}


def box(low, high):
    """Triangles (12, 3, 3) of a box, seen counterclockwise from outside."""
    sides = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, 1):
            square = np.zeros((4, 3))
            square[:, axis], square[:, u], square[:, v] = end, [0, 1, 1, 0], [0, 0, 1, 1]
            square = square if end else square[::-1]
            sides += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.array(low) + np.array(sides) * (np.array(high) - low)


BODIES = {
    "block on the face": box((-18, -18, 0), (-15, -15, 3)),
    "block in the air": box((-18, -18, 10), (-15, -15, 12)),
    "block beside the plate": box((80, 0, -3), (90, 10, 0)),
    "post on the back": box((-18, -18, -20), (-15, -15, -3)),
    "void": box((-18, -18, -2), (-15, -15, -1))[:, ::-1],
}


@pytest.mark.parametrize("name", BODIES)
def test_bodies_that_are_not_the_markers_are_extra(marker, files, tmp_path, name):
    corners = triangles(files[".stl"])
    assert check_of(marker, tmp_path, ".stl", stl(corners)).passed
    check = check_of(marker, tmp_path, ".stl", stl(np.concatenate([corners, BODIES[name]])))
    assert kinds(check) == {"extra"}, check.findings
    assert check.findings[0].remedy


@pytest.mark.parametrize(("size", "kind"), [(1.1, "diameter"), (0, "kind")])
def test_cores_of_rings_that_are_larger_or_missing_are_named(marker, files, tmp_path, size, kind):
    document, rest = gltf(files[".glb"])
    index = next(k for k, node in enumerate(document["nodes"]) if node.get("name") == "dot-0-core")
    holder = document["nodes"][index]
    if size:
        x, y = marker.control_points[0].x, marker.control_points[0].y
        holder["scale"], holder["translation"] = [size, size, 1], [(1 - size) * x, (1 - size) * y, 0]
    else:
        del holder["mesh"]
    check = check_of(marker, tmp_path, ".glb", glb(document, rest))
    assert kind in kinds(check), check.findings


def entity(space, kind):
    return space.query(f'{kind}[layer=="ENGRAVE"]')[0]


def again(kind):
    def change(document, space):
        space.add_entity(entity(space, kind).copy())

    return change


def engraved_line(document, space):
    space.add_line((-18, -18), (-15, -18), dxfattribs={"layer": "ENGRAVE"})


def other_layer(document, space):
    document.layers.add("LOGO")
    space.add_line((-18, -18), (-15, -18), dxfattribs={"layer": "LOGO"})


def broken_line(document, space):
    document.linetypes.add("GAPS", [2.0, 1.0, -1.0])
    entity(space, "LWPOLYLINE").dxf.linetype = "GAPS"


ENTITIES = {
    "circle twice": (again("CIRCLE"), "twice"),
    "tag twice": (again("LWPOLYLINE"), "twice"),
    "line to engrave": (engraved_line, "extra"),
    "layer of its own": (other_layer, "covered"),
    "line with gaps": (broken_line, "covered"),
}


@pytest.mark.parametrize("name", ENTITIES)
def test_entities_that_are_not_the_markers_are_extra(marker, files, tmp_path, name):
    change, kind = ENTITIES[name]
    check = check_of(marker, tmp_path, ".dxf", drawn(change)(files[".dxf"]))
    assert kind in kinds(check), check.findings


def two_arcs(document, space):
    circle = entity(space, "CIRCLE")
    for start in (20, 200):
        space.add_arc(circle.dxf.center, circle.dxf.radius, start, start + 180, dxfattribs={"layer": "ENGRAVE"})
    space.delete_entity(circle)


def in_a_block(document, space):
    block = document.blocks.new("PLATE", base_point=(3, 4))
    for part in list(space):
        space.unlink_entity(part)
        block.add_entity(part)
    space.add_blockref("PLATE", (20, -5), dxfattribs={"rotation": 30})


@pytest.mark.parametrize("change", [two_arcs, in_a_block])
def test_drawings_that_are_written_otherwise_pass(marker, files, tmp_path, change):
    check = check_of(marker, tmp_path, ".dxf", drawn(change)(files[".dxf"]))
    assert check.passed, check.findings
    assert check.largest < 1e-6


def test_blocks_that_are_stretched_are_refused(marker, files, tmp_path):
    def stretched(document, space):
        in_a_block(document, space)
        space[0].dxf.xscale = 1.01

    with pytest.raises(InputError):
        check_of(marker, tmp_path, ".dxf", drawn(stretched)(files[".dxf"]))
