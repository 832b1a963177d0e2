import inspect
import io
import json
import logging
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from pydantic import TypeAdapter
from sentences import pattern, sentence

from markergen.api.design import design, request_of, with_page
from markergen.api.export import export
from markergen.api.rescale import rescale
from markergen.cli import main
from markergen.errors import InputError, OutputError
from markergen.model.body_json import read_marker
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.marker import Marker
from markergen.model.poses import named_poses
from markergen.model.shape_file import BoundaryFile
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize import certificate
from markergen.optimize.design import design as find
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.search import search
from markergen.read.poses import poses_from

QUICK = {"n": 4, "radius": "100mm", "dot": "20mm", "restarts": 1, "poses": "cone:count=8"}


@pytest.fixture(scope="module")
def quick():
    return design(**QUICK)


def test_it_is_what_the_command_designs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for folder in ("lib", "cli"):
        Path(folder).mkdir()
    made = design(**QUICK, output="lib/marker.pdf", paper="A3", seed=1)
    phrase = [f"--{name}={value}" for name, value in QUICK.items()]
    assert main(["design", *phrase, "--seed", "1", "--paper", "A3", "-o", "cli/marker.pdf", "--details"]) == 0
    assert Path("lib/marker.json").read_bytes() == Path("cli/marker.json").read_bytes()
    assert Path("lib/marker.pdf").read_bytes() == Path("cli/marker.pdf").read_bytes()
    printed = capsys.readouterr().out

    def told(text):
        return [line for line in text.splitlines() if not line.startswith(("found in", "wrote"))]

    assert told(printed)[: len(told(str(made)))] == told(str(made))
    assert [file.path.name for file in made.written] == ["marker.pdf", "marker.json"]
    assert str(made.written[0]) in printed.replace("cli/", "lib/")


def test_objects_paths_and_texts_are_the_same(tmp_path, quick):
    camera = Camera(640, 480, 800.0, 800.0, 320.0, 240.0)
    (tmp_path / "camera.json").write_text(json.dumps(camera.as_dict()))
    same = [
        {"camera": camera},
        {"camera": tmp_path / "camera.json"},
        {"camera": str(tmp_path / "camera.json")},
        {"camera": camera.as_dict()},
        {"camera": io.StringIO(json.dumps(camera.as_dict()))},
        {
            "camera": {
                "distortion_model": "plumb_bob",
                "D": [],
                "K": camera.matrix.ravel().tolist(),
                "width": 640,
                "height": 480,
            }
        },
        {"radius": 0.1, "n": np.int64(4), "dot": np.float64(0.02)},
        {"radius": None, "boundary": Circle(0.1)},
        {"radius": None, "boundary": "circle:100mm"},
    ]
    for more in same:
        assert design(**{**QUICK, **more}).marker == quick.marker


def test_a_camera_may_be_whatever_is_loaded(quick):
    ours = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}
    matrix = [[800, 0, 320], [0, 800, 240], [0, 0, 1]]
    theirs = {
        "image_width": 640, "image_height": 480, "camera_matrix": matrix, "distortion_coefficients": [0, 0, 0, 0, 0],
    }  # fmt: skip
    for camera in (ours, theirs, io.StringIO(json.dumps(ours))):
        assert design(**QUICK, camera=camera).setting.camera.matrix.tolist() == matrix


def test_it_is_the_engines_design(quick):
    spec = Spec(n=4, boundary=Circle(0.1), dot=0.02, restarts=1, poses="cone:count=8")
    assert quick.marker == find(spec).marker


def test_poses_may_be_a_distribution(quick):
    result = design(**{**QUICK, "poses": named_poses("cone:count=8")})
    # Recorded rotations are rounded in the last digits; a minimum flat to 1e-14 leaves places open to its root, 1e-7.
    assert result.value == pytest.approx(quick.value, rel=1e-10)
    np.testing.assert_allclose(result.marker.xyz, quick.marker.xyz, atol=1e-7)


def test_results_are_short_and_shown(quick):
    assert len(repr(quick)) < 2000
    assert repr(quick).startswith("Design(")
    assert "<table>" in quick._repr_html_()
    assert "regular 4-gon" in str(quick)
    frame = quick.to_frame()
    assert list(frame.layout) == ["design", "ngon", "square", "random"]
    assert frame.rotation_deg[0] == pytest.approx(quick.criteria["design"]["rotation_deg"])
    ax = quick.plot()
    assert len(ax.patches) >= 4
    assert quick.plot(ax) is ax


def test_a_family_and_a_trace_are_written_together(tmp_path):
    outputs, trace = [tmp_path / "m.svg", tmp_path / "m.csv"], tmp_path / "t.csv"
    actual = design(**QUICK, tag="aruco:DICT_4X4_50", ids="3,5", output=outputs, trace=trace, paper="A1")
    assert [marker.tag.id for marker in actual.markers] == [3, 5]
    names = ["m.svg", "m-3.csv", "m-3.json", "m-5.csv", "m-5.json", "t.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert sorted(file.path.name for file in actual.written) == sorted(names)
    assert read_marker(tmp_path / "m-5.json") == actual.markers[1]
    assert trace.read_text().count("\n") == len(actual.trace) + 1


def test_a_paper_without_a_room_is_the_room():
    options = {**QUICK, "paper": "A5"}
    assert request_of(options).spec.boundary == Circle(0.1)
    del options["radius"]
    assert request_of(options).spec == request_of(with_page(options, {})).spec
    assert request_of(options).spec.boundary.radius < 0.13
    assert request_of(with_page({"n": 4}, {"LANG": "en_US.UTF-8"})).choices.sheet.paper == "letter"


def test_a_template_gives_way_to_what_is_given(tmp_path):
    spec = tmp_path / "my.toml"
    spec.write_text('n = 4\nradius = "100mm"\ndot = "20mm"\nrestarts = 1\nposes = "cone:count=8"\npaper = "A3"\n')
    one = design(template=spec, output=tmp_path / "one.svg")
    assert 'width="297mm"' in (tmp_path / "one.svg").read_text()[:600]
    assert one.marker.provenance["spec"]["n"] == 4
    two = design(template=str(spec), n=5, boundary="rect:200mmx200mm", paper="A2", output=tmp_path / "two.svg")
    assert len(two.marker) == 5
    assert two.marker.boundary.radius == pytest.approx(0.1 * 2**0.5)
    assert 'width="420mm"' in (tmp_path / "two.svg").read_text()[:600]


@pytest.mark.parametrize(
    ("options", "phrase"),
    [
        ({"rdius": 5}, "rdius=5 (no such option: did you mean 'radius'?)"),
        ({"n": "five", "radius": [1]}, "n='five' (a whole number, or 'auto'), radius=[1] (a length"),
        ({"n": True}, "n=True (a whole number, or 'auto')"),
        ({"camera": 5}, "camera=5 (a camera, a path, or a dictionary)"),
        ({"camera": {"width": 640}}, "camera.height: missing"),
        ({"poses": object}, "poses"),
        ({"boundary": 3}, "boundary=3 (an outline"),
        ({"radius": 0.1, "boundary": "rect:0.1x0.1"}, "a radius or a boundary"),
        ({"layer": "A"}, "--layer and --origin with a drawing"),
        ({"output": 3}, "output=3 (a path, or a list of paths)"),
        ({"output": "marker.docx"}, "a known output suffix, found '.docx'"),
        ({"ids": "0-3"}, "a tag for the ids"),
        ({"template": "none-such"}, "a known template"),
        ({"template": "desk-a5"}, "found 'desk-a5'; did you mean 'desk-a4'"),
        ({"noise_model": "imgae"}, "found 'imgae'; did you mean 'image'"),
        ({"poses": "conee"}, "found 'conee'; did you mean 'cone'"),
        ({"n": 3}, "at least 4 control points"),
        ({"trace": "t.txt"}, "a trace in one of"),
        ({"output": "marker"}, "a known output suffix, found none in 'marker'; known: .3mf"),
        ({"output": "."}, "a known output suffix, found the folder '.'; name a file in it, such as marker.json"),
        ({"output": ["m.svg", "m.svg"]}, "each output path once, found m.svg twice; give each a different name"),
        ({"progress": "yes"}, "a function for progress, found 'yes'"),
    ],
)
def test_bad_wishes(options, phrase, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        design(**options)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written_is_told_before_the_search(tmp_path):
    def never(*_):
        raise AssertionError("searched")

    with pytest.raises(OutputError, match=r"the folder .*none does"):
        design(**QUICK, output=tmp_path / "none" / "m.pdf", progress=never)
    camera = tmp_path / "m.json"
    camera.write_text(json.dumps(Camera(640, 480, 800, 800, 320, 240).as_dict()))
    with pytest.raises(OutputError, match=pattern("input overwritten")):
        design(**QUICK, camera=camera, output=tmp_path / "m.svg", progress=never)


@pytest.mark.parametrize(
    ("line", "low"),
    [
        ('boundary = "plate.dxf"', -200),
        ('outline = "plate.dxf"', -200),
        ('keep_out = "plate.dxf"', 100),
        ('keep_out = ["plate.dxf#0"]', 100),
    ],
)
def test_a_drawing_that_a_shipped_templates_is_not_written_over(line, low, tmp_path, monkeypatch):
    import ezdxf

    monkeypatch.chdir(tmp_path)
    drawing = ezdxf.new()
    drawing.modelspace().add_lwpolyline([(low, low), (200, low), (200, 200), (low, 200)], close=True)
    drawing.header["$INSUNITS"] = 4
    drawing.saveas("plate.dxf")
    before = Path("plate.dxf").read_bytes()
    Path("my.toml").write_text(line)
    with pytest.raises(OutputError, match=pattern("input overwritten")):
        design(template="my.toml", output="plate.dxf")
    assert Path("plate.dxf").read_bytes() == before


def test_nothing_is_printed_and_the_log_is_silent_until_asked(capsys, caplog):
    stages = []
    with caplog.at_level(logging.INFO, logger="markergen"):
        actual = design(**{**QUICK, "dot": "1mm"}, progress=lambda stage, done, total: stages.append(stage))
    assert capsys.readouterr() == ("", "")
    assert stages
    assert actual.warnings
    assert [record.message for record in caplog.records if record.levelno == logging.WARNING] == list(actual.warnings)


def test_inverted_colors_make_light_dots_that_every_sheet_keeps_and_solids_refuse(tmp_path, caplog):
    actual = design(**QUICK, colors="inverted", output=[tmp_path / "m.svg", tmp_path / "m.json", tmp_path / "m.csv"])
    assert actual.marker.light
    assert Marker.load(tmp_path / "m.json") == actual.marker
    assert not any("light" in warning for warning in actual.warnings)
    caplog.clear()
    export(tmp_path / "m.json", tmp_path / "again.svg")
    assert (tmp_path / "again.svg").read_bytes() == (tmp_path / "m.svg").read_bytes()
    export(tmp_path / "m.json", tmp_path / "black.svg", colors="black")
    assert [record.message.partition(":")[0] for record in caplog.records] == [
        sentence("other colors", "light", "dark"),
    ]
    with pytest.raises(InputError, match=r"dots for .*m\.step, found --colors inverted; light"):
        design(**QUICK, colors="#eeeeee,#003366", output=tmp_path / "m.step")


def test_help_shows_every_keyword():
    printed = inspect.signature(design).parameters
    assert printed["n"].default == 5
    assert printed["corner_radius"].default == "0mm"
    assert printed["progress"].kind is inspect.Parameter.KEYWORD_ONLY


def test_another_marker_is_not_replaced_silently(tmp_path):
    path = tmp_path / "marker.json"
    design(**QUICK, output=path)
    assert design(**QUICK, output=path).written[0].notes == ()
    (written,) = design(**QUICK | {"n": 6}, output=path).written
    assert "It replaces another" in str(written)
    measured = rescale(path, measured_x="199mm", nominal_x="200mm", output=path).marker
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"measurements in .*; name another -o"):
        design(**QUICK, output=tmp_path / "marker.svg")
    assert measured == Marker.load(path)
    assert path.read_bytes() == before
    assert not (tmp_path / "marker.svg").exists()


def test_gap_between_dots_is_not_that_around_inlays(tmp_path):
    design(**QUICK, gap="5mm", output=tmp_path / "marker.stl")
    export(tmp_path / "marker.json", tmp_path / "again.stl")
    assert (tmp_path / "marker.stl").read_bytes() == (tmp_path / "again.stl").read_bytes()


@pytest.mark.parametrize(
    ("room", "n", "objective", "count", "starts", "options"),
    [
        ("rect:150mmx60mm", 7, "pose", 20, {"restarts": 2}, {}),
        pytest.param("circle:50mm", 5, "pose", 60, {}, {}, marks=pytest.mark.long),
        ("rect:100mmx80mm", 5, "rotation", 20, {"restarts": 2}, {"dot": "20mm", "gap": "9mm"}),
    ],
    ids=["for the images", "by smaller dots", "asked for"],
)
def test_no_layout_breaks_what_the_results_claim(room, n, objective, count, starts, options, tmp_path, monkeypatch):
    """Reads value, bounds and constraints from the JSON alone, and looks for layouts that keep them and are better."""
    monkeypatch.setattr(certificate, "ROUNDS", 20)
    poses = f"cone:distance=0.6..1.5,tilt=0..70,azimuth=-180..180,count={count}"
    more = {"boundary": room, "objective": objective, "poses": poses, **starts, **options}
    design(n=n, json=tmp_path / "design.json", **more)
    claims = json.loads((tmp_path / "design.json").read_text())
    kept = claims["constraints"]
    assert kept["gap_reason"] == ("asked" if options else "images")
    assert kept["gap_m"] > kept["clearance_m"]
    outline = TypeAdapter(BoundaryFile).validate_python(kept["boundary"]).build()
    setting = Setting(outline, PAPER_CAMERA, poses_from(claims["poses"]["name"]))
    assert len(setting.poses) == claims["poses"]["count"]
    criterion = OBJECTIVES[claims["objective"]](setting)

    def least(gap):
        region, rng = FeasibleRegion(outline, claims["dots"]["diameter_m"], kept["clearance_m"], gap), default_rng(n)
        layouts = region.sample(400, n, rng)
        best = search(criterion, region, n, rng, 2)
        assert region.holds(layouts).sum() > 100
        return min(criterion(layouts[region.holds(layouts)]).min(), best.value)

    apart, close = least(kept["gap_m"]), least(0.0)
    assert claims["lower_bound"] <= apart
    assert claims["value"] <= apart * 1.001
    assert kept["lower_bound_without_gap"] <= close
    if not options:
        low, high = kept["gap_costs"]
        assert low - 1e-6 <= 1 - close / claims["value"] <= high
