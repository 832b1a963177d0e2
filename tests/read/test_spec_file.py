import json

import jsonschema
import numpy as np
import pytest
from sentences import pattern

from docs.generate import spec_schema
from markergen.errors import InputError
from markergen.geometry.contour import Contour, circle
from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import named_poses
from markergen.model.recorded_poses import RecordedPoses
from markergen.model.spec import AUTO, ImageNoise, Spec
from markergen.model.substrate import MOUNT, Hole, Substrate, parse_dowel, parse_mount
from markergen.options import declared
from markergen.options.declarations import OUTSIDE_SPEC, DesignKeywords
from markergen.read.spec_file import OPTIONS, spec_from_mapping
from markergen.read.templates import read_template, shipped_templates

CAMERA = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}


def test_templates_are_ready_to_use():
    assert len(shipped_templates()) == 14
    for name in shipped_templates():
        values = read_template(name)
        assert values["title"]
        if "shape" not in values:  # Rigs are those of tests/api/test_templates.py.
            spec = spec_from_mapping(values, name)
            assert spec.n >= 4 or spec.n == AUTO


def test_the_papers_template_is_the_default():
    assert spec_from_mapping(read_template("paper-disk")) == Spec()


def test_a_byte_order_mark_is_no_part_of_a_template(tmp_path):
    path = tmp_path / "my.toml"
    path.write_bytes(b"\xef\xbb\xbfn = 4\r\n")
    assert read_template(str(path)) == {"n": 4}


def test_what_a_marker_carries_gives_its_spec_back():
    spec = Spec(n=7, boundary=Circle(0.2), dot=0.02, objective="condition", coordinates="metric", poses="paper-roll")
    assert spec_from_mapping(spec.as_dict()) == spec


def test_a_lens_is_part_of_the_camera(tmp_path):
    camera = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.28, 0.07, 1e-3, 0.0)))
    path = tmp_path / "mine.toml"
    path.write_text(
        "[camera]\n"
        + "".join(f"{key} = {value}\n" for key, value in CAMERA.items())
        + 'distortion = {model = "radtan", coefficients = [-0.28, 0.07, 1e-3, 0]}\n'
    )
    spec = spec_from_mapping(read_template(str(path)))
    assert spec.camera == camera
    # As a marker.json carries it.
    assert spec_from_mapping(json.loads(json.dumps(spec.as_dict()))) == spec


def test_shapes_and_keep_outs_are_part_of_a_spec(shape, tmp_path):
    spec = Spec(boundary=shape, keep_outs=(Circle(0.01, (0.1, 0.0)), Circle(0.02)))
    assert spec_from_mapping(json.loads(json.dumps(spec.as_dict()))) == spec
    assert spec.hash != Spec(boundary=shape).hash
    assert "keep_outs" not in Spec(boundary=shape).as_dict()


def test_arcs_are_part_of_a_spec():
    ring = polygon_from([circle(0.15), circle(0.03)])
    slot = polygon_from([Contour(((0.05, 0), (0.09, 0), (0.09, 0.01), (0.05, 0.01)), (0, 1, 0, 1))], "file")
    spec = Spec(boundary=ring, keep_outs=(slot,), substrate=Substrate(outline=polygon_from([circle(0.2)])))
    again = spec_from_mapping(json.loads(json.dumps(spec.as_dict())))
    assert again == spec
    assert again.hash == spec.hash != Spec(boundary=ring, substrate=spec.substrate).hash
    straight = {"kind": "polygon", "outlines": [[[0.0, 0.0], [0.1, 0.0]]]}
    with pytest.raises(InputError, match=r"boundary\.outlines\[0\]: List .* 3 items"):
        spec_from_mapping({"boundary": straight})
    for bulges, phrase in (([[1.0]], "bulges"), ([[2.0, 0.0]], r"boundary\.bulges\[0\]\[0\]"), ([], "boundary.bulges")):
        with pytest.raises(InputError, match=phrase):
            spec_from_mapping({"boundary": {**straight, "bulges": bulges}})


def test_an_edge_around_an_outline_is_refused_but_in_a_marker_that_has_one(shapes):
    values = {"boundary": shapes["L"].as_dict(), "substrate": {"thickness": 0.003, "edge": 0.005}}
    with pytest.raises(InputError, match=pattern("edge on polygon") + ", found edge=5 mm"):
        spec_from_mapping(values)
    assert spec_from_mapping(values, stored=True).substrate.edge is None
    rectangle = {**values, "boundary": shapes["rectangle"].as_dict()}
    assert spec_from_mapping(rectangle, stored=True).substrate.edge == 0.005


def test_a_design_for_all_errors_counts_the_covariance_in_the_file_of_the_camera(tmp_path):
    path = tmp_path / "camera.toml"
    PAPER_CAMERA.save(path, [2.0, 2, 1.5, 1.5])
    expected = tuple(map(tuple, np.diag([4.0, 4, 2.25, 2.25]).tolist()))
    for values in ({"n": "auto"}, {"target": "0.1deg@1.5m"}):
        assert spec_from_mapping({**values, "camera": str(path)}).camera_covariance == expected
        assert spec_from_mapping({**values, "camera": path, "camera_covariance": "none"}).camera_covariance is None
    # To others it makes no difference.
    assert spec_from_mapping({"n": 5, "camera": str(path)}).camera_covariance is None
    assert spec_from_mapping({"n": 5, "camera_covariance": str(path)}).camera_covariance == expected


def test_shapes_in_a_file_have_lengths_with_units(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'boundary = {kind = "polygon", outlines = [[["0mm", 0], ["4in", 0], [0.1016, "80mm"], [0, 0.08]]]}\n'
        'keep_outs = ["circle:3mm@40mm,20mm", {radius = "2mm", center = ["60mm", 0.02]}, "rect:4mmx4mm@20mm,20mm"]\n'
    )
    spec = spec_from_mapping(read_template(str(path)))
    assert spec.boundary == Polygon((((0, 0), (0.1016, 0), (0.1016, 0.08), (0, 0.08)),))
    assert spec.keep_outs[:2] == (Circle(0.003, (0.04, 0.02)), Circle(0.002, (0.06, 0.02)))
    assert spec.keep_outs[2].area == pytest.approx(16e-6, rel=1e-9)
    assert spec_from_mapping({"boundary": "rect:0.2x0.1"}).boundary.area == pytest.approx(0.02, rel=1e-12)


def test_lengths_may_carry_units():
    spec = spec_from_mapping({"radius": "80mm", "dot": "1in", "clearance": 0.002})
    assert (spec.boundary.radius, spec.dot, spec.clearance) == (0.08, 0.0254, 0.002)
    assert spec.camera == PAPER_CAMERA


def test_all_errors_are_listed_with_their_paths():
    with pytest.raises(InputError) as caught:
        spec_from_mapping({"n": "many", "radius": "wide", "camera": {"width": 640}, "color": "red"}, "my.toml")
    for phrase in (
        "my.toml",
        "n: Input should be a valid integer (got 'many')",
        "radius: write a number and one of m, ",
        "camera.height: missing",
        "color: unknown key, did you mean 'colors'? (got 'red')",
    ):
        assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", [[1], "x", None, 3])
def test_what_is_no_table_is_refused(values):
    with pytest.raises(InputError, match="a table of"):
        spec_from_mapping(values, "the file")


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"n": True}, "n: Input should be a valid integer (got True)"),
        ({"n": 5.0}, "n: Input should be a valid integer (got 5.0)"),
        ({"n": None}, "n: Input should be a valid integer (got None)"),
        ({"n": 16**6000}, "n: Input should be less than 9223372036854775808 (got an endless number)"),
        ({"seed": "3"}, "seed: Input should be a valid integer (got '3')"),
        ({"seed": 16**6000}, "seed: Input should be less than 9223372036854775808 (got an endless number)"),
        ({"radius": True}, "radius: write a number"),
        ({"dot": "inf"}, "dot: write a number such as 0.15 or 150mm, or auto (got 'inf')"),
        ({"objective": 3}, "objective: Input should be a valid string (got 3)"),
        (
            {"boundary": {"kind": "square", "radius": 1}},
            "boundary: Input should be a table with kind circle or polygon (got {'kind': 'square'",
        ),
        ({"boundary": {"kind": "circle"}}, "boundary.radius: missing"),
        ({"boundary": "flange.dxf"}, "expected a readable outline at flange.dxf, found No such file or directory"),
        ({"boundary": "rect:0.2"}, "boundary: expected a width and a height"),
        ({"boundary": {"kind": "polygon", "outlines": [[["a", 0], [1, 0], [0, 1]]]}}, "boundary.outlines[0][0][0]: "),
        ({"boundary": {"kind": "polygon", "outlines": [[[0, 0], [1, 1], [1, 0], [0, 1]]]}}, "at (500 mm, 500 mm)"),
        ({"boundary": {"kind": "polygon", "outlines": json.loads("[" * 300 + "]" * 300)}}, "boundary.outlines[0]"),
        ({"keep_outs": [{"radius": 0}]}, "keep_outs[0].radius: Input should be greater than 0 (got 0)"),
        ({"keep_outs": ["circle:1"]}, "expected keep-outs that leave room in the boundary"),
        ({"radius": 0.1, "boundary": {"radius": 0.1}}, "boundary: give either radius or [boundary], not both"),
        ({"camera": CAMERA | {"width": 10**400}}, "camera.width: Input should be less than or equal to 20000"),
        ({"camera": CAMERA | {"height": 0}}, "camera.height: Input should be greater than or equal to 1"),
        ({"camera": CAMERA | {"cx": 10**400}}, "camera.cx: Input should be a valid number"),
        ({"camera": CAMERA | {"fx": float("nan")}}, "camera.fx: Input should be a finite number"),
        ({"camera": CAMERA | {"fx": 0.0}}, "finite positive focal lengths"),
        ({"camera": CAMERA | {"distortion": {"model": "radtan"}}}, "camera.distortion.coefficients: missing"),
        (
            {"camera": CAMERA | {"distortion": {"model": "omni", "coefficients": []}}},
            "camera.distortion: expected a known distortion model, found 'omni'; known: equidistant, none, radtan",
        ),
        (
            {"camera": CAMERA | {"distortion": {"model": "radtan", "coefficients": [0.1]}}},
            "camera.distortion: expected 4 or 5 coefficients of the distortion model 'radtan', found 1",
        ),
    ],
)
def test_each_unfit_value_is_named(values, phrase):
    with pytest.raises(InputError) as caught:
        spec_from_mapping(values)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


def test_whole_numbers_serve_as_lengths_and_pixels():
    spec = spec_from_mapping({"boundary": {"radius": 1}, "dot": 0, "camera": CAMERA | {"fx": 800}})
    assert (spec.boundary, spec.dot, spec.camera) == (Circle(1.0), 0, PAPER_CAMERA)


def test_templates_from_files(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('n = 6\nradius = "60mm"\n')
    assert spec_from_mapping(read_template(str(path))).boundary.radius == 0.06
    path.write_text("n = = 6")
    with pytest.raises(InputError, match="TOML"):
        read_template(str(path))
    for endless in ("9" * 5000, "[" * 9_900):
        path.write_text(f"n = {endless}")
        with pytest.raises(InputError, match="endless number or"):
            read_template(str(path))
    for line, remedy in (
        ("radius = 0,15", 'write a point: radius = "0.15"'),
        ('camera = "C:\\Users\\me\\a.yaml" # mine', "single quotes: camera = 'C:\\Users\\me\\a.yaml'"),
        ("radius = 60mm", 'write quotes: radius = "60mm"'),
        ("n = 7", "correct it there"),
    ):
        path.write_text(f"n = 6\n{line}\n")
        with pytest.raises(InputError) as refused:
            read_template(str(path))
        assert remedy in refused.value.args[2]
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        read_template(str(path))
    with pytest.raises(InputError, match="No such file"):
        read_template(str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="conveyor, cube, desk-a4, desk-letter"):
        read_template("desk")


def test_dots_may_be_left_to_the_image():
    spec = spec_from_mapping({"dot": "auto", "image_noise": {"blur_px": 1.2, "contrast": 100}})
    assert (spec.dot, spec.noise_model) == ("auto", "image")
    assert spec.image_noise == ImageNoise(blur_px=1.2, noise_grey=2.0, contrast=100.0)
    assert spec_from_mapping(spec.as_dict()) == spec
    assert spec_from_mapping({"noise_model": "image", "dot": "30mm"}).dot == 0.03
    with pytest.raises(InputError, match=r"dot: write .* or auto"):
        spec_from_mapping({"dot": "automatic"})
    with pytest.raises(InputError, match=r"image_noise\.blur: unknown key"):
        spec_from_mapping({"image_noise": {"blur": 1.0}})


def test_a_print_error_is_a_length():
    spec = spec_from_mapping({"dot": "auto", "print_sigma": "0.1mm"})
    assert spec == Spec(dot="auto", print_sigma=1e-4)
    assert spec_from_mapping(json.loads(json.dumps(spec.as_dict()))) == spec
    with pytest.raises(InputError, match="print_sigma: write a number"):
        spec_from_mapping({"dot": "auto", "print_sigma": "little"})
    for exact in (0, "0mm"):
        with pytest.raises(InputError, match=r"a print error above 0.*leave it out for 0\.1mm"):
            spec_from_mapping({"dot": "auto", "print_sigma": exact})


def test_a_spec_that_is_too_large_is_refused_at_once(tmp_path):
    path = tmp_path / "large.toml"
    path.write_text(".".join(["a"] * 50_000) + " = 1")
    with pytest.raises(InputError, match="at most 10 kB"):
        read_template(str(path))


def test_a_tag_and_its_size_with_a_unit():
    spec = spec_from_mapping({"tag": "apriltag:36h11:3", "tag_side": "60mm"})
    assert spec == Spec(tag="apriltag:36h11:3", tag_side=0.06)
    assert spec_from_mapping(spec.as_dict(), stored=True) == spec
    with pytest.raises(InputError, match=pattern("no string", "tag")):
        spec_from_mapping({"tag": 3})


def test_a_plate_with_units_and_holes_as_on_the_command_line():
    table = {
        "thickness": "4mm",
        "chamfer": 0.0005,
        "outline": "rect:400mmx400mm",
        "mount": "4xM3c@120mm",
        "dowel": ["2x4mm@130mm"],
        "holes": [{"x": "10mm", "y": 0, "diameter": "3.4mm", "name": "4"}],
    }
    spec = spec_from_mapping({"substrate": table})
    holes = (Hole(0.01, 0.0, 0.0034, name="4"), *parse_mount("4xM3c@120mm"), *parse_dowel("2x4mm@130mm"))
    assert spec.substrate == Substrate(0.004, chamfer=0.0005, outline=spec.substrate.outline, holes=holes)
    assert spec.substrate.outline.radius == pytest.approx(0.2 * 2**0.5)
    stored = json.loads(json.dumps(spec.as_dict()))
    assert spec_from_mapping(stored, stored=True) == spec
    assert spec_from_mapping(stored).hash == spec.hash


@pytest.mark.parametrize(
    ("table", "phrase"),
    [
        (3, "substrate: should be a table of values"),
        ({"thickness": "thin"}, "substrate.thickness: Input should be a valid number (got 'thin')"),
        ({"thickness": "4"}, "substrate.thickness: Input should be less than or equal to 1 (got 4.0)"),
        ({"mount": "4xM7@0.1"}, "substrate: mount: expected a metric screw or a diameter, found 'M7'"),
        ({"mount": 4}, "substrate: mount: expected mounting holes, found '4'"),
        ({"dowel": [["2x4mm@0.1"]]}, "substrate: dowel: expected dowel holes"),
        ({"holes": 4}, "substrate.holes: Input should be a valid list"),
        ({"holes": [4], "mount": "4xM3@0.1"}, "substrate.holes[0]: should be a table of values"),
        ({"outline": "plate.dxf"}, "expected a readable outline at plate.dxf, found No such file or directory"),
        ({"color": "white"}, "substrate.color: unknown key"),
    ],
)
def test_what_is_wrong_with_a_plate_is_named(table, phrase):
    with pytest.raises(InputError) as caught:
        spec_from_mapping({"substrate": table})
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
    # Not the whole table around it.
    assert "(got {" not in str(caught.value)


def test_the_only_error_of_what_was_typed_is_that_of_its_parser():
    mount = {"mount": ["40mm"]}
    with pytest.raises(InputError) as caught:
        spec_from_mapping(mount, OPTIONS)
    assert caught.value.args == ("mounting holes", "'40mm'", MOUNT)
    with pytest.raises(InputError, match=f"a valid spec in {OPTIONS}"):
        spec_from_mapping({**mount, "seed": "x"}, OPTIONS)


def test_what_is_stored_names_no_files():
    with pytest.raises(InputError, match=r"boundary: write rect:0\.2x0\.1, circle:0\.15, or"):
        spec_from_mapping({"boundary": "flange.dxf"}, stored=True)


def test_a_file_has_the_options_of_a_design():
    options = {
        "keep_out": ["circle:3mm@40mm,-20mm"], "tag": "aruco:DICT_4X4_50:7", "tag_size": "20mm", "thickness": "4mm",
        "mount": "4xM3@120mm", "paper": "A4", "ids": "0-3",
    }  # fmt: skip
    old = {
        "keep_outs": ["circle:3mm@40mm,-20mm"], "tag": "aruco:DICT_4X4_50:7", "tag_side": "20mm",
        "substrate": {"thickness": "4mm", "mount": ["4xM3@120mm"]},
    }  # fmt: skip
    assert spec_from_mapping(options) == spec_from_mapping(old)
    with pytest.raises(InputError, match=pattern("no string", "paper")):
        spec_from_mapping({"paper": 4})


def test_a_file_may_name_a_drawing_and_a_calibration(tmp_path):
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm" viewBox="0 0 200 100">'
    (tmp_path / "room.svg").write_text(f'{head}<rect x="10" y="10" width="180" height="80"/></svg>')
    (tmp_path / "camera.json").write_text(json.dumps(PAPER_CAMERA.as_dict() | {"fx": 900.0}))
    spec = spec_from_mapping(
        {"boundary": tmp_path / "room.svg", "camera": str(tmp_path / "camera.json"), "origin": "file"}
    )
    assert spec.boundary.area == pytest.approx(0.18 * 0.08)
    assert spec.boundary.center[0] == pytest.approx(0.1)
    assert spec.camera.fx == 900


def test_objects_serve_as_well_as_what_names_them():
    poses = named_poses("paper")
    spec = spec_from_mapping({"boundary": Circle(0.1), "camera": PAPER_CAMERA, "poses": poses})
    assert spec.boundary == Circle(0.1)
    assert isinstance(spec.poses, RecordedPoses)
    np.testing.assert_allclose(spec.poses.rotation, poses.rotation, atol=1e-15)


SCHEMA = spec_schema()


def fits(values):
    return jsonschema.Draft202012Validator(SCHEMA).is_valid(values)


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", [name for name in shipped_templates() if "shape" not in read_template(name)])
def test_the_templates_fit(name):
    assert fits(read_template(name))


def test_every_option_that_a_file_has_is_described():
    described = {name: table["description"] for name, table in SCHEMA["properties"].items() if "description" in table}
    for name, option in declared(DesignKeywords).items():
        assert (name in described) == (name not in OUTSIDE_SPEC)
        assert name in OUTSIDE_SPEC or option.help in described[name]


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"n": 6, "radius": "80mm", "camera": CAMERA, "keep_outs": ["circle:3mm"], "mount": "4xM3@120mm"},
        {"boundary": {"kind": "circle", "radius": "80mm"}, "clearance": 0.001, "survive": 1, "paper": "A4"},
        {"substrate": {"thickness": "4mm", "holes": [{"x": 0.05, "y": "0mm", "diameter": "3mm"}]}},
        {"image_noise": {"blur_px": 1.0}, "noise_model": "image", "dot": "auto", "title": "t", "tile": False},
    ],
)
def test_what_the_reader_takes_fits(values):
    spec_from_mapping(values)
    assert fits(values)


@pytest.mark.parametrize(
    "values",
    [
        {"dots": 6}, {"n": 6.5}, {"n": "6"}, {"radius": [1]}, {"camera": {**CAMERA, "f": 1.0}}, {"tile": "no"},
        {"substrate": {"color": "white"}}, {"keep_outs": [3]}, {"image_noise": {"blur": 1.0}}, {"output": "m.pdf"},
    ],
)  # fmt: skip
def test_what_the_reader_refuses_for_its_form_does_not_fit(values):
    with pytest.raises(InputError):
        spec_from_mapping(values)
    assert not fits(values)
