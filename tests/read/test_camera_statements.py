"""What a camera file says in words is used, refused or reported: nothing changes a camera without a line."""

import json

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import load_camera, read_camera, sized
from markergen.read.cameras.statements import NAMES, REFUSED, doubts, folded_share, lens_name
from markergen.read.remarks import collected_remarks

FILE = "camera.json"
TABLE = {
    "image_width": 640, "image_height": 480, "camera_matrix": [[500, 0, 320], [0, 510, 240], [0, 0, 1]],
    "distortion_coefficients": [-0.04, 0.01, -0.002, 0.005],
}  # fmt: skip


PLAIN = {"fx": 500, "fy": 510, "cx": 320, "cy": 240, **dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.01)}


def read(**changes):
    """Camera of a table with these keys changed, those of None left out, and the remarks about it."""
    values = {key: value for key, value in {**TABLE, **changes}.items() if value is not None}
    with collected_remarks() as remarks:
        camera = load_camera(values)
    return camera, remarks


@pytest.mark.parametrize("key", ["model", "camera_model", "lensModel", "type", "projection", "distortion_type", "kind"])
@pytest.mark.parametrize(
    "name", ["fisheye", "EQUIDISTANT", "Kannala-Brandt", "KannalaBrandt8", "kb4", "opencv_fisheye"]
)
def test_a_lens_is_used_under_any_key_and_spelling(key, name):
    if key == "kind" and name == "kb4":
        name = "equi"
    camera, remarks = read(**{key: name})
    assert camera.distortion == Distortion("equidistant", tuple(TABLE["distortion_coefficients"]))
    assert not remarks


@pytest.mark.parametrize("key", ["fisheye", "fisheye_model", "is_fisheye", "useFisheye"])
def test_flags_of_a_fisheye(key):
    for value in (1, "true", "yes"):
        assert read(**{key: value})[0].distortion.model == "equidistant"
    for value in (0, "False", "no"):
        camera, remarks = read(**{key: value})
        assert camera.distortion.model == "radtan"
        assert not remarks


@pytest.mark.parametrize(
    ("order", "is_right"),
    [
        ("k1, k2, p1, p2, k3", True),
        ("fisheye: k1 k2 k3 k4; radtan: k1 k2 p1 p2", True),
        ("K1, K2, K3, P1, P2", False),
        ("[k_1 k_2 k_3 k_4]", False),
    ],
)
def test_a_stated_order_of_coefficients_is_that_of_the_lens(order, is_right):
    """Read at all only if the order is the lens's: k3 in the place of p1 is off by pixels."""
    five = [0.1, -0.2, 0.001, 0.002, 0.03]
    if is_right:
        assert read(distortion_coefficients=five, note=order)[0].distortion.coefficients == tuple(five)
        return
    with pytest.raises(InputError, match="coefficients in the order k1 k2 p1 p2 k3"):
        read(distortion_coefficients=five, note=order)


def test_a_type_is_a_lens_s_only_beside_a_camera():
    values = {"Dataset": {"type": "tum", "Calibration": {**PLAIN, "image_width": 640, "image_height": 480}}}
    with collected_remarks() as remarks:
        assert load_camera(values).fx == PLAIN["fx"]
    assert remarks == ["not used of the dict: Dataset.type"]
    values["Dataset"]["Calibration"]["type"] = "tum"
    with pytest.raises(InputError, match="a known distortion model"):
        load_camera(values)


def test_units_of_pixels_in_names():
    values = {f"{key}_px": value for key, value in PLAIN.items() if key[0] in "fc"}
    camera = load_camera({**values, "width_px": 640, "height_px": 480, "k1": 0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0})
    assert (camera.fx, camera.cy, camera.width, camera.distortion.coefficients[0]) == (500, 240, 640, 0.1)


def test_four_coefficients_without_a_name_are_open():
    camera, (line,) = read()
    assert camera.distortion.model == "radtan"
    assert "four coefficients" in line
    assert not read(distortion_coefficients=[0.1, 0, 0, 0, 0])[1]
    assert not read(distortion_coefficients=[0.0] * 4)[1]


@pytest.mark.parametrize(
    ("changes", "phrase"),
    [
        ({"model": "fisheye", "distortion_model": "plumb_bob"}, "one lens at"),
        ({"model": "fisheye", "fisheye_model": 0}, "one lens at"),
        ({"model": "plumb_bob", "lens": "rational_polynomial"}, "one lens at"),
        ({"camera_model": "omni"}, "'omni', a unified camera"),
        ({"anything": "double_sphere"}, "'double_sphere', a double sphere"),
        ({"lens_model": "xyz"}, "a known distortion model at lens_model"),
        ({"model": "D435i"}, "remove the key if it names no lens"),
        ({"unit": "mm"}, "px as the unit"),
        ({"pixel_centers": "corner"}, "pixel centers at integers"),
        ({"convention": "colmap"}, "pixel centers at integers"),
        ({"skew": 0.5}, "no skew at skew"),
        ({"alpha_c": "1e-3"}, "no skew at alpha_c"),
        ({"width": 320}, "one value at image_width"),
        ({"image_size": [480, 640]}, "one image size"),
        ({"D": [0, 0, 0, 0.1]}, "one value at distortion_coefficients"),
        ({"K": [500, 0, 321, 0, 510, 240, 0, 0, 1]}, "one value at camera_matrix"),
        ({"distortion_coefficients": None, "distortion_terms": [0.1]}, "only 'distortion_terms'"),
    ],
)
def test_contradictions_and_what_is_unknown_are_refused(changes, phrase):
    with pytest.raises(InputError) as caught:
        read(**changes)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_product_is_no_lens_where_the_lens_is_named():
    camera, (line,) = read(model="D435i", distortion_model="equidistant")
    assert camera.distortion.model == "equidistant"
    assert line == "not used of the dict: model"


def test_the_same_twice_is_no_contradiction():
    camera, remarks = read(K=sum(TABLE["camera_matrix"], []), image_size="640 480", D=None, width="640", model="equi")  # noqa: RUF017
    assert camera.fx == 500
    assert not remarks


def test_every_other_key_is_reported_in_one_line():
    _, remarks = read(model="equi", scale=0.5, crop=[0, 0, 3, 3], nframes=30, camera_name="left", rms=0.3, unit="px")
    assert remarks == ["not used of the dict: scale, crop"]
    _, (line,) = read(model="equi", **{f"key{i}": i for i in range(20)})
    assert line.endswith("and 8 more")
    # A name that is that of a lens may be meant as one.
    assert "not used of the dict: camera_name" in read(camera_name="fisheye")[1]


def test_comments_about_a_lens_are_reported(write):
    text = "# FishEye, calibrated by hand\n" + json.dumps(TABLE)
    with collected_remarks() as remarks:
        read_camera(write(text))
    assert any("the comment" in line for line in remarks)


def test_no_coefficients_are_reported():
    for changes in ({"distortion_coefficients": None}, {"distortion_coefficients": None, "k1": 0.1, "k2": 0, "p1": 0}):
        (line,) = read(**changes)[1]
        assert "which is taken as" in line
    assert not read(distortion_coefficients=None, distortion_model="none")[1]


def test_documents_after_the_first_are_reported(write):
    with collected_remarks() as remarks:
        read_camera(write(f"{json.dumps(TABLE | {'model': 'equi'})}\n---\nimage_width: 320\n"))
    assert len(remarks) == 1
    assert "all documents but the first" in remarks[0]


def test_names_are_unambiguous():
    assert not NAMES.keys() & REFUSED.keys()
    for model in LENSES:
        assert all(lens_name(name) == model for name in (model, model.upper(), *LENSES[model].aliases))


@pytest.mark.parametrize(
    ("camera", "phrase"),
    [
        (Camera(1080, 1920, 1000, 1000, 960, 540), "are width and height exchanged?"),
        (Camera(640, 480, 1000, 1000, 600, 240), "another resolution"),
        (Camera(640, 480, 1000, 700, 320, 240), "was the image stretched?"),
        (
            Camera(640, 480, 700, 700, 320, 240, Distortion("radtan", (0.08, -0.1, 0.044, 0.0))),
            "p1 0.044: is the order",
        ),
        (Camera(640, 480, 7e6, 7e6, 320, 240, Distortion("radtan", (1.0, 5000.0, 0, 0))), "k2 5000: is the order"),
        (Camera(640, 480, 300, 300, 320, 240, Distortion("radtan", (-0.4, 0.0, 0, 0))), "folds inside the image"),
    ],
)
def test_what_is_implausible_is_reported_with_its_cause(camera, phrase):
    lines = list(doubts(camera))
    assert len(lines) == 1
    assert phrase in lines[0]


def test_usual_cameras_are_not_doubted():
    for lens in (
        Distortion(),
        Distortion("radtan", (-0.28, 0.07, 1e-3, -2e-3)),
        Distortion("equidistant", (-0.01, 0, 0, 0)),
    ):
        assert not list(doubts(Camera(640, 480, 460, 462, 330, 229, lens)))


def test_folded_share_by_the_formula():
    # r (1 - 0.3 r^2) has its maximum at r = 1/sqrt(0.9), where it is 2/3 of that: 210.8 px at f = 300.
    camera = Camera(640, 480, 300, 300, 319.5, 239.5, Distortion("radtan", (-0.3, 0, 0, 0)))
    x, y = np.linspace(0, 639, 33), np.linspace(0, 479, 33)
    border = [(u, v) for u in x for v in (0, 479)] + [(u, v) for v in y for u in (0, 639)]
    beyond = [np.hypot(u - 319.5, v - 239.5) > 300 * 2 / 3 / np.sqrt(0.9) for u, v in border]
    assert folded_share(camera) == pytest.approx(np.mean(beyond))


def test_the_size_of_a_photograph_where_the_file_has_none(tmp_path):
    from PIL import Image

    Image.new("L", (640, 480)).save(tmp_path / "photo.png")
    table = {key: value for key, value in TABLE.items() if not key.startswith("image")}
    for name, values in {"without.json": table, "with.json": TABLE}.items():
        (tmp_path / name).write_text(json.dumps({**values, "distortion_coefficients": [0.0] * 5}))
    with collected_remarks() as remarks:
        source = sized(tmp_path / "without.json", None, [tmp_path / "photo.png"])
    assert read_camera(source) == read_camera(tmp_path / "with.json")
    assert len(remarks) == 1
    with collected_remarks() as remarks:
        assert sized(tmp_path / "with.json", None, [tmp_path / "photo.png"]) == tmp_path / "with.json"
    assert not remarks
    with pytest.raises(InputError, match="image_width"):
        read_camera(sized(tmp_path / "without.json", None))


def test_the_size_of_a_video_where_the_file_has_none(tmp_path):
    import cv2

    writer = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, (320, 240))
    writer.write(np.zeros((240, 320, 3), np.uint8))
    writer.release()
    (tmp_path / "k.json").write_text(json.dumps({"K": TABLE["camera_matrix"], "D": [0.0] * 5}))
    with collected_remarks() as remarks:
        source = sized(tmp_path / "k.json", None, [tmp_path / "walk.avi"])
    assert str(source).endswith("#320x240")
    assert remarks
    assert sized(tmp_path / "k.json", None, ["0"]) == tmp_path / "k.json"
    assert sized(tmp_path / "k.json", None, [tmp_path / "none.avi"]) == tmp_path / "k.json"
