"""Poses in C against points on rims, differences, closed forms in NumPy, and samples."""

import ctypes

import numpy as np
import pytest
from markergen_detect.core import library
from numpy.testing import assert_allclose
from structures import POSE, ErrorsStruct
from views import (
    CENTER,
    FOCAL,
    RADTAN,
    blobs_of,
    camera,
    common_errors,
    estimate,
    facing_pose,
    matched,
    outlines,
    pixels_of,
    plate,
    pointer,
    pose_of,
    rig,
    turn,
)

NOTHING = np.zeros(9)
CONTENDER, CHI2_6 = 1e-3, 12.592
"""Least likelihood of a second pose; 95 % of chi-squared with 6 degrees of freedom."""


def refine(dots, seen, weight, pose, focal=0.0, steps=20):
    arrays = (dots, matched(len(dots))), (np.ascontiguousarray(seen), np.ascontiguousarray(weight))
    labeled, measured = (map(pointer, part) for part in arrays)
    return library().refine_pose(*labeled, len(dots), *measured, 1, focal, steps, 1e-10, pointer(pose))


def chi2_of(dots, seen, weight, pose):
    offset = seen - outlines(dots, pose)["center"]
    return np.sum(weight * np.stack([offset[:, 0] ** 2, 2 * offset[:, 0] * offset[:, 1], offset[:, 1] ** 2], axis=-1))


def test_rims_are_on_the_ellipses(rng):
    dots, pose = rig(rng, 4)
    drawn = outlines(dots, pose_of(*pose, focal=1.3))
    for dot, ellipse in zip(dots, drawn, strict=True):
        across = np.linalg.svd(dot["normal"][None])[2][1:]
        angle = np.linspace(0, 6, 9)[:, None]
        rim = dot["place"] + dot["radius"] * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
        places = rim @ pose[0].T + pose[1]
        offset = 1.3 * places[:, :2] / places[:, 2:] - ellipse["center"]
        shape = ellipse["shape"][[[0, 1], [1, 2]]]
        assert_allclose(np.einsum("ki,ij,kj->k", offset, np.linalg.inv(shape), offset), 1, rtol=1e-7)
        place = pose[0] @ dot["place"] + pose[1]
        assert_allclose(ellipse["point"], 1.3 * place[:2] / place[2], rtol=1e-13)
        assert_allclose(ellipse["facing"], -place @ pose[0] @ dot["normal"] / np.linalg.norm(place), rtol=1e-13)
        assert ellipse["seen"]
        assert ellipse["depth"] == pytest.approx(place[2])


def test_back_sides_are_not_seen(rng):
    dots, (rotation, translation) = rig(rng, 1)
    behind = pose_of(rotation @ np.diag([-1.0, -1, 1]), translation)
    assert not outlines(dots, behind)["seen"].all()
    assert not outlines(dots, pose_of(rotation, -translation))["seen"].any()
    assert refine(dots, np.zeros((3, 2)), np.ones((3, 3)) * [1, 0, 1], behind) == np.inf


@pytest.mark.parametrize("focal", [0.0, 0.05])
def test_refinement_ends_at_a_minimum(rng, focal):
    dots, (rotation, translation) = rig(rng, 5)
    pose = pose_of(rotation, translation)
    seen = outlines(dots, pose)["center"] + rng.normal(0, 1e-3, (15, 2))
    weight = np.full((15, 3), 1e6) * [1, 0.2, 1]
    actual = pose_of(turn([0.02, -0.03, 0.01]) @ rotation, translation * 1.02)
    chi2 = refine(dots, seen, weight, actual, focal)

    def cost(step):
        scale = actual["focal"] * np.exp(step[6])
        moved = pose_of(turn(step[:3]) @ actual["R"][0], actual["t"][0] + step[3:6], scale)
        prior = (np.log(scale[0]) / focal) ** 2 if focal else 0.0
        return chi2_of(dots, seen, weight, moved) + prior

    unknowns = 7 if focal else 6
    step = 1e-5 * np.eye(7)[:unknowns]
    assert cost(np.zeros(7)) == pytest.approx(chi2, rel=1e-12)
    gradient = np.array([cost(move) - cost(-move) for move in step]) / 2e-5
    curvature = np.array([cost(move) + cost(-move) - 2 * chi2 for move in step]) / 1e-10
    # Its derivatives are those of the disks' centers.
    assert_allclose(gradient / np.sqrt(curvature / 2), 0, atol=2e-2)
    assert (actual["focal"] != 1) == bool(focal)


def test_the_mirrored_pose_reflects_the_normal(rng):
    dots = plate(rng, 6)
    rotation, translation = facing_pose(rng)
    other = np.zeros(1, POSE)
    library().mirrored_pose(
        pointer(dots), pointer(matched(6)), ctypes.c_int64(6), pointer(pose_of(rotation, translation)), pointer(other)
    )
    middle = dots["place"].mean(axis=0)
    place = rotation @ middle + translation
    sight = place / np.linalg.norm(place)
    assert_allclose(other["R"][0] @ middle + other["t"][0], place, atol=1e-14)
    normal = rotation[:, 2]
    assert_allclose(other["R"][0, :, 2], 2 * (normal @ sight) * sight - normal, atol=1e-14)
    assert_allclose(other["R"][0] @ other["R"][0].T, np.eye(3), atol=1e-14)


def test_covariances_have_the_closed_form(rng):
    dots, pose = rig(rng, 30)
    n, struct, moved = len(dots), camera(RADTAN), common_errors(rng, dots)
    factor = rng.normal(size=(9, 9)) * np.array([3, 3, 2, 2, 0.01, 0.01, 1e-3, 1e-3, 0.01])[:, None]
    calibration, alone = factor @ factor.T, dots["print"] * 0.7
    errors = ErrorsStruct(3, *(array.ctypes.data for array in (moved, alone, factor)))
    pixels = pixels_of(struct, outlines(dots, pose_of(*pose))["center"])
    sigma = rng.uniform(0.02, 0.06, n)
    kept, actual, _ = estimate(dots, blobs_of(struct, pixels, sigma), struct, pose_of(*pose), errors)
    assert kept == n
    assert actual["scale"] == 1

    def image(step=NOTHING, places=0.0, parameters=NOTHING):
        place = (dots["place"] + places) @ (turn(step[:3]) @ pose[0]).T + pose[1] + step[3:6]
        other = camera([c + p for c, p in zip(RADTAN, parameters[4:], strict=True)])
        other.fx, other.fy, other.cx, other.cy = np.array([*FOCAL, *CENTER]) + parameters[:4]
        return pixels_of(other, place[:, :2] / place[:, 2:])

    def derivative(name, directions):
        return np.stack([(image(**{name: d}) - image(**{name: -d})).ravel() for d in directions], axis=-1) / 2e-6

    rows = derivative("step", 1e-6 * np.eye(6))
    shifted = derivative("places", 1e-6 * np.eye(3)[:, None, :]).reshape(n, 2, 3)
    noise, printed, ours = np.zeros((3, 2 * n, 2 * n))
    for i in range(n):
        part = slice(2 * i, 2 * i + 2)
        noise[part, part] = sigma[i] ** 2 * np.eye(2)
        printed[part, part] = shifted[i] @ dots["print"][i] @ shifted[i].T
        ours[part, part] = shifted[i] @ alone[i] @ shifted[i].T
    weighted = np.linalg.solve(noise + printed, rows)
    gain = weighted @ np.linalg.inv(rows.T @ weighted)
    together = np.einsum("nij,njk->nik", shifted, moved).reshape(2 * n, 3)
    lens = derivative("parameters", 1e-6 * np.eye(9))
    for name, part in (
        ("image", noise),
        ("print", ours + together @ together.T),
        ("calibration", lens @ calibration @ lens.T),
    ):
        reference = gain.T @ part @ gain
        size = np.sqrt(np.diag(reference))
        # The image's covariance is carried through the lens at the ellipses' centers.
        assert_allclose(actual[name] / size / size[:, None], reference / size / size[:, None], atol=1e-3)
    assert_allclose(actual["covariance"], actual["image"] + actual["print"] + actual["calibration"])


@pytest.mark.parametrize("count", [400, pytest.param(2000, marks=pytest.mark.long)])
@pytest.mark.parametrize("body", ["plate", "rig"])
def test_regions_of_95_percent_hold_as_many(rng, body, count):
    """Poses with errors of image, print, what is common to dots, and the camera."""
    inside = 0
    root = np.diag([2.0, 2, 1.5, 1.5, 3e-3, 3e-3, 3e-4, 3e-4, 3e-3])
    for _ in range(count):
        dots, pose = rig(rng, 8) if body == "rig" else (plate(rng, 16), facing_pose(rng))
        moved = common_errors(rng, dots)
        real = dots.copy()
        ours = np.einsum("nij,nj->ni", dots["print"] / 1e-4, rng.normal(size=(len(dots), 3)))
        real["place"] += ours + moved @ rng.normal(size=3)
        parameters = root @ rng.normal(size=9)
        real_camera, struct = camera([c + p for c, p in zip(RADTAN, parameters[4:], strict=True)]), camera(RADTAN)
        real_camera.fx, real_camera.fy, real_camera.cx, real_camera.cy = np.array([*FOCAL, *CENTER]) + parameters[:4]
        pixels = pixels_of(real_camera, outlines(real, pose_of(*pose))["center"]) + rng.normal(0, 0.04, (len(dots), 2))
        alone = dots["print"].copy()
        dots["print"] += moved @ moved.swapaxes(1, 2)
        errors = ErrorsStruct(3, moved.ctypes.data, alone.ctypes.data, root.ctypes.data)
        start = pose_of(turn(rng.normal(0, 3e-3, 3)) @ pose[0], pose[1] * 1.003)
        _, actual, _ = estimate(dots, blobs_of(struct, pixels, 0.04), struct, start, errors)
        wrong = actual["pose"]["R"] @ pose[0].T
        error = np.array([wrong[2, 1] - wrong[1, 2], wrong[0, 2] - wrong[2, 0], wrong[1, 0] - wrong[0, 1]]) / 2
        error = np.concatenate([error, actual["pose"]["t"] - pose[1]])
        inside += error @ np.linalg.solve(actual["covariance"], error) < CHI2_6
    # 2 % for 2,000 poses.
    assert abs(inside / count - 0.95) < 4.1 * np.sqrt(0.95 * 0.05 / count)


@pytest.mark.parametrize("n", [7, 90])
def test_outliers_are_dropped_and_become_the_last(rng, n):
    dots, pose, struct = plate(rng, n), facing_pose(rng), camera()
    pixels = pixels_of(struct, outlines(dots, pose_of(*pose))["center"]) + rng.normal(0, 0.03, (n, 2))
    pixels[2] += [3, -2]
    kept, actual, matches = estimate(dots, blobs_of(struct, pixels, 0.03), struct, pose_of(*pose))
    assert kept == actual["count"] == n - 1
    assert list(matches["dot"]) == [*(i for i in range(n) if i != 2), 2]
    assert actual["freedom"] == 2 * n - 8
    alone = estimate(dots, blobs_of(struct, pixels, 0.03), struct, pose_of(*pose), matches=np.delete(matched(n), 2))
    assert_allclose(actual["pose"]["t"], alone[1]["pose"]["t"], rtol=1e-6)


def test_the_other_pose_of_a_far_plate(rng):
    dots, struct = plate(rng, 8), camera()
    rotation, translation = facing_pose(rng, tilt=0.3, near=4, far=5)
    blobs = blobs_of(struct, pixels_of(struct, outlines(dots, pose_of(rotation, translation))["center"]), 0.05)
    _, actual, _ = estimate(dots, blobs, struct, pose_of(rotation, translation))
    assert CONTENDER < actual["likelihood"] <= 1
    _, other, _ = estimate(dots, blobs, struct, actual["other"].reshape(1))
    assert_allclose(other["pose"]["R"], actual["pose"]["R"], atol=1e-3)
    close = facing_pose(rng, tilt=0.7, near=0.2, far=0.25)
    blobs = blobs_of(struct, pixels_of(struct, outlines(dots, pose_of(*close))["center"]), 0.05)
    assert estimate(dots, blobs, struct, pose_of(*close))[1]["likelihood"] == 0


def test_a_pose_from_behind_is_none(rng):
    dots, (rotation, translation) = plate(rng, 6), facing_pose(rng)
    blobs = blobs_of(camera(), rng.uniform(0, 400, (6, 2)), 0.05)
    assert estimate(dots, blobs, camera(), pose_of(rotation, -translation))[0] == 0


def plane_homography(pose):
    matrix = np.array([[FOCAL[0], 0, CENTER[0]], [0, FOCAL[1], CENTER[1]], [0, 0, 1]])
    plane = matrix @ np.column_stack([pose[0][:, :2], pose[1]])
    return plane / plane[2, 2]


@pytest.mark.parametrize("on_a_line", [0, 8])
@pytest.mark.parametrize("lens", [(), RADTAN])
def test_homography_without_a_camera(rng, on_a_line, lens):
    dots, pose, struct = plate(rng, 9), facing_pose(rng), camera(lens)
    corrected, actual = np.zeros((9, 2)), np.zeros((3, 3))
    drawn = outlines(dots, pose_of(*pose))
    blobs = blobs_of(struct, pixels_of(struct, drawn["center"]), 0.05)
    blobs["at"] = drawn["center"]
    dots["xyz"][:on_a_line, 1] = dots["xyz"][:on_a_line, 0]
    arrays = *map(pointer, (dots, blobs, matched(9))), 9, ctypes.byref(struct), pointer(corrected), pointer(actual)
    assert library().correct_centers(*arrays) == (0 if on_a_line else 1)
    if on_a_line or not lens:
        assert_allclose(actual, np.zeros((3, 3)) if on_a_line else plane_homography(pose), rtol=1e-4)
    assert_allclose(corrected, pixels_of(struct, drawn["center" if on_a_line else "point"]), atol=1e-4)


def test_centers_of_dots_go_through_the_lens(rng):
    dots, pose, struct, pixel = plate(rng, 5), facing_pose(rng), camera(RADTAN), np.zeros(2)
    drawn = outlines(dots, pose_of(*pose))
    blobs = blobs_of(struct, pixels_of(struct, drawn["center"]), 0.05)
    blobs["at"] = drawn["center"]
    for i in range(5):
        arguments = pointer(dots[i:]), pointer(blobs[i:]), pointer(pose_of(*pose)), ctypes.byref(struct), pointer(pixel)
        assert library().dot_pixel(*arguments) == 1
        assert_allclose(pixel, pixels_of(struct, drawn["point"][i : i + 1])[0], atol=1e-9)
