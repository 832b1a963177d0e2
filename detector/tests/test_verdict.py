"""Verdicts in C against dense adjustments in NumPy, and against what was put wrong."""

import ctypes

import numpy as np
import pytest
from markergen_detect.core import constants, library, structures
from markergen_detect.verdict import CAUSES, read_verdict
from structures import ErrorsStruct
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

NOISE_PX = 0.03


def judge(dots, blobs, struct, start, errors=None):
    """Return the estimate and its verdict; sides of a rig have the axes that `views.rig` gives them."""
    errors, matches = errors or ErrorsStruct(), matched(len(blobs))
    kept, actual, matches = estimate(dots, blobs, struct, start, errors, matches)
    assert kept
    plates, verdict = np.zeros(dots["plate"].max() + 1, structures()["Pose"]), np.zeros(1, structures()["Verdict"])
    rotated = [np.roll(np.eye(3), k, axis=0).T for k in range(len(plates))]
    plates["R"] = np.reshape(rotated, (-1, 9))
    plates["t"] = 0.06 * (len(plates) > 1) * np.array(rotated)[:, :, 2]
    addresses = pointer(dots), pointer(blobs), pointer(matches), ctypes.byref(struct), ctypes.byref(errors)
    count = ctypes.c_int64(len(plates))
    assert library().judge(*addresses, pointer(plates), count, pointer(actual.reshape(1)), pointer(verdict)) == 0
    return actual, verdict[0]


def seen(rng, dots, pose, struct, real=None, move=None):
    """Return blobs of printed dots in an image, whose pixels move by `move` of the offset from the center."""
    printed = (dots if real is None else real).copy()
    ours = np.linalg.cholesky(dots["print"] + 1e-30 * np.eye(3)) @ rng.normal(size=(len(dots), 3, 1))
    printed["place"] += ours[:, :, 0]
    pixels = pixels_of(struct, outlines(printed, pose_of(*pose))["center"])
    pixels += move(pixels - CENTER) if move else 0
    return blobs_of(struct, pixels + rng.normal(0, NOISE_PX, pixels.shape), NOISE_PX)


def tilted(rng, angle):
    """Return a pose that sees a plate tilted by an angle, in rad."""
    around = rng.uniform(0, 2 * np.pi)
    lean = turn(angle * np.array([np.cos(around), np.sin(around), 0]))
    return lean @ np.diag([1.0, -1, -1]) @ turn([0, 0, rng.uniform(0, 6)]), np.array([0.02, -0.01, 0.4])


def likely(verdict):
    return [cause["kind"] for cause in verdict["causes"][: verdict["likely"]]]


def test_chi2_is_that_of_the_whole_covariance(rng):
    dots, pose = rig(rng, 6)
    n, struct, moved, alone = len(dots), camera(RADTAN), common_errors(rng, dots), dots["print"].copy()
    factor = rng.normal(size=(9, 9)) * np.array([1, 1, 1, 1, 0.01, 0.01, 1e-3, 1e-3, 0.01])[:, None]
    factor[1] = factor[0]  # fx and fy are one
    calibration = factor @ factor.T
    errors = ErrorsStruct(3, *(array.ctypes.data for array in (moved, alone, factor)))
    blobs = seen(rng, dots, pose, struct)
    actual, verdict = judge(dots, blobs, struct, pose_of(*pose), errors)
    at = actual["pose"]["R"], actual["pose"]["t"]

    def image(step=np.zeros, places=0.0, parameters=np.zeros):
        step, parameters = (value(9) if callable(value) else value for value in (step, parameters))
        other = camera([c + p for c, p in zip(RADTAN, parameters[4:], strict=True)])
        other.fx, other.fy, other.cx, other.cy = np.array([*FOCAL, *CENTER]) + parameters[:4]
        real = dots.copy()
        real["place"] += places
        drawn = outlines(real, pose_of(turn(step[:3]) @ at[0], at[1] + step[3:6]))
        return pixels_of(other, drawn["center"])

    def derivative(name, directions):
        return np.stack([(image(**{name: d}) - image(**{name: -d})).ravel() for d in directions], axis=-1) / 2e-6

    rows, lens = derivative("step", 1e-6 * np.eye(9)[:6]), derivative("parameters", 1e-6 * np.eye(9))
    shifted = derivative("places", 1e-6 * np.eye(3)[:, None, :]).reshape(n, 2, 3)
    together = np.einsum("nij,njk->nik", shifted, moved).reshape(2 * n, 3)
    spread = together @ together.T + lens @ calibration @ lens.T
    for i in range(n):
        part = slice(2 * i, 2 * i + 2)
        spread[part, part] += (NOISE_PX**2 + 0.05**2) * np.eye(2) + shifted[i] @ alone[i] @ shifted[i].T
    whitened = np.linalg.inv(np.linalg.cholesky(spread))
    offset = (blobs["center"] - image()).ravel()
    left = np.linalg.lstsq(whitened @ rows, whitened @ offset, rcond=None)[1][0]
    # Offsets from the outlines' centers, which the lens moves by some thousandths of a pixel.
    assert verdict["chi2"] == pytest.approx(left, rel=1e-2)
    assert verdict["freedom"] == 2 * n - 6
    assert verdict["consistent"]


@pytest.mark.parametrize("body", ["plate", "rig"])
def test_one_in_a_thousand_is_inconsistent_at_most(rng, body):
    inconsistent, count = 0, 1000
    for _ in range(count):
        dots, pose = rig(rng, 3) if body == "rig" else (plate(rng, 6), facing_pose(rng))
        inconsistent += not judge(dots, seen(rng, dots, pose, camera()), camera(), pose_of(*pose))[1]["consistent"]
    assert inconsistent <= 4


WRONG = {
    "FOCAL_LENGTH": (1.0, -0.22, lambda value: {"move": lambda offset: np.expm1(value) * offset}),
    "ASPECT": (0.0, 0.03, lambda value: {"move": lambda offset: np.expm1(value) * offset * [0, 1]}),
    "DISTORTION": (
        0.5,
        4.0,
        lambda value: {"move": lambda offset: value * offset * np.sum((offset / FOCAL) ** 2, axis=-1)[:, None]},
    ),
    "SHUTTER": (0.0, 0.03, lambda value: {"move": lambda offset: value * offset[:, 1:] * [1, 0]}),
    "STRETCH_X": (0.1, -0.03, lambda value: {"place": lambda x: x * [1 + value, 1, 1]}),
    "BEND_X": (
        0.6,
        3e-3,
        lambda value: {"place": lambda x: x + value * np.outer((x[:, 0] / 0.05) ** 2, [0, 0, 1])},
    ),
    "BEND_Y": (
        0.6,
        -3e-3,
        lambda value: {"place": lambda x: x + value * np.outer((x[:, 1] / 0.05) ** 2, [0, 0, 1])},
    ),
}
"""Tilt at which a cause is plain, its value, and what it does."""


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_the_likely_cause(rng, kind):
    tilt, value, wrong = WRONG[kind]
    errors, named = [], 0
    for _ in range(20):
        dots, pose, does = plate(rng, 20), tilted(rng, tilt), wrong(value)
        dots["xyz"][:4, :2] = dots["place"][:4, :2] = 0.05 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        real = dots.copy()
        real["place"] = does.get("place", lambda place: place)(dots["place"])
        blobs = seen(rng, dots, pose, camera(), real, does.get("move"))
        _, verdict = judge(dots, blobs, camera(), pose_of(*pose))
        assert not verdict["consistent"]
        named += likely(verdict)[:1] == [constants()[kind]]
        errors += [
            (c["value"] - value) / c["sigma"]
            for c in verdict["causes"][: verdict["likely"]]
            if c["kind"] == constants()[kind]
        ]
    assert named >= 17
    assert len(errors) >= 17
    assert np.sqrt(np.mean(np.square(errors))) < 2


def test_the_focal_length_is_exact_through_a_strong_lens(rng):
    strong, dots, errors = camera((-0.3, 0.1, 0.0, 0.0, 0.0)), plate(rng, 30, sigma=1e-5), []
    dots["xyz"] *= 3
    dots["place"] *= 3
    for _ in range(20):
        pose = tilted(rng, 0.8)
        blobs = seen(rng, dots, pose, strong, move=lambda offset: -0.1 * offset)
        cause = judge(dots, blobs, strong, pose_of(*pose))[1]["causes"][0]
        assert cause["kind"] == constants()["FOCAL_LENGTH"]
        errors.append((cause["value"] - np.log(0.9)) / cause["sigma"])
    assert np.sqrt(np.mean(np.square(errors))) < 2


@pytest.mark.parametrize("kind", ["FOCAL_LENGTH", "DISTORTION"])
def test_a_frontal_view_does_not_show_it(rng, kind):
    """A plane seen from the front looks the same with any focal length, and nearly so with any distortion."""
    _, value, wrong = WRONG[kind]
    dots, pose = plate(rng, 20), tilted(rng, 0.0)
    blobs = seen(rng, dots, pose, camera(), move=wrong(value / 4)["move"])
    assert judge(dots, blobs, camera(), pose_of(*pose))[1]["consistent"]


def test_the_misplaced_plate_of_a_rig_is_named(rng):
    dots, pose = rig(rng, 8)
    real, ours = dots.copy(), dots["plate"] == 1
    middle = dots["place"][ours].mean(axis=0)
    real["place"][ours] = (dots["place"][ours] - middle) @ turn([0.01, -0.02, 0.03]).T + middle + [0, 1e-3, 0]
    _, verdict = judge(dots, seen(rng, dots, pose, camera(), real), camera(), pose_of(*pose))
    assert not verdict["consistent"]
    assert constants()["MISPLACED"] in likely(verdict)
    assert 1 in [cause["plate"] for cause in verdict["causes"][: verdict["likely"]]]


def test_errors_as_stated_are_consistent(rng):
    """A scale that may be wrong by 3 %, along x alone, explains a print of 97 %."""
    dots, pose = plate(rng, 20), tilted(rng, 0.1)
    real, moved = dots.copy(), np.zeros((20, 3, 1))
    real["place"][:, 0] *= 0.97
    moved[:, 0, 0] = 0.03 * dots["place"][:, 0]
    blobs = seen(rng, dots, pose, camera(), real)
    assert not judge(dots, blobs, camera(), pose_of(*pose))[1]["consistent"]
    assert judge(dots, blobs, camera(), pose_of(*pose), ErrorsStruct(1, moved.ctypes.data, None, None))[1]["consistent"]


def test_verdicts_in_words(rng):
    dots, pose = plate(rng, 20), tilted(rng, 0.1)
    blobs = seen(rng, dots, pose, camera())
    assert str(read_verdict(judge(dots, blobs, camera(), pose_of(*pose))[1].reshape(1), ["front"])) == "consistent"
    row = np.zeros(1, structures()["Verdict"])
    row["chi2"], row["limit"], row["freedom"], row["count"] = 160, 30, 10, len(CAUSES)
    for cause, name in zip(row["causes"][0], CAUSES, strict=False):
        cause["kind"], cause["plate"] = constants()[name.upper().replace(" ", "_")], 0 if name == "misplaced" else -1
        cause["chi2"], cause["value"], cause["sigma"] = 40, -0.03, 0.002
    large = "inconsistent: residuals are 4.0 times as large as expected; "
    assert str(read_verdict(row, ["+x"])) == large + "no single cause explains it"
    row["likely"] = len(CAUSES)
    lines = [
        "camera file: the focal length is 97.0 +- 0.2 % of the file's",
        "camera file: fy/fx is 97.0 +- 0.2 % of the file's",
        "camera file: k1 differs by -0.030 +- 0.002",
        "print stretched: 97.0 +- 0.2 % along x",
        "print stretched: 97.0 +- 0.2 % along y",
        "bent by -30.0 +- 2.0 mm along x",
        "bent by -30.0 +- 2.0 mm along y",
        "rolling shutter: -0.030 +- 0.002 px from row to row",
        "+x is -30.0 +- 2.0 mm from its place",
        "camera file: focal length, fy/fx and k1 together",
        "bent by -30.0 +- 2.0 mm",
    ]
    assert str(read_verdict(row, ["+x"])) == large + "; or ".join(lines)
