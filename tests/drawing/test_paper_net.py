"""Paper nets: folded, their dots are where the rig has them."""

import numpy as np
import pytest

import markergen as mg
from markergen.drawing.paper import SheetOptions
from markergen.drawing.paper_net import net_sheet, plate_edges, unfold
from markergen.drawing.scene import Disk
from markergen.errors import InputError
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.geometry.region import Region
from markergen.maths.rotation import exponential
from tests.support.rigs import rig_of

BODIES = [
    ("cube", {"edge": 0.06}),
    ("cube", {"edge": 0.06, "without": ["-z"]}),
    ("cube", {"edge": 0.06, "without": ["-y", "+z"]}),
    ("prism:3", {"edge": 0.1, "height": 0.05}),
    ("prism:6", {"edge": 0.06, "height": 0.08}),
    ("prism:5", {"edge": 0.07, "height": 0.05, "without": ["-z"]}),
]


def folded(net, rig):
    """Dots (n, 3) in mm of all faces after folding the net, in the frame of the first one folded."""
    edge_of = {fold: net.edges[fold[0]][fold[1]] for fold in net.folds}
    root = next(
        k for k, place in enumerate(net.places) if not place.translation.any() and (place.rotation == np.eye(2)).all()
    )
    motion = {root: (np.eye(3), np.zeros(3))}
    waiting = [root]
    while waiting:
        k = waiting.pop()
        for (face, _), edge in edge_of.items():
            if face != k or edge.meets not in edge_of or edge.meets[0] in motion:
                continue
            child = edge.meets[0]
            start, end = np.column_stack([net.places[k](np.array([edge.start, edge.end])), [0, 0]])
            normals = rig.markers[k].rotation_matrix[:, 2], rig.markers[child].rotation_matrix[:, 2]
            angle = np.arccos(np.clip(normals[0] @ normals[1], -1, 1))
            # Edges run counterclockwise, so a turn by a positive angle folds back what is beyond, print outside.
            R = exponential(angle * (end - start) / np.linalg.norm(end - start))
            rotation, offset = motion[k]
            motion[child] = rotation @ R, rotation @ (start - R @ start) + offset
            waiting.append(child)
    result = []
    for k, marker in enumerate(rig.markers):
        rotation, offset = motion[k]
        flat = np.column_stack([net.places[k](marker.marker.xyz[:, :2] * 1e3), np.zeros(len(marker.marker))])
        result.append(flat @ rotation.T + offset)
    return root, np.concatenate(result)


@pytest.mark.parametrize(("text", "measures"), BODIES, ids=str)
def test_the_folded_net_is_the_body(text, measures):
    rig = rig_of(text, **measures)
    root, points = folded(unfold(rig), rig)
    assert rig.markers[root].to_body(points / 1e3) == pytest.approx(rig.xyz, abs=1e-9)


@pytest.mark.parametrize(("text", "measures"), BODIES, ids=str)
def test_every_edge_is_folded_glued_or_open(text, measures):
    rig = rig_of(text, **measures)
    net = unfold(rig)
    meeting = sum(edge.meets is not None for ours in plate_edges(rig) for edge in ours) // 2
    assert len(net.folds) // 2 == len(rig.markers) - 1
    assert len(net.flaps) == meeting - len(net.folds) // 2
    pieces = [Region.polygon(item) for item in (*net.outlines, *(flap.corners for flap in net.flaps))]
    for k, piece in enumerate(pieces):
        assert all((piece & other).area < 1e-6 for other in pieces[k + 1 :])


def test_the_sheet_has_the_dots_at_true_size():
    rig = rig_of("cube", edge=0.06)
    sheet, net = net_sheet(rig, SheetOptions()), unfold(rig)
    shapes = [shape for layer in sheet.scene.layers for shape in layer.shapes]
    drawn = np.array([[shape.x, shape.y, shape.radius] for shape in shapes if isinstance(shape, Disk)])
    dots = np.concatenate([net.places[k](marker.marker.xyz[:, :2] * 1e3) for k, marker in enumerate(rig.markers)])
    assert drawn[:, :2] - drawn[0, :2] == pytest.approx(dots - dots[0], abs=1e-9)
    assert (drawn[:, 2] == 2.5).all()
    assert sheet.origins_mm[1] - np.array(sheet.origins_mm[0]) == pytest.approx(
        net.places[1].translation - net.places[0].translation
    )
    low, high = np.array(sheet.trim_mm).reshape(2, 2)
    for shape in shapes:
        assert (np.array(shape.path_points) >= low + 5).all()
        assert (np.array(shape.path_points) <= high - 5).all()
    assert sheet.paper.name == "A4-landscape"


@pytest.mark.parametrize("text", ["wall 2x2", "pair"])
def test_walls_and_pairs_have_no_net(text):
    with pytest.raises(InputError, match="a body for --net"):
        unfold(rig_of(text, plate=0.1))


def test_paper_that_is_too_small_is_refused(tmp_path):
    rig = rig_of("cube", edge=0.08)
    with pytest.raises(InputError, match="use --paper A3-landscape"):
        rig.save(tmp_path / "net.pdf", net=True, paper="A4")
    with pytest.raises(InputError, match=r"a rig\.json for --net"):
        mg.export(rig.markers[0].marker, tmp_path / "net.pdf", net=True)
    assert not list(tmp_path.iterdir())


def test_faces_are_on_sheets_with_their_names_and_neighbors():
    rig = rig_of("cube", edge=0.06)
    svg = EXPORTERS[".svg"](rig, ExportOptions()).data.decode()
    assert svg.count("plate-name") == 6
    assert svg.count("edge-") == 24
    assert svg.count('-dot-4"') + svg.count('"dot-4"') == 6
    assert EXPORTERS[".svg"](rig, ExportOptions(net=True)).data.decode().count("flap-name") == 7


@pytest.mark.long
def test_a_net_is_verified(tmp_path):
    rig = rig_of("prism:3", edge=0.1, height=0.05)
    rig.save(tmp_path / "net.svg", net=True)
    assert mg.verify(rig, tmp_path / "net.svg").passed
