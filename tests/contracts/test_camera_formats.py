"""What every camera format of the table that is written keeps to."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera, Distortion
from markergen.read.cameras import CAMERA_FORMATS, CameraRecord
from markergen.read.cameras.covariance import camera_covariance, read_camera_covariance

WRITTEN = [
    pytest.param(name, ending, id=f"{name}-{ending.lstrip('.')}")
    for name in CAMERA_FORMATS
    for ending in CAMERA_FORMATS[name].endings
]
SIZES = (-0.1, 0.02, 1e-5, -3e-7, 1 / 3, 0.2, -0.15, 0.04)
CAMERAS = [
    pytest.param(
        Camera(640, 480, 1000 / 3, 501.5, 318 + 1 / 7, 240, Distortion(model, (SIZES * 3)[: len(names)])),
        id=f"{model}-{len(names)}",
    )
    for model in LENSES
    for names in LENSES[model].coefficients
]


def covariance_of(camera):
    """Return a covariance of parameters as different as px and k6."""
    k = len(camera.parameter_names)
    root = np.random.default_rng(0).normal(size=(k, k)) * 10.0 ** -np.arange(k)
    return root.T @ root


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize(("name", "ending"), WRITTEN)
def test_what_is_written_is_read_back(tmp_path, name, ending, camera):
    path = tmp_path / f"mine{ending}"
    form, covariance = CAMERA_FORMATS[name], covariance_of(camera)
    if not form.holds(CameraRecord(camera, covariance)):
        with pytest.raises(InputError, match=r"a lens that mine.* can hold.*write .*\.toml"):
            camera.save(path, covariance)
        assert not path.exists()
        return
    camera.save(path, covariance, rms=0.125)
    back = Camera.load(path)
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (100, 2))
    np.testing.assert_allclose(back.to_pixels(points), camera.to_pixels(points), rtol=1e-12)
    assert (back.width, back.height) == (640, 480)
    # By name, both for the camera that is in the file and for the one that was written.
    np.testing.assert_allclose(read_camera_covariance(path, camera), covariance, rtol=1e-12)
    results = camera_covariance(None, path, back)
    places = [back.parameter_names.index(parameter_name) for parameter_name in camera.parameter_names]
    np.testing.assert_allclose(results[np.ix_(places, places)], covariance, rtol=1e-12)
    assert np.count_nonzero(results) == np.count_nonzero(covariance)
    data = path.read_bytes()
    camera.save(path, covariance, rms=0.125)
    assert path.read_bytes() == data
    # Of an exact camera, nothing is said.
    camera.save(path)
    assert camera_covariance(None, path, Camera.load(path)) is None
    with pytest.raises(InputError, match="a camera without one"):
        read_camera_covariance(path, camera)


@pytest.mark.parametrize("camera", CAMERAS)
def test_some_format_holds_every_lens(camera):
    forms = [CAMERA_FORMATS[name] for name in CAMERA_FORMATS]
    assert any(form.write and form.holds(CameraRecord(camera)) for form in forms)


def test_each_ending_is_of_one_format():
    endings = [ending for name in CAMERA_FORMATS for ending in CAMERA_FORMATS[name].endings]
    assert len(endings) == len(set(endings))
    assert all(ending == ending.lower() for ending in endings)
