import cv2
import numpy as np
import pytest

from markergen.detect import detect
from markergen.detect.presentation import _label, overlay
from markergen.maths.rotation import exponential
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()


def view(marker, pose):
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    return render_view(marker, PAPER_CAMERA, rotation, translation, Optics(), np.random.default_rng(0))


def decoded(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


@pytest.mark.parametrize("camera", [PAPER_CAMERA, None])
def test_draws_on_the_dots_and_leaves_the_rest(pentagon, camera):
    image = view(pentagon, 130)
    finding = detect(image, pentagon, camera)
    assert finding.ok
    png = overlay(image, [finding])
    assert png == overlay(image, [finding])
    drawn = decoded(png)
    changed = (drawn != image[..., None]).any(axis=-1)
    for x, y in np.rint(finding.pixels).astype(int):
        assert changed[y, x]
    # The corners of the image are far from the marker.
    assert not changed[:40, :40].any()
    assert not changed[-40:, -40:].any()


def test_every_outline_is_drawn(shapes, make_in):
    marker = make_in(shapes["plate"], 5, 0.02, seed=2)
    image = view(marker, 30)
    finding = detect(image, marker, PAPER_CAMERA)
    assert finding.pose is not None
    drawn = decoded(overlay(image, [finding]))
    changed = (drawn != image[..., None]).any(axis=-1)
    for ring in shapes["plate"].outlines():
        middles = (ring + np.roll(ring, -1, axis=0)) / 2
        pixels = PAPER_CAMERA.project(middles, POSES.rotation[[30]], POSES.translation[[30]])[0]
        # The pose that was found is within a pixel of the true one.
        columns, rows = np.rint(pixels).astype(int).T
        nearby = [changed[y - 1 : y + 2, x - 1 : x + 2].any() for x, y in zip(columns, rows, strict=True)]
        assert np.mean(nearby) > 0.95


def test_numbers_of_a_dense_grid_hide_neither_dots_nor_each_other():
    canvas, taken = np.zeros((480, 640, 3), np.uint8), []
    points = 100.0 + 18.0 * np.argwhere(np.ones((10, 10)))
    for number, point in enumerate(points):
        _label(canvas, point, str(number), (0, 110, 255), points, taken)
    # Those of the rim have room, those inside have none.
    assert 20 <= len(taken) < 40
    assert not canvas[tuple(points[:, ::-1].astype(int).T)].any()
    boxes = np.array(taken)
    apart = (boxes[:, None, 0] >= boxes[None, :, 1]).any(axis=-1)
    assert (apart | apart.T | np.eye(len(boxes), dtype=bool)).all()


@pytest.mark.parametrize("angle", [18, 20, 24])
def test_names_of_axes_hide_no_dot(make_ngon, angle):
    """The key dot is on the y axis, near whose end the name is."""
    marker, camera = make_ngon(6, 0.06, 0.0305), Camera(640, 480, 700.0, 700.0, 320.0, 240.0)
    rotation = np.linalg.multi_dot(exponential(np.deg2rad([[0, 0, 2 * angle], [0, angle, 0], [155, 0, 0]])))
    image = render_view(marker, camera, rotation, np.array([0.02, 0, 0.5]), Optics(), np.random.default_rng(0))
    finding = detect(image, marker, camera)
    assert len(finding.ids) == 6
    drawn = decoded(overlay(image, [finding]))
    for x, y in np.rint(finding.pixels).astype(int) + 3:
        # Between the arms of the cross, which is drawn last.
        assert (drawn[y, x] == image[y, x]).all()


def test_axes_need_a_pose(pentagon):
    image = view(pentagon, 130)
    with_pose, without = (decoded(overlay(image, [detect(image, pentagon, camera)])) for camera in (PAPER_CAMERA, None))
    assert (with_pose != without).any()


def test_without_detections_the_image_stays():
    image = np.arange(60, dtype=np.uint8).reshape(6, 10)
    np.testing.assert_array_equal(decoded(overlay(image, []))[..., 0], image)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_upper_eight_bits_of_a_sensor_are_shown(bits):
    image = np.linspace(0, 2**bits - 1, 60).reshape(6, 10).astype(np.uint16)
    np.testing.assert_array_equal(decoded(overlay(image, []))[..., 1], image >> (bits - 8))
