import time

import numpy as np
import pytest
from plain_blobs import plain_blobs

from markergen.detect.blobs import undo_lens
from markergen.detect.identification import REFUSED_PX, ROUGH_PX, View, ambiguity, confirm, given, search
from markergen.detect.pose_hypotheses import layout_of
from markergen.detect.seen_models import Poses
from markergen.model.camera import PAPER_CAMERA

DIRECTIONS = np.exp(1j * (0.3 + 2 * np.pi * np.arange(3) / 3))
RELIEF = [0, 0.02, 0.01, 0.02, 0, 0.005]


def labels(blobs, marker, calibrated=True):
    """Indices of the blobs of each dot, -1 for none, or None; and the reason."""
    ellipses = undo_lens(blobs, PAPER_CAMERA)
    found = search(ellipses, View(layout_of(marker), PAPER_CAMERA, calibrated))
    found = found if found.reason else confirm(found, ellipses)
    reason = found.reason or ambiguity(found)
    return (None if reason else found.blobs), reason


def check(view, marker, hidden=(), calibrated=True):
    """All dots that are there have their blob, and the others none."""
    found, reason = labels(view.blobs, marker, calibrated)
    assert found is not None, reason
    expected = np.where(np.isin(np.arange(len(marker)), hidden), -1, np.arange(len(marker)))
    np.testing.assert_array_equal(np.where(found >= 0, view.dot[found], -1), expected)


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("n", [4, 5, 6, 8, 12])
def test_labels_follow_the_dots_in_any_order(ngon, sight, n, calibrated):
    for pose in range(0, 400, 37):
        check(sight(ngon(n), pose), ngon(n), calibrated=calibrated)


@pytest.mark.parametrize("calibrated", [True, False])
def test_asymmetric_layout_needs_no_ring(make, irregular, sight, calibrated):
    marker = make(irregular.xyz[:, :2], rings=())
    for pose in range(0, 400, 53):
        check(sight(marker, pose), marker, calibrated=calibrated)
        check(sight(marker, pose, hidden=[pose % 6]), marker, [pose % 6])


def test_relief(ngon, sight):
    marker = ngon(6, heights=RELIEF)
    for pose in range(0, 400, 37):
        check(sight(marker, pose), marker)
        check(sight(marker, pose, hidden=[1 + pose % 5], strangers=10), marker, [1 + pose % 5])


@pytest.mark.parametrize("pose", [0, 31, 245, 399])
@pytest.mark.parametrize("calibrated", [True, False])
def test_a_regular_layout_without_ring_is_ambiguous(ngon, sight, pose, calibrated):
    for n in (4, 5, 6):
        marker = ngon(n, rings=())
        assert "ambiguous" in labels(sight(marker, pose).blobs, marker, calibrated)[1]


@pytest.mark.parametrize("corners", [3, 4])
def test_a_ring_in_the_middle_of_a_regular_layout_is_ambiguous(make, ngon, sight, corners):
    marker = make([(0, 0), *ngon(corners).xyz[:, :2]])
    assert "ambiguous" in labels(sight(marker, 122).blobs, marker)[1]


def test_four_dots_around_a_ring_are_told_apart_by_the_camera(make, sight):
    # Any assignment of four dots is a homography; only the right one is a pose of the camera.
    points = [(0, 0)] + [
        (0.1284 * s * d.real, 0.1284 * s * d.imag) for s, d in zip((0.6, 0.85, 1), DIRECTIONS, strict=True)
    ]
    marker = make(points)
    for pose in range(0, 400, 53):
        check(sight(marker, pose), marker)


@pytest.mark.parametrize("n", [5, 6, 8])
def test_dots_may_be_hidden_as_long_as_the_ring_is_seen(ngon, sight, n):
    marker = ngon(n)
    for pose in range(0, 400, 37):
        hidden = 1 + np.random.default_rng(pose).permutation(n - 1)[: max(1, (n - 4) // 2)]
        check(sight(marker, pose, hidden=hidden), marker, hidden)


@pytest.mark.parametrize("n", [5, 6, 8])
@pytest.mark.parametrize("strangers", [0, 10])
def test_without_its_ring_a_regular_layout_is_ambiguous(ngon, sight, n, strangers):
    """A pentagon's other four dots fix the place of the fifth, but a ring may have been read as a dot."""
    for pose in range(0, 400, 61):
        found, reason = labels(sight(ngon(n), pose, hidden=[0], strangers=strangers).blobs, ngon(n))
        assert found is None
        assert reason


def test_ring_that_reads_as_a_dot_gives_no_labels(pentagon, sight):
    for pose in range(0, 400, 61):
        blobs = sight(pentagon, pose).blobs
        blobs.ring[:] = False
        blobs.middle[:] = 0
        assert "ambiguous without the key ring" in labels(blobs, pentagon)[1]
        for other in range(5):
            # With another dot hidden, the other four fit with the ring's place free, and turned.
            kept = np.arange(5) != other
            left = blobs.take(kept)
            assert labels(left, pentagon)[0] is None


@pytest.mark.parametrize("n", [5, 8])
def test_strangers_are_passed_over(ngon, sight, n):
    marker = ngon(n)
    for pose in range(0, 400, 61):
        check(sight(marker, pose, strangers=30), marker)


def test_never_wrong_with_dots_hidden_among_strangers(ngon, irregular, sight):
    found = 0
    for trial in range(150):
        rng = np.random.default_rng(trial)
        marker = [ngon(5), ngon(6), ngon(8), irregular, ngon(6, heights=RELIEF)][trial % 5]
        hidden = rng.permutation(len(marker))[: int(rng.integers(1, len(marker) - 3))]
        view = sight(marker, int(rng.integers(400)), hidden=hidden, strangers=int(rng.integers(0, 16)), seed=trial)
        blobs, _ = labels(view.blobs, marker)
        if blobs is not None:
            found += 1
            used = blobs >= 0
            np.testing.assert_array_equal(view.dot[blobs[used]], np.flatnonzero(used))
    # Those without their ring are refused, a third of them, and some where a stranger lies on a dot.
    assert found > 75


def test_mirrored_dots_are_refused(irregular, sight):
    blobs = sight(irregular, 130).blobs
    mirrored = plain_blobs(blobs.center * [-1, 1] + [640, 0], blobs.semi, -blobs.angle, blobs.ring, blobs.covariance)
    assert labels(mirrored, irregular)[0] is None


@pytest.mark.parametrize("n", [4, 5, 6, 8])
def test_mirrored_dots_without_a_camera_are_refused_however_symmetric(ngon, make, sight, n):
    """Any four dots have a homography, and a layout that is nearly symmetric looks nearly the same in a mirror."""
    found = 0
    for trial in range(24):
        rng = np.random.default_rng(trial)
        pose, regular = int(rng.integers(400)), ngon(n, diameter=0.024)
        marker = make(regular.xyz[:, :2] + 0.012 * rng.standard_normal((n, 2)), diameter=0.024)
        blobs = sight(marker, pose, semi_noise=0.02, seed=trial).blobs
        found += labels(blobs, marker, calibrated=False)[0] is not None
        mirrored = plain_blobs(
            blobs.center * [-1, 1] + [639, 0], blobs.semi, -blobs.angle, blobs.ring, blobs.covariance
        )
        assert labels(mirrored, marker, calibrated=False)[0] is None, trial
    # Some of the layouts are symmetric within what is told apart.
    assert found > 18


def test_without_a_camera_four_dots_are_enough_only_if_there_are_no_more(ngon, sight):
    for pose in range(0, 400, 61):
        four = sight(ngon(6), pose, hidden=[2, 5], semi_noise=0.02).blobs
        assert labels(four, ngon(6))[0] is not None
        found, reason = labels(four, ngon(6), calibrated=False)
        assert found is None
        assert reason
        check(sight(ngon(8), pose, hidden=[2, 5], semi_noise=0.02), ngon(8), [2, 5], calibrated=False)


def test_misplaced_dot_is_left_out_or_refused(ngon, sight):
    for n, rest in ((5, 4), (6, 5)):
        for pose in range(3, 400, 61):
            view = sight(ngon(n), pose, noise=0.01)
            moved = np.flatnonzero(view.dot == 2)[0]
            view.blobs.center[moved] += [20, 0]
            found, reason = labels(view.blobs, ngon(n))
            assert found is None or (np.sum(found >= 0) == rest and found[2] == -1), reason
    view = sight(ngon(4), 130)
    view.blobs.center[0] += [20, 0]
    assert labels(view.blobs, ngon(4))[0] is None


@pytest.mark.usefixtures("path")
def test_four_dots_that_nearly_fit_are_a_marker_alone_and_none_among_a_hundred(ngon, sight):
    for moved, strangers, expected in ((1.0, 0, True), (1.0, 100, False), (0.0, 100, True)):
        view = sight(ngon(4), 130, strangers=strangers)
        view.blobs.center[np.flatnonzero(view.dot == 2)[0]] += [moved, 0]
        found, reason = labels(view.blobs, ngon(4))
        assert (found is not None) == expected, reason


def test_corners_of_a_square_grid_are_no_12_gon(ngon):
    x, y = np.meshgrid(np.arange(12), np.arange(12))
    center = np.stack([x, y], axis=-1).reshape(-1, 2) * 27.0 + 60
    rng = np.random.default_rng(0)
    blobs = plain_blobs(
        center, np.full((144, 2), 6.0), np.zeros(144), rng.random(144) < 0.5, np.broadcast_to(np.eye(2), (144, 2, 2))
    )
    start = time.process_time()
    found, reason = labels(blobs, ngon(12))
    assert found is None, reason
    # As bad as it gets, all dots equal and in one plane: 0.7 s here.
    assert time.process_time() - start < 10


def test_every_early_end_has_its_reason(pentagon, sight):
    view = sight(pentagon, 130)
    fields = [getattr(view.blobs, f) for f in ("center", "semi", "angle", "ring", "covariance")]
    assert (
        "found 3 dots, at least 4 of the marker's 5 are needed"
        in labels(plain_blobs(*(f[:3] for f in fields)), pentagon)[1]
    )
    elsewhere = fields[0] * [1, 0.3]
    assert "fit the marker's layout of 5" in labels(plain_blobs(elsewhere, *fields[1:]), pentagon)[1]
    assert (
        "found 5 dots, no key ring"
        in labels(plain_blobs(elsewhere, *fields[1:3], ~np.ones(5, bool), fields[4]), pentagon)[1]
    )
    alien = plain_blobs(elsewhere, fields[1] * [20, 1], *fields[2:])
    assert "not in the marker's layout" in labels(alien, pentagon)[1]


def test_marker_cut_off_by_the_edge_is_said(pentagon, sight):
    view = sight(pentagon, 0, noise=0)
    # Two of five dots beyond the right edge, and strangers too small to be mistaken for them.
    blobs = view.blobs
    shift = 660 - np.sort(blobs.center[:, 0])[3]
    kept = blobs.center[:, 0] + shift < 625
    parts = [getattr(blobs, f)[kept] for f in ("center", "semi", "angle", "ring", "covariance")]
    strangers = [
        np.array([[30, 30.0], [60, 300.0]]),
        np.full((2, 2), 4.0),
        np.zeros(2),
        np.zeros(2, bool),
        np.zeros((2, 2, 2)),
    ]
    cut = plain_blobs(
        *(np.concatenate(pair) for pair in zip([parts[0] + [shift, 0], *parts[1:]], strangers, strict=True))
    )
    assert "cut off" in labels(cut, pentagon)[1]


def test_dots_on_one_line_or_point_are_refused_without_a_warning(pentagon):
    ring, covariance = np.arange(5) == 0, np.broadcast_to(np.eye(2), (5, 2, 2))
    line = np.stack([np.linspace(100, 500, 5), np.full(5, 240.0)], axis=-1)
    for center in (line, np.full((5, 2), 240.0)):
        for calibrated in (True, False):
            blobs = plain_blobs(center, np.full((5, 2), 10.0), np.zeros(5), ring, covariance)
            assert labels(blobs, pentagon, calibrated)[0] is None


@pytest.mark.parametrize("n", [5, 8])
def test_a_doubtful_ring_is_told_by_the_lightest_middle(ngon, sight, n):
    """Blur leaves little of a small hole: the ring is found if no other dot comes near it, and is never guessed."""
    marker = ngon(n)
    for pose in range(0, 400, 61):
        view = sight(marker, pose)
        view.blobs.middle[:] = np.where(view.dot == 0, 0.62, 0.15)
        check(view, marker)
        view.blobs.middle[:] = np.where(view.dot == 0, 0.62, 0.58)
        assert labels(view.blobs, marker)[0] is None


def test_dots_that_the_grey_levels_refuse_carry_no_labeling(pentagon, sight):
    view = sight(pentagon, 130)
    ellipses, seen = undo_lens(view.blobs, PAPER_CAMERA), View(layout_of(pentagon), PAPER_CAMERA)
    for refused, reason in ((2, ""), (3, "most of the 5 that are where dots should be are not round")):
        rough = np.where(np.arange(5) < refused, REFUSED_PX, 0.0)
        found = search(ellipses, seen, np.full(5, ROUGH_PX))
        assert found.reason == ""
        found = confirm(found, ellipses, rough)
        assert (reason in found.reason) if reason else (found.reason == ambiguity(found) == "")


def test_thirty_plain_dots_among_a_thousand(make, sight):
    rng = np.random.default_rng(3)
    points = list[np.ndarray]()
    while len(points) < 30:
        point = rng.uniform(-0.13, 0.13, 2)
        if all(np.linalg.norm(point - other) > 0.02 for other in points):
            points.append(point)
    marker = make(points, rings=(), diameter=0.012)
    check(sight(marker, 3, strangers=970), marker)


def test_a_search_that_ends_early_among_regular_spots_says_so(ngon):
    place = np.stack(np.meshgrid(np.arange(20.0, 620, 15), np.arange(20.0, 460, 15)), axis=-1).reshape(-1, 2)
    many = len(place)
    blobs = plain_blobs(
        place, np.full((many, 2), 5.0), np.zeros(many), np.zeros(many), np.tile(1e-4 * np.eye(2), (many, 1, 1))
    )
    found = search(undo_lens(blobs, PAPER_CAMERA), View(layout_of(ngon(12, rings=())), PAPER_CAMERA))
    assert "full search" in found.reason


def test_rings_that_are_turned_as_a_whole_are_rivals(make, sight):
    """Three rings of many dots, each turned by about 62 deg, fit again; pairs of neighbors do not tell which turn."""
    rng = np.random.default_rng(5)
    counts, radii, turn = (29, 35, 41), (0.09, 0.11, 0.13), np.deg2rad(62)
    angles = [2 * np.pi * np.arange(count) / count for count in counts]
    points = np.concatenate([r * np.exp(1j * a) for r, a in zip(radii, angles, strict=True)])
    points += 0.0015 * rng.normal(size=(len(points), 2)) @ [1, 1j]
    marker = make(np.column_stack([points.real, points.imag]), rings=(), diameter=0.008)
    view = sight(marker, 12)
    ellipses, seen = undo_lens(view.blobs, PAPER_CAMERA), View(layout_of(marker), PAPER_CAMERA)
    blob = np.empty(len(points), dtype=int)
    blob[view.dot] = np.arange(len(points))
    moved = np.abs(points[:, None] * np.exp(1j * turn) - points).argmin(axis=1)
    assert len(set(moved)) == len(points)
    model = Poses(view.rotation[None], view.translation[None])
    wrong = given(blob[moved], model.turned(np.array([turn]), np.zeros((1, 2)), np.zeros((1, 2))), seen)
    np.testing.assert_array_equal(confirm(wrong, ellipses).blobs, blob)
