"""Files that are dropped on the page."""

import json

import numpy as np
import pytest
from sentences import sentence

import markergen as mg
from markergen.model.body import Plate
from markergen.model.body_json import rig_to_json, to_json
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.rig import Rig
from markergen.read.spec_file import spec_from_mapping, spec_of
from markergen.studio.opening import opened_file, options_of
from markergen.units import parse_length

SQUARE = (
    b'<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm"><rect width="200mm" height="100mm"/></svg>'
)
CAMERA = b"width: 640\nheight: 480\nfx: 800\nfy: 810\ncx: 320\ncy: 240\n"
GEO = b'{"type": "Polygon", "coordinates": [[[0, 0], [200, 0], [200, 100], [0, 100], [0, 0]]]}'

COVARIANCE = [[4.0, 0.0, 0.0, 0.0], [0.0, 4.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
HOLES = {"keep_out": ["circle:3mm@60mm,-20mm"], "mount": ["4xM3c@180mm", "4.5mm:0mm,-85mm"], "dowel": "2x4mm@170mm"}
QUALITY = {"image_noise": "blur_px=1.5", "camera_covariance": [[4.0, 4.0, 2.0, 2.0]], "scale_sigma": 0.001}
LONG = [
    HOLES,
    {},
    {"tag": "aruco:DICT_4X4_50:7", "seed": 5, "objective": "rotation"},
    {"relief": "10mm"},
    {"noise_model": "image", "print_sigma": "0.1mm", "clearance": "4mm"},
]


@pytest.mark.parametrize(
    "more", [{**HOLES, **QUALITY, "dot": "0mm"}, *(pytest.param(each, marks=pytest.mark.long) for each in LONG)]
)
def test_a_marker_gives_the_options_that_make_it_again(more):
    marker = mg.design(
        **{"n": 4, "radius": "120mm", "dot": "15mm", "restarts": 1, "poses": "cone:count=3", **more}
    ).marker
    options = opened_file("marker.json", to_json(marker))["options"]
    assert "n" not in options
    # A field's numbers without a unit are mm.
    assert all(text.count("mm") > 1 for text in options.get("mount", [])[1:])
    again = mg.design(**options).marker
    for name in ("image_noise", "camera_covariance", "scale_sigma"):
        assert getattr(spec_of(again), name) == getattr(spec_of(marker), name), name
    for name in ("control_points", "boundary", "keep_outs", "tag", "substrate", "clearance"):
        assert getattr(again, name) == getattr(marker, name), name
    # And once more: the state that is opened is the state that was saved.
    assert to_json(mg.design(**options_of(again)).marker) == to_json(again)


def test_a_marker_of_unknown_origin_is_opened_too(pentagon):
    options = opened_file("any.json", to_json(pentagon))["options"]
    assert options["points"] == pentagon.xyz[:, :2].tolist()
    assert all(options[name].endswith("mm") for name in ("radius", "dot"))
    lengths = [parse_length(options[name]) for name in ("radius", "dot")]
    assert lengths == [pentagon.boundary.radius, pentagon.dot_diameter]


def test_a_marker_that_was_measured_is_opened_as_designed_and_says_so(pentagon):
    printed = mg.rescale(pentagon, measured_x="198mm", measured_y="198mm").marker
    results = opened_file("measured.json", to_json(printed))
    assert np.allclose(results["options"]["points"], pentagon.xyz[:, :2], atol=1e-12)
    assert "measured on a print" in results["note"]
    assert "note" not in opened_file("marker.json", to_json(pentagon))


def test_every_kind_of_file_is_known():
    assert opened_file("spec.toml", b'title = "Mine"\nn = 6\nkeep_outs = ["circle:3mm@40mm,0mm"]\n') == {
        "title": "Mine",
        "options": {"n": 6, "keep_out": ["circle:3mm@40mm,0mm"]},
    }
    for name, data in (("plate.svg", SQUARE), ("plate.geojson", GEO), ("plate.json", GEO)):
        drawn = opened_file(name, data, "mm" if data == GEO else None)
        boundary = drawn["boundary"]
        assert np.abs(drawn["center"]) == pytest.approx([0.1, 0.05])
        room = spec_from_mapping({"boundary": boundary}).boundary
        assert isinstance(room, Boundary)
        assert room.area == pytest.approx(0.02)
    camera = opened_file("camera.yaml", CAMERA)["camera"]
    assert spec_from_mapping({"camera": camera}).camera.fy == 810
    assert opened_file("camera.yaml", CAMERA)["camera_covariance"] is None
    reference = CAMERA + b"camera_parameters: [fx, fy, cx, cy]\ncamera_covariance: " + str(COVARIANCE).encode()
    taken = opened_file("camera.yaml", reference)
    assert (taken["camera"], taken["camera_covariance"]) == (camera, COVARIANCE)
    assert opened_file("dots.csv", b"x_mm,y_mm\n0,50\n50,0\n-50,0\n0,-50\n")["points"][0] == [0, 0.05]
    poses = opened_file("p.csv", b"tx,ty,tz,rx,ry,rz\n0,0,1,3.14159,0,0\n")["poses"]
    assert len(spec_from_mapping({"poses": poses}).poses) == 1


def test_a_drawing_is_a_room_about_its_center_and_a_keep_out_about_another():
    drawn = opened_file("plate.svg", SQUARE, origin=(0.01, -0.02))
    room, keep_out = (spec_from_mapping({"boundary": drawn[name]}).boundary for name in ("boundary", "keep_out"))
    assert room.center == pytest.approx((0, 0))
    assert np.subtract(keep_out.center, (-0.01, 0.02)) == pytest.approx(drawn["center"])
    assert drawn["words"] == sentence("rectangle of", "200 mm x 100 mm")


def test_a_drawing_is_asked_for_what_it_does_not_say():
    assert opened_file("plate.geojson", GEO)["asked"]["expected"] == sentence("a unit", "plate.geojson")
    assert opened_file("plate.json", GEO)["asked"]["found"].startswith("none: the drawing")
    assert opened_file("plate.geojson", GEO, "mm")["words"] == sentence("rectangle of", "200 mm x 100 mm")
    assert "m" in opened_file("plate.geojson", GEO, "parsec")["asked"]["remedy"]
    assert opened_file("plate.svg", SQUARE, None, "HOLES")["asked"]["expected"] == "a known layer in plate.svg"


def test_a_rig_is_opened_whole_and_names_no_files(pentagon):
    identity = tuple(map(tuple, np.eye(3).tolist()))
    rig = Rig((Plate("one", pentagon, identity, (0.0, 0.0, 0.0)),))
    content = json.loads(rig_to_json(rig))
    assert opened_file("rig.json", json.dumps(content).encode())["rig"] == content
    content["markers"][0] = {**content["markers"][0], "marker": None, "file": "/etc/passwd"}
    with pytest.raises(mg.InputError, match="its markers inside"):
        opened_file("rig.json", json.dumps(content).encode())


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("photo.exe", b"MZ", "a marker.json, rig.json, spec"),
        ("marker.json", b"{", "complete JSON in marker.json"),
        ("marker.json", b'{"control_points": []}', "marker.json"),
        ("marker.json", b"", "marker.json"),
        ("/home/me/plate.svg", b"<svg", "in plate.svg"),
        ("..\\..\\plate.dxf", b"nonsense", "plate.dxf"),
        ("spec.toml", b"n = ", "TOML in spec.toml"),
        ("spec.toml", b'camera = "camera.yaml"', "--camera without a file"),
        ("camera.yaml", b"fx: 1", "camera.yaml"),
        ("poses.csv", b"tx,ty\n1,2\n", "poses.csv"),
        ("", b"\0", "file"),
    ],
)
def test_what_cannot_be_used_is_told_by_the_name_it_was_given(name, data, message, tmp_path):
    with pytest.raises(mg.InputError) as caught:
        opened_file(name, data)
    line = str(caught.value)
    assert message in line
    assert "tmp" not in line
    assert "\n" not in line


def test_what_inspect_shows_is_in_the_note(tmp_path):
    path = tmp_path / "camera.yaml"
    Camera(640, 480, 800.0, 800.0, 320.0, 240.0).save(path)
    note = opened_file("camera.yaml", path.read_bytes() + b"gamma_table: 3\n")["note"]
    assert "image 640 x 480 px" in note
    assert note.endswith("not used of camera.yaml: gamma_table")
    board = b"(kicad_pcb (gr_rect (start 0 0) (end 50 20) (layer Edge.Cuts)))"
    assert "size 50 mm x 20 mm" in opened_file("board.kicad_pcb", board)["note"]
    poses = opened_file("poses.csv", b"tx,ty,tz,qx,qy,qz,qw\n0,0,0.5,0,0,0,1\n")
    assert "look at the marker's front" in poses["note"]


@pytest.mark.parametrize("name", ["..", ".", "a/..", "", "  ", "...", "\\..\\"])
def test_names_that_are_folders(name):
    with pytest.raises(mg.InputError, match="'file'"):
        opened_file(name, b"nothing")
