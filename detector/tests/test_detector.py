"""The whole: drawn frames in, findings out."""

import threading

import numpy as np
import pytest
from markergen_detect import DescriptionError, Detector, Finding
from numpy.testing import assert_allclose
from stages import drawn
from test_description import CAMERA, content, dots, entry, plate

PLACES = [[0, 0.05, 0], [-0.045, 0.01, 0], [-0.025, -0.04, 0], [0.03, -0.042, 0], [0.048, 0.014, 0]]
BOARD = content(entry(dots=dots(places=PLACES)))
R, T = np.diag([1.0, -1.0, -1.0]), np.array([0.01, -0.02, 0.4])


def frame(places=PLACES, rng=None, light=False, **options):
    """A frontal view: dots are circles, and their centers are exact."""
    points = np.array(places) @ R.T + T
    centers = 600 * points[:, :2] / points[:, 2:] + [319.5, 239.5]
    radius = 600 * 0.006 / T[2]
    rows = [(*center, radius, radius, 0, 0.5 * (i == 0)) for i, center in enumerate(centers)]
    image = drawn((480, 640), rows, rng, **options)
    return (255 - image if light else image), centers


@pytest.fixture(scope="module")
def view():
    return frame(rng=np.random.default_rng(1))


def test_a_marker_is_found_with_its_pose(view):
    (finding,) = Detector(BOARD, CAMERA)(view[0])
    assert (finding.ok, finding.reason, finding.name, finding.ids.tolist()) == (True, "", "board", [0, 1, 2, 3, 4])
    assert_allclose(finding.pixels, view[1], atol=0.06)
    sigma = np.sqrt(np.diag(finding.covariance))
    assert (np.abs(finding.translation - T) < 5 * sigma[3:]).all()
    assert_allclose(finding.covariance, finding.image_covariance + finding.print_covariance)
    assert not finding.camera_covariance.any()
    assert finding.degrees_of_freedom == 4
    assert finding.pixel_covariance.shape == (5, 2, 2)
    ideal = np.append(np.array(PLACES)[:, :2], np.ones((5, 1)), axis=1) @ finding.homography.T
    assert_allclose(ideal[:, :2] / ideal[:, 2:], finding.pixels, atol=0.1)


def test_without_a_camera_there_are_labels_and_a_homography(view):
    (finding,) = Detector(BOARD)(view[0])
    assert finding.ok
    assert finding.rotation is finding.covariance is None
    assert finding.homography is not None
    assert_allclose(finding.pixels, view[1], atol=0.06)


def test_light_dots_and_16_bits_and_rows_of_a_larger_array(view):
    light = Detector(content(entry(light=True, dots=dots(places=PLACES))), CAMERA)
    assert light(255 - view[0])[0].ok
    assert not light(view[0])[0].ok
    wide = np.zeros((500, 700), np.uint16)
    wide[10:490, 30:670] = view[0].astype(np.uint16) * 256
    (finding,) = Detector(BOARD, CAMERA)(wide[10:490, 30:670])
    assert finding.ok
    (finding,) = Detector(BOARD, CAMERA)(np.asfortranarray(view[0]))
    assert finding.ok


def test_calibration_errors_widen_the_covariance(view):
    (finding,) = Detector(BOARD, CAMERA, camera_covariance=np.diag([4.0, 4, 1, 1]))(view[0])
    assert finding.camera_covariance[5, 5] > 1e-7
    with pytest.raises(DescriptionError, match="4 x 4"):
        Detector(BOARD, CAMERA, camera_covariance=np.eye(5))


def test_nothing_in_view_has_a_reason():
    (finding,) = Detector(BOARD, CAMERA)(np.full((480, 640), 255, np.uint8))
    assert not finding.ok
    assert finding.state == "few"
    assert "found 0 dots" in finding.reason
    assert finding.pixels.shape == (0, 2)
    one = Finding(False, "few", {**finding.facts, "blobs": 1}, 0, "board")
    assert one.reason == "found 1 dot in the image, at least 4 are needed"


@pytest.mark.parametrize(
    ("count", "missing", "reason"),
    [
        (0, 0, "no labeling fits"),
        (5, 0, "no labeling fits: the best has 5 dots"),
        (4, 1, "no labeling fits: the best has 4 dots, and 1 more should be seen"),
    ],
)
def test_without_any_labeling_there_is_no_best_one(count, missing, reason):
    facts = {"count": count, "missing": missing, "blobs": 7, "cut": False}
    assert Finding(False, "unfit", facts, 0, "board").reason == reason


def test_images_are_checked():
    detector = Detector(BOARD, CAMERA)
    for wrong in (None, np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640)), np.zeros((0, 0), np.uint8)):
        with pytest.raises(DescriptionError):
            detector(wrong)
    with pytest.raises(DescriptionError, match="the image is 64x48 px, the camera 640x480 px"):
        detector(np.zeros((48, 64), np.uint8))


def test_rigs_need_a_camera():
    with pytest.raises(DescriptionError, match="expected a camera"):
        Detector(content(entry(dots=dots(places=[[x, y, 0.001 * x] for x, y, _ in PLACES]))))


OTHER = [[0.02, 0.05, 0], [-0.045, 0.03, 0], [-0.04, -0.03, 0], [0.01, -0.045, 0], [0.048, 0.0, 0], [0.0, 0.0, 0]]
APART = np.array([0.07, 0, 0])
SEEN_AS = {
    "as described": ("found", "", PLACES, OTHER),
    "mirrored": ("contradicted", "right looks mirrored", PLACES, np.array(OTHER) * [-1, 1, 1]),
    "turned": ("contradicted", "right looks turned by", PLACES, np.array(OTHER)[:, [1, 0, 2]] * [-1, 1, 1]),
    "exchanged": ("contradicted", "left and right exchanged", OTHER, PLACES),
}


@pytest.mark.parametrize("name", SEEN_AS)
def test_a_plate_that_is_not_as_described_is_named(name):
    state, reason, left, right = SEEN_AS[name]
    plates = [plate("left", translation=(-APART).tolist()), plate("right", translation=APART.tolist())]
    ours = [np.array(PLACES) - APART, np.array(OTHER) + APART]
    rows = [dot for k in (0, 1) for dot in dots(k, 5 * k, ours[k].tolist())]
    body = content({**entry(plates=plates, dots=rows), "frame": "rig"})
    image = np.minimum(frame(np.array(left) - APART)[0], frame(np.array(right) + APART)[0])
    (finding,) = Detector(body, CAMERA)(image)
    assert (finding.state, reason in finding.reason) == (state, True)


def test_threads_share_a_detector(view):
    detector, findings = Detector(BOARD, CAMERA), []
    threads = [threading.Thread(target=lambda: findings.append(detector(view[0])[0])) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({finding.translation.tobytes() for finding in findings}) == 1
