import numpy as np
import pytest

from markergen.detect.blobs import Blobs
from markergen.detect.labels import label_dots
from markergen.errors import InputError
from markergen.maths.conic import circle_image
from markergen.maths.projection import plane_homography, project
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper, paper_roll

ROLLED = paper_roll()
DIRECTIONS = np.exp(1j * (0.3 + 2 * np.pi * np.arange(3) / 3))


def seen(marker, poses, pose, order=None, noise=0.0):
    """Blobs as a perfect detector would give them, in the given order."""
    radii = np.array([point.feature.diameter / 2 for point in marker.control_points])
    homography = plane_homography(poses.rotation[[pose]], poses.translation[[pose]], PAPER_CAMERA.matrix)
    center, semi, angle = circle_image(marker.xyz[:, :2], radii, homography)
    ring = np.array([point.feature.kind == "ring" for point in marker.control_points])
    order = np.arange(len(marker)) if order is None else order
    center = center + noise * np.random.default_rng(pose).standard_normal(center.shape)
    return Blobs(center[order], semi[order], angle[order], ring[order])


@pytest.mark.parametrize("n", [4, 5, 6, 8, 12])
def test_labels_follow_the_dots_in_any_order(ngon, n):
    marker = ngon(n)
    for pose in range(0, 400, 37):
        order = np.random.default_rng(pose).permutation(n)
        labeling = label_dots(seen(marker, ROLLED, pose, order, noise=0.02), marker, PAPER_CAMERA)
        np.testing.assert_array_equal(order[labeling.blobs], np.arange(n), labeling.reason)
        truth = project(marker.xyz, ROLLED.rotation[[pose]], ROLLED.translation[[pose]], PAPER_CAMERA.matrix)[0]
        # Five times the noise.
        np.testing.assert_allclose(labeling.pixels, truth, rtol=0, atol=0.1)


def test_asymmetric_layout_needs_no_ring(make, irregular):
    marker = make(irregular.xyz[:, :2], rings=())
    for pose in range(0, 400, 53):
        order = np.random.default_rng(pose).permutation(6)
        labeling = label_dots(seen(marker, ROLLED, pose, order, noise=0.02), marker, PAPER_CAMERA)
        np.testing.assert_array_equal(order[labeling.blobs], np.arange(6), labeling.reason)


@pytest.mark.parametrize("pose", [0, 31, 245, 399])
def test_a_regular_layout_without_ring_is_ambiguous(ngon, pose):
    for n in (4, 5, 6):
        marker = ngon(n, rings=())
        labeling = label_dots(seen(marker, ROLLED, pose), marker, PAPER_CAMERA)
        assert labeling.blobs is None
        assert "ambiguous" in labeling.reason


@pytest.mark.parametrize("corners", [3, 4])
def test_a_ring_in_the_middle_of_a_regular_layout_is_ambiguous(make, ngon, corners):
    marker = make([(0, 0), *ngon(corners).xyz[:, :2]])
    labeling = label_dots(seen(marker, ROLLED, 122), marker, PAPER_CAMERA)
    assert labeling.blobs is None
    assert "ambiguous" in labeling.reason


def test_four_dots_around_a_ring_are_told_apart_by_the_camera(make):
    # Any assignment of four dots is a homography; only the right one is a pose of the camera.
    points = [(0, 0)] + [
        (0.1284 * s * d.real, 0.1284 * s * d.imag) for s, d in zip((0.6, 0.85, 1), DIRECTIONS, strict=True)
    ]
    marker = make(points)
    for pose in range(0, 400, 53):
        order = np.random.default_rng(pose).permutation(4)
        labeling = label_dots(seen(marker, ROLLED, pose, order, noise=0.02), marker, PAPER_CAMERA)
        np.testing.assert_array_equal(order[labeling.blobs], np.arange(4), labeling.reason)


def test_strange_dots_are_passed_over(pentagon):
    rng = np.random.default_rng(0)
    for pose in range(0, 400, 61):
        own = seen(pentagon, ROLLED, pose, noise=0.02)
        strange = Blobs(
            rng.uniform(0, 480, (8, 2)), rng.uniform(5, 15, (8, 1)) * [1, 0.8], np.zeros(8), np.arange(8) == 0
        )
        both = Blobs(
            *(np.concatenate([getattr(strange, f), getattr(own, f)]) for f in ("center", "semi", "angle", "ring"))
        )
        labeling = label_dots(both, pentagon, PAPER_CAMERA)
        np.testing.assert_array_equal(labeling.blobs, np.arange(8, 13), labeling.reason)


def test_mirrored_dots_are_refused(irregular):
    blobs = seen(irregular, paper(), 130)
    mirrored = Blobs(blobs.center * [-1, 1] + [640, 0], blobs.semi, -blobs.angle, blobs.ring)
    assert label_dots(mirrored, irregular, PAPER_CAMERA).blobs is None


def test_misplaced_dot_is_refused(pentagon):
    blobs = seen(pentagon, paper(), 130)
    blobs.center[2] += [30, 0]
    labeling = label_dots(blobs, pentagon, PAPER_CAMERA)
    assert labeling.blobs is None
    assert labeling.reason


def test_every_early_end_has_its_reason(pentagon):
    blobs = seen(pentagon, paper(), 130)
    few = Blobs(blobs.center[:4], blobs.semi[:4], blobs.angle[:4], blobs.ring[:4])
    assert "found 4 dots, the marker has 5" in label_dots(few, pentagon, PAPER_CAMERA).reason
    no_ring = Blobs(blobs.center, blobs.semi, blobs.angle, np.zeros(5, bool))
    assert "no key ring" in label_dots(no_ring, pentagon, PAPER_CAMERA).reason
    crowd = Blobs(*(np.concatenate([getattr(blobs, f)] * 30) for f in ("center", "semi", "angle", "ring")))
    assert "too many" in label_dots(crowd, pentagon, PAPER_CAMERA).reason


def test_dots_on_one_line_are_refused_without_a_warning(pentagon):
    line = np.stack([np.linspace(100, 500, 5), np.full(5, 240.0)], axis=-1)
    blobs = Blobs(line, np.full((5, 2), 10.0), np.zeros(5), np.arange(5) == 0)
    assert label_dots(blobs, pentagon, PAPER_CAMERA).blobs is None
    same = Blobs(np.full((5, 2), 240.0), np.full((5, 2), 10.0), np.zeros(5), np.arange(5) == 0)
    assert label_dots(same, pentagon, PAPER_CAMERA).blobs is None


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], "4 or more"),
        ([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0.1, 0.1, 0.02)], "a flat marker"),
        ([(0, 0, 0), (0.05, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], "no three are on a line"),
    ],
)
def test_markers_that_cannot_be_labeled_are_refused(pentagon, points, said):
    marker = Marker(
        tuple(ControlPoint(i, *point, Feature(0.02)) for i, point in enumerate(points)), Circle(0.15), 0.002
    )
    with pytest.raises(InputError, match=said):
        label_dots(seen(pentagon, paper(), 0), marker, PAPER_CAMERA)
