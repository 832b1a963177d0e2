import json
from dataclasses import replace

import numpy as np
import pytest
from cpu import cpu_seconds
from sentences import sentence

from markergen.errors import InputError
from markergen.maths.rotation import exponential
from markergen.model.camera import NO_DISTORTION, PAPER_CAMERA, Camera, Distortion, typical_camera
from markergen.model.spec import Spec

WIDE = Camera(752, 480, 458.6, 457.3, 367.2, 248.4, Distortion("radtan", (-0.283, 0.074, 1.9e-4, 1.8e-5)))
RATIONAL = replace(WIDE, distortion=Distortion("rational", (0.52, -2.53, 4.7e-4, -2e-4, 1.48, 0.4, -2.35, 1.41)))
FOLDING = replace(WIDE, distortion=Distortion("radtan", (-0.4, 0.0, 1e-3, 1e-3)))
FISHEYE = Camera(512, 512, 190.98, 190.97, 254.9, 256.9, Distortion("equidistant", (0.0035, 0.0007, -0.002, 0.0002)))
CAMERAS = [PAPER_CAMERA, WIDE, RATIONAL, FISHEYE]


@pytest.fixture(params=CAMERAS, ids=lambda camera: camera.distortion.model)
def camera(request):
    return request.param


def grid(camera):
    return np.stack(np.meshgrid(np.arange(0.0, camera.width, 16), np.arange(0.0, camera.height, 16)), axis=-1)


def test_pixels_there_and_back(camera):
    pixels = grid(camera)
    # The inverse is good to 1e-13 of normalized units after the lens, here some 1e-10 px.
    again = camera.to_pixels(camera.from_pixels(pixels))
    seen = np.isfinite(again[..., 0])
    np.testing.assert_allclose(again[seen], pixels[seen], atol=1e-9)
    # The fisheye sees more than a half space at the corners: a right angle is 1.57 * 191 px or more from the center.
    assert seen.all() or (camera is FISHEYE and seen[np.hypot(*(pixels - [254.9, 256.9]).T).T < 290].all())


def test_the_image_of_points_is_opencvs(camera):
    import cv2

    rng = np.random.default_rng(0)
    points = rng.uniform(-0.3, 0.3, (50, 3))
    vector, offset = np.array([0.3, -0.2, 0.5]), np.array([0.1, -0.05, 1.0])
    rotation = exponential(vector)
    ours = camera.project(points, rotation[None], offset[None])[0]
    coefficients = np.array(camera.distortion.coefficients or (0.0,) * 4)
    if camera.distortion.model == "equidistant":
        theirs, _ = cv2.fisheye.projectPoints(points[:, None], vector, offset, camera.matrix, coefficients)
        theirs = theirs.reshape(-1, 2)
    else:
        theirs = cv2.projectPoints(points, vector, offset, camera.matrix, coefficients)[0][:, 0]
    # Rounding only.
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_jacobians_against_differences(camera):
    normalized, step = np.random.default_rng(1).uniform(-0.6, 0.6, (30, 2)), 1e-6
    slopes = [
        (camera.to_pixels(normalized + step * e) - camera.to_pixels(normalized - step * e)) / (2 * step)
        for e in np.eye(2)
    ]
    # Differences of 500 px: 1e-13 px of rounding over 2e-6, and 1e-12 of third derivatives of some 1e3 px.
    np.testing.assert_allclose(camera.pixel_jacobian(normalized), np.stack(slopes, axis=-1), atol=2e-6)
    names = camera.parameter_names
    assert names[:4] == ("fx", "fy", "cx", "cy")
    jacobian = camera.parameter_jacobian(normalized)
    assert jacobian.shape == (30, 2, len(names)) == (30, 2, 4 + len(camera.distortion.coefficients))
    for i in range(len(names)):
        ahead, behind = (_moved(camera, i, s).to_pixels(normalized) for s in (step, -step))
        np.testing.assert_allclose(jacobian[..., i], (ahead - behind) / (2 * step), atol=2e-6)


def _moved(camera, index, step):
    if index < 4:
        name = camera.parameter_names[index]
        return replace(camera, **{name: getattr(camera, name) + step})
    values = list(camera.distortion.coefficients)
    values[index - 4] += step
    return replace(camera, distortion=Distortion(camera.distortion.model, tuple(values)))


def test_the_ideal_camera(camera):
    ideal = camera.ideal
    assert ideal.distortion == NO_DISTORTION
    assert ideal.ideal is ideal
    np.testing.assert_array_equal(ideal.matrix, camera.matrix)
    normalized = np.array([[0.1, -0.2], [0.0, 0.0]])
    np.testing.assert_allclose(ideal.to_pixels(normalized), normalized * camera.focal + [camera.cx, camera.cy])
    # On the axis there is no distortion.
    np.testing.assert_allclose(camera.to_pixels(normalized)[1], [camera.cx, camera.cy])


def test_what_the_lens_cannot_image_is_not_seen():
    camera = replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.4, 0.0, 0.0, 0.0)))
    # The radial polynomial turns over at 0.91 and is 0 again at 1.58: this point would come to the image's middle.
    folded = np.array([[1.58, 0.0], [0.1, 0.0]])
    pixels = camera.to_pixels(folded)
    np.testing.assert_array_equal(np.isnan(pixels[:, 0]), [True, False])
    np.testing.assert_array_equal(camera.sees(pixels), [False, True])
    assert np.isnan(camera.pixel_jacobian(folded)[0]).all()
    assert np.isnan(camera.parameter_jacobian(folded)[0]).all()
    assert np.isfinite(camera.parameter_jacobian(folded)[1]).all()
    # The image of the domain is a disk of 0.609 * 800 px: corners of a larger sensor get no ray.
    assert np.isnan(camera.from_pixels(np.array([320.0 + 490, 240.0]))).all()
    assert np.isfinite(camera.from_pixels(np.array([320.0 + 480, 240.0]))).all()


@pytest.mark.parametrize(
    "camera", [WIDE, FOLDING, RATIONAL, FISHEYE], ids=["radtan", "folding", "rational", "equidistant"]
)
def test_a_whole_image_is_quick(camera):
    camera = replace(camera, width=640, height=480, cx=319.5, cy=239.5)
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1)
    rays = camera.from_pixels(pixels)
    # 5 to 10 times the way forward; Newton in the whole image takes 30 times, Python for each pixel 10,000 times.
    assert cpu_seconds(lambda: camera.from_pixels(pixels)) < 20 * cpu_seconds(lambda: camera.to_pixels(rays))


def test_as_json():
    # A pinhole camera is written as before there was distortion: hashes and files stay as they are.
    plain = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}
    assert PAPER_CAMERA.as_dict() == plain
    assert list(PAPER_CAMERA.as_dict()) == list(plain)
    assert Spec().as_dict()["camera"] == plain
    assert Spec(camera=replace(PAPER_CAMERA, distortion=NO_DISTORTION)).hash == Spec().hash
    assert FISHEYE.as_dict()["distortion"] == {"model": "equidistant", "coefficients": [0.0035, 0.0007, -0.002, 0.0002]}
    assert Spec(camera=WIDE).hash != Spec(camera=WIDE.ideal).hash


def test_cameras_are_values():
    assert Distortion("radtan", [1, 0, 0, 0]) == Distortion("radtan", (1.0, 0.0, 0.0, 0.0))
    assert hash(replace(WIDE)) == hash(WIDE)
    assert Distortion("radtan", (0.0,) * 5).names == ("k1", "k2", "p1", "p2", "k3")
    assert Distortion("rational", (0.0,) * 8).names == ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    assert WIDE.parameter_names == ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


@pytest.mark.parametrize(
    ("model", "coefficients", "phrase"),
    [
        ("omni", (), "known distortion model, found 'omni'; known: equidistant, none, radtan, rational"),
        ("x" * 1000, (), "known distortion model, found 'xxx"),
        ("radtan", (0.0,) * 3, "4 or 5 coefficients of the distortion model 'radtan', found 3; give k1 k2 p1 p2 or"),
        ("rational", (0.0,) * 5, "8 coefficients of the distortion model 'rational', found 5"),
        ("equidistant", (0.0,) * 5, "4 coefficients of the distortion model 'equidistant', found 5; give k1 k2 k3 k4"),
        ("none", (0.1,), "0 coefficients of the distortion model 'none', found 1; give none"),
        ("radtan", (0.0, float("nan"), 0.0, 0.0), "finite distortion coefficients, found k2=nan"),
        ("radtan", (0.0, 0.0, 0.0, 0.0, float("inf")), "finite distortion coefficients, found k3=inf"),
        ("radtan", (0.0, 0.0, 0.0, 10**400), "finite distortion coefficients, found p2=10000"),
        ("radtan", (2e12, 0.0, 0.0, 0.0), "finite distortion coefficients, found k1=2000000000000.0"),
    ],
)
def test_bad_distortions_are_refused(model, coefficients, phrase):
    with pytest.raises(InputError) as caught:
        Distortion(model, coefficients)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"width": "a"}, "an image size of 1 to 20000 pixels, found 'a'x480"),
        ({"width": 640.5}, "found 640.5x480; give the camera's width and height in whole pixels"),
        ({"height": float("nan")}, "found 640xnan"),
        ({"height": None}, "found 640xNone"),
        ({"height": True}, "found 640xTrue"),
        ({"width": [640]}, "found [640]x480"),
        ({"width": 10**5000}, "found an endless numberx480"),
        ({"fx": "800"}, "finite positive focal lengths, found fx='800', fy=800.0"),
        ({"fy": None}, "fy=None"),
        ({"fx": 1j}, "fx=1j"),
        ({"fx": np.array([800.0])}, "fx=array([800.])"),
        ({"cx": "middle"}, "a finite principal point, found cx='middle'"),
        ({"cy": {}}, "cy={}"),
        ({"distortion": None}, "a Distortion, found NoneType None"),
        ({"distortion": (0.1, 0, 0, 0)}, "a Distortion, found tuple (0.1, 0, 0, 0)"),
    ],
)
def test_what_is_no_number_is_refused(change, phrase):
    values = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(InputError) as caught:
        Camera(**values | change)
    assert phrase in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("model", "coefficients", "phrase"),
    [
        (None, (), "known distortion model, found None"),
        ([], (), "known distortion model, found []"),
        ("radtan", None, "a list of distortion coefficients, found None"),
        ("radtan", 0.1, "a list of distortion coefficients, found 0.1"),
        ("radtan", "0000", "a list of distortion coefficients, found '0000'"),
        ("radtan", ["0"] * 4, "finite distortion coefficients, found k1='0'"),
        ("radtan", [[0.0] * 4], "4 or 5 coefficients"),
        ("radtan", [None] * 4, "finite distortion coefficients, found k1=None"),
    ],
)
def test_what_is_no_distortion_is_refused(model, coefficients, phrase):
    with pytest.raises(InputError) as caught:
        Distortion(model, coefficients)
    assert phrase in str(caught.value)


def test_numbers_of_numpy_become_pythons():
    camera = Camera(
        *np.array([640, 480]), *np.array([800, 800, 320, 240], np.float32), Distortion("radtan", np.zeros(4))
    )
    assert camera == Camera(640.0, 480, 800, 800, 320, 240, Distortion("radtan", (0, 0, 0, 0)))
    assert json.loads(json.dumps(camera.as_dict())) == camera.as_dict()
    assert type(camera.width) is int


def test_cameras_print_in_a_line():
    assert repr(PAPER_CAMERA) == "Camera(width=640, height=480, fx=800.0, fy=800.0, cx=320.0, cy=240.0)"
    for camera in CAMERAS:
        assert eval(repr(camera)) == camera
        assert len(repr(camera)) < 300
        assert "\n" not in str(camera)
    assert str(FISHEYE).endswith("equidistant k1 0.0035, k2 0.0007, k3 -0.002, k4 0.0002")
    assert str(PAPER_CAMERA) == sentence("camera", "640x480 px", 800, 800, 320, 240)


def test_a_camera_by_the_size_of_its_images_and_its_angle_of_view():
    camera = typical_camera("1280x720@60deg")
    assert (camera.width, camera.height) == (1280, 720)
    edges = np.array([[-np.tan(np.pi / 6), 0.0, 1.0], [np.tan(np.pi / 6), 0.0, 1.0]])
    pixels = camera.project(edges, np.eye(3)[None], np.zeros((1, 3)))[0]
    # From the outer edge of the first pixel to that of the last, on the middle row.
    assert pixels == pytest.approx(np.array([[-0.5, 359.5], [1279.5, 359.5]]))
    assert Camera.load("1280x720@60deg") == Spec(camera=camera).camera
    assert typical_camera("1280x720@60") is typical_camera("camera.yaml") is None
    with pytest.raises(InputError, match="angle of view"):
        typical_camera("1280x720@180deg")


@pytest.mark.parametrize("text", ["1280x720", "1280x720@60", "1920x1080@78", "webcm", "w" * 3000])
def test_what_is_nearly_a_typical_camera_names_the_forms(text):
    with pytest.raises(InputError, match="1280x720@60deg"):
        Camera.load(text)


@pytest.mark.parametrize("factor", [0, -1, np.nan, np.inf, "2", None])
def test_a_camera_is_not_scaled_by_what_is_no_factor(factor):
    with pytest.raises(InputError, match="a factor above 0"):
        PAPER_CAMERA.scaled(factor)
