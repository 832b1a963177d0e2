from dataclasses import replace

import numpy as np
import pytest
from simulated_photos import hand_held

import markergen as mg
from markergen.calibration.photos import Labeled, aligned_to_design, alternatives, relabelings, settle_labels
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import build_marker
from markergen.render import DEFAULT_OPTICS, render_view

CAMERA = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.1, 0.05, 0.0, 0.0, 0.0)))
ROUGH = Camera(640, 480, 760.0, 760.0, 319.5, 239.5)


def grid(columns, rows, pitch=0.025):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows)[::-1])
    places = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) * pitch
    return places - places.mean(axis=0)


def printed(design, rng, sigma=1e-4):
    sag = 5e-4 * (design[:, 0] / np.ptp(design[:, 0]) + 0.3) ** 2
    return design + np.column_stack([rng.normal(0, sigma, (len(design), 2)), sag])


def photographs(places, count, rng, noise=0.05):
    """Dots of hand-held photographs, and their poses."""
    poses = hand_held(count, rng, (15, 55))
    pixels = CAMERA.project(places, *poses)
    return pixels + rng.normal(0, noise, pixels.shape), poses


def options(design, group, pixels, poses, rng, noise=0.05):
    """Labelings of every photograph, in random order; also which of them is right."""
    all_options, right = [], []
    for seen, rotation, translation in zip(pixels, *poses, strict=True):
        order = rng.permutation(len(group))
        ours = []
        for item in (group[k] for k in order):
            spread = np.broadcast_to(noise**2 * np.eye(2), (len(design), 2, 2))
            ours.append(Labeled(item.image, seen, spread, item.pose(rotation, translation)))
        all_options.append(ours)
        right.append(int(np.flatnonzero(order == 0)[0]))
    return all_options, right


@pytest.mark.parametrize(("columns", "rows", "turns"), [(6, 5, 2), (5, 5, 4), (5, 1, 2)])
def test_a_grid_is_itself_when_turned(columns, rows, turns):
    design = grid(columns, rows)
    group = relabelings(design, np.zeros(len(design), dtype=bool))
    whole = [relabeling for relabeling in group if (relabeling.image >= 0).all()]
    assert len(whole) == turns
    np.testing.assert_array_equal(group[0].image, np.arange(len(design)))
    for relabeling in whole:
        moved = design[:, :2] @ relabeling.rotation.T + relabeling.translation
        np.testing.assert_allclose(moved, design[relabeling.image, :2], rtol=0, atol=1e-12)
    # A ring at one corner leaves no turn.
    rings = np.arange(len(design)) == 0
    assert [len(relabeling.image) for relabeling in relabelings(design, rings) if (relabeling.image >= 0).all()] == [
        len(design)
    ]


def test_a_moved_layout_looks_the_same_from_its_pose():
    design = grid(6, 5)
    rotation, translation = hand_held(1, np.random.default_rng(0))
    for relabeling in relabelings(design, np.zeros(30, dtype=bool)):
        kept = relabeling.image >= 0
        rotated = (part[None] for part in relabeling.pose(rotation[0], translation[0]))
        ours, theirs = CAMERA.project(design, rotation, translation)[0], CAMERA.project(design, *rotated)[0]
        np.testing.assert_allclose(theirs[relabeling.image[kept]], ours[kept], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("columns", "rows", "camera"), [(6, 5, CAMERA), (6, 5, ROUGH), (5, 5, ROUGH)])
def test_photographs_tell_the_labels_of_a_symmetric_grid(columns, rows, camera):
    rng = np.random.default_rng(columns)
    design = grid(columns, rows)
    group = [
        relabeling for relabeling in relabelings(design, np.zeros(len(design), bool)) if (relabeling.image >= 0).all()
    ]
    pixels, poses = photographs(printed(design, rng), 5, rng)
    choices, right = options(design, group, pixels, poses, rng)
    settled = settle_labels(choices, design, np.zeros(len(design)), camera)
    assert settled.sure
    # Up to one turn of all photographs together.
    turns = set()
    for guess, ours, k in zip(settled.guesses, choices, right, strict=True):
        turns.add(tuple(guess.index[np.argsort(ours[k].index)]))
    assert len(turns) == 1


def test_an_exact_print_leaves_the_labels_in_doubt():
    rng = np.random.default_rng(1)
    design = grid(6, 5)
    group = [relabeling for relabeling in relabelings(design, np.zeros(30, bool)) if (relabeling.image >= 0).all()]
    choices, _ = options(design, group, *photographs(design, 4, rng), rng)
    assert not settle_labels(choices, design, np.zeros(30), CAMERA).sure


@pytest.mark.parametrize("larger", [False, True])
def test_the_turn_of_all_together_is_told_by_a_dot_of_another_size_or_not_at_all(larger):
    rng = np.random.default_rng(2)
    design, radii = grid(6, 5), np.full(30, 0.006)
    if larger:
        radii[3] *= 1.2
    group = [relabeling for relabeling in relabelings(design, np.zeros(30, bool)) if (relabeling.image >= 0).all()]
    pixels, poses = photographs(printed(design, rng), 4, rng)
    choices, right = options(design, group, pixels, poses, rng)
    # All photographs wrong by the same half turn.
    wrong = [ours[1 - k] for ours, k in zip(choices, right, strict=True)]
    area = 2 * np.log(radii) + rng.normal(0, 0.03, 30)
    wrong = [replace(relabeling, area=area) for relabeling in wrong]
    settled = settle_labels([[relabeling] for relabeling in wrong], design, radii, CAMERA)
    rotated, output = aligned_to_design(settled, group, design, radii, CAMERA)
    assert output == larger
    if larger:
        for guess in rotated.guesses:
            np.testing.assert_array_equal(guess.index, np.arange(30))


@pytest.mark.parametrize(("sharp", "count"), [(30, 1), (4, 1), (3, 0), (0, 0)])
def test_a_photograph_with_three_dots_or_fewer_at_their_places_has_no_labels(sharp, count):
    design, none = grid(6, 5), np.zeros(30, dtype=bool)
    (pixels,), (rotation, translation) = photographs(design, 1, np.random.default_rng(3))
    spread = np.broadcast_to(np.eye(2), (31, 2, 2))
    rough = Labeled(np.arange(30), pixels, spread[:30], (rotation[0], translation[0]), open=True)
    # Blur hides the others; one blob is of something else.
    blobs = np.concatenate([pixels[:sharp], [[1.0, 1.0]]])
    dots = blobs, spread[: sharp + 1], np.full(sharp + 1, 200.0)
    labelings = alternatives(rough, relabelings(design, none)[:1], design, np.full(30, 0.006), CAMERA, dots)
    assert [len(labeling.index) for labeling in labelings] == [sharp] * count


def test_mirrored_photographs_are_not_taken_for_others():
    # The ring is where the mirrored layout has a disk, and all else fits.
    rng = np.random.default_rng(4)
    corners = 0.001 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    places = np.concatenate([corners * side for side in ((25, 83), (67, 83), (67, 41))])
    marker = build_marker(places, Circle(0.13), 0.03, 0.003)
    images = [
        np.ascontiguousarray(render_view(marker, CAMERA, rotation, translation, DEFAULT_OPTICS, rng)[:, ::-1])
        for rotation, translation in zip(*hand_held(4, rng, (15, 40)), strict=True)
    ]
    with pytest.raises(InputError, match=r"none of 4.*the mirrored layout fits"):
        mg.calibrate(marker, images)
