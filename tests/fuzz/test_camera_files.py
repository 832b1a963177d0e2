"""Whatever stands in a calibration file, the answer is a camera or one line."""

import json
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mutants import mutants

from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.read.cameras import read_camera
from markergen.read.cameras.covariance import read_camera_covariance

MATRIX = "rows: 3\n  cols: 3\n  data: [500, 0, 320, 0, 510., 2.4e+02, 0, 0, 1]"
SEEDS = [
    f"%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nfisheye_model: 0\n"
    f"camera_matrix: !!opencv-matrix\n  {MATRIX}\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   data: [ -0.1, 1e-2, 0., 0., .02 ]\n",
    "<?xml version='1.0'?>\n<opencv_storage><image_width>640</image_width><image_height>480</image_height>\n"
    '<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>\n<data>500. 0. 320. '
    "0. 510. 240. 0. 0. 1.</data></camera_matrix><D type_id='opencv-matrix'><rows>1</rows><cols>4</cols>"
    "<data>0 0 0 0</data></D></opencv_storage>",
    f"image_width: 640\nimage_height: 480\ncamera_name: a\ncamera_matrix:\n  {MATRIX}\ndistortion_model: plumb_bob\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0.2, -1e-3, 1e-3, 0]\n"
    "binning_x: 0\nroi: {width: 0}\n",
    "cam0:\n  camera_model: pinhole\n  intrinsics: [461, 460, 362, 246]\n  distortion_model: radtan\n"
    "  distortion_coeffs: [-0.2, 0.06, 8e-4, 1e-4]\n  resolution: [752, 480]\n  T: &a [1, 2]\n  U: *a\n",
    "# cameras\n1 OPENCV 640 480 500 510 320 240 0.1 0.2 0.001 0.002\n",
    "[camera]\nwidth = 640\nheight = 480\nfx = 500.0\nfy = 500\ncx = 320\ncy = 240\n"
    '[camera.distortion]\nmodel = "equidistant"\ncoefficients = [0, 0.1, 0, 0]\n',
    '{"width": 640, "height": 480, "fx": 500.0, "fy": 5e2, "cx": 320, "cy": 240}',
    '{"width": 640, "height": 480, "fx": 500.0, "fy": 5e2, "cx": 320, "cy": 240, "camera_parameters": ["fx", "cy"], '
    '"camera_covariance": [[4, 1], [1, 9]]}',
    "# camera_parameters: fx fy\n# camera_covariance: 4 1 1 9\n1 PINHOLE 640 480 500 510 320 240\n",
]  # fmt: skip
TOKENS = [
    "0", "-1", "1e999", "nan", ".inf", "640", "9" * 5000, "", " ", "\n", "\t", ":", "[", "]", "{", "}", "<", ">",
    "&a", "*a",    "!!x ", "---\n", "#", "'", '"', "null", "true", "\0", "\ufeff", "é", "😀",
    "<!-- ", "<a>", "&#0;", "&lt;", "=", "[[a]]\n", "|", ">-", "? ", "- ", "%YAML 1.1\n", "K: 1\n", "rows",
    "1e-400", "0x1p3", "1_0",
]  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("camera") / "file"


def outcome(path, data):
    """Read as both kinds of file; use the camera, if it is one, and return it."""
    path.write_bytes(data)
    camera = None
    start = time.process_time()
    for read in (read_camera, lambda path: read_camera_covariance(path, PAPER_CAMERA)):
        try:
            result = read(path)
        except InputError as error:
            message = str(error)
            assert "\n" not in message
            assert len(message) < 2000
        else:
            camera = result if isinstance(result, Camera) else camera
    # The most that a megabyte takes is 0.7 s; these have kilobytes.
    assert time.process_time() - start < 1
    if camera is not None:
        assert np.isfinite(camera.matrix).all()
        # A camera that was read can be used, without a warning.
        pixels = camera.to_pixels(np.array([[0.0, 0.0], [0.1, -0.2], [3.0, 4.0]]))
        np.testing.assert_allclose(pixels[0], [camera.cx, camera.cy])
        camera.from_pixels(pixels)
    return camera


def test_the_seeds_are_cameras(path):
    for text in SEEDS:
        assert outcome(path, text.encode()) is not None


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=300)
@given(mutants(SEEDS, TOKENS, 30))
def test_anything(path, data):
    outcome(path, data)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=9) | st.dictionaries(st.sampled_from(["rows", "cols", "data", "K"]), inner),
    max_leaves=12,
)
KEYS = [
    "K",
    "D",
    "width",
    "height",
    "distortion_model",
    "cam0",
    "fx",
    "camera",
    "roi",
    "binning_x",
    "image_size",
    "fisheye",
]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=40)
@given(st.dictionaries(st.sampled_from(KEYS), JSON))
def test_known_keys_with_any_values(path, values):
    outcome(path, json.dumps(values).encode())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=60)
@given(st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), max_size=4), st.sampled_from([(4,), (4, 4), (2,)]))
def test_arrays_with_bytes_flipped(path, changes, shape):
    import io

    file = io.BytesIO()
    np.save(file, np.ones(shape))
    data = bytearray(file.getvalue())
    for place, value in changes:
        data[int(place**3 * len(data))] = value
    outcome(path, bytes(data))
