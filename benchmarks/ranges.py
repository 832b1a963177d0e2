"""A landing pad from 0.3 to 10 m, beside a nested pair of AprilTags and an ArUco tag in the same disk.

    python -m benchmarks.ranges --views 1000

Views of the paper's camera with the default optics, distances uniform in their logarithm, tilts up to 45 deg. The pad
is that of `markergen design --n auto --radius 0.5 --poses cone:distance=0.3..10m,tilt=0..45`, or of `--marker`. The
pair is tag 36h11:0 with 36h11:1 in the white cell nearest its center, read by pupil-apriltags; its pose is from the
corners of both, if both are read. For each range of distance: views in which it is found, wrong labels (a point off by
5 px or more), RMS and median of the rotation error, and for the pad the bound from the image noise of the dots that are
whole in the image and large enough. `noise` is the RMS of the errors of dots of 6 px and more over their own bounds,
and `ratio` that of the rotation over its bound for the views' own noise, that is the bound times `noise`. Where the
bound exceeds 2.5 deg medians are compared instead. Flips are nearer to the mirrored pose than to the true one, and 3 of
the pad's bounds from it; they are in the RMS.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

import markergen as mg
from markergen.arrays import Array
from markergen.bounds.dot_covariances import dot_information
from markergen.comparison.contestants.printed import pose_of
from markergen.comparison.contestants.pupil import PupilTag
from markergen.comparison.contestants.tags import SquareTag, tag_in
from markergen.detect import detect
from markergen.estimators.budget import ErrorSources
from markergen.maths.information import covariance, mirrored_rotation, rotation_bound
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import Marker
from markergen.model.pose_sources.cone import Cone
from markergen.model.poses import PoseDistribution
from markergen.model.sight import coverage, disks_in_view
from markergen.model.spec import ImageNoise
from markergen.render import DEFAULT_OPTICS, Patch, circle, render_patches, render_view
from markergen.validation.bounds import image_covariance

Found = tuple[Array, Array, Array] | None
"""Errors in px of the points found, those of large dots over their bounds, and the rotation of the pose."""

Look = Callable[[Array, Array, np.random.Generator], Found]

RADIUS, NEAREST, FARTHEST = 0.5, 0.3, 10.0
WIDE = f"cone:distance={NEAREST}..{FARTHEST:g}m,tilt=0..45"
EDGES = (0.3, 0.45, 0.7, 1.0, 1.5, 2.2, 3.3, 4.8, 7.0, 10.0)
SETTINGS: Mapping[type[SquareTag], Mapping[str, str]] = {
    PupilTag: {"detector": "quad_decimate 1", "image": "image x2"},
    SquareTag: {"detector": "APRILTAG", "image": "image x2"},
}
WRONG_PX, STEEP_DEG, APART = 5.0, 2.5, 3.0


def poses_of(count: int, seed: int) -> PoseDistribution:
    """Random poses with distances uniform in their logarithm."""
    rotation, ahead = Cone((1.0, 1.0), (0.0, 45.0), count=count, seed=seed, sampling="random").sample()
    distance = np.exp(np.random.default_rng([seed, 1]).uniform(np.log(NEAREST), np.log(FARTHEST), count))
    return PoseDistribution("log-uniform", rotation, ahead * distance[:, None])


def pad_contestant(pad: Marker) -> Look:
    """Render and detect the pad."""

    def look(rotation: Array, translation: Array, rng: np.random.Generator) -> Found:
        image = render_view(pad, PAPER_CAMERA, rotation, translation, DEFAULT_OPTICS, rng)
        finding = detect(image, pad, PAPER_CAMERA, ErrorSources(print_sigma=0.0))
        if not finding.ok:
            return None
        truth = PAPER_CAMERA.project(pad.xyz[finding.ids], rotation[None], translation[None])[0]
        here = PoseDistribution("here", rotation[None], translation[None])
        least = image_covariance(pad, PAPER_CAMERA, here, DEFAULT_OPTICS)[0, finding.ids]
        off = np.linalg.norm(finding.pixels - truth, axis=-1)
        assert finding.pose is not None
        large = disks_in_view(pad.xyz, 2 * pad.radii, PAPER_CAMERA, here)[0, finding.ids]
        return off, off[large] / np.sqrt(np.trace(least[large], axis1=-2, axis2=-1)), finding.pose.rotation

    return look


def tag_contestant(tags: Sequence[SquareTag]) -> Look:
    """Render tags on one white disk, and detect each with its own settings."""
    plate = Patch((circle(np.zeros(3), RADIUS),), 1.0)
    ink = [Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in tag.tag.outlines), 0.0) for tag in tags]

    def look(rotation: Array, translation: Array, rng: np.random.Generator) -> Found:
        image = render_patches([plate, *ink], PAPER_CAMERA, rotation, translation, DEFAULT_OPTICS, rng)
        read = [(tag, tag.sight(image, PAPER_CAMERA, SETTINGS[type(tag)], 0.0)) for tag in tags]
        reference = [(tag.points, finding.pixels) for tag, finding in read if len(finding.ids)]
        if not reference:
            return None
        points, pixels = (np.concatenate(part) for part in zip(*reference, strict=True))
        truth = PAPER_CAMERA.project(points, rotation[None], translation[None])[0]
        off = np.linalg.norm(pixels - truth, axis=-1)
        return off, np.full(len(off), np.nan), pose_of(points, pixels, PAPER_CAMERA)[0]

    return look


def nested_pair() -> list[PupilTag]:
    """36h11:0 in the disk, and 36h11:1 with a white cell around it in the white cell nearest its center."""
    large = tag_in("apriltag:36h11:0", RADIUS)
    cell = large.side / large.cells
    row, column = np.nonzero(~large.ink)
    centers = (np.stack([column, -row], axis=-1) + np.array([0.5, -0.5])) * cell + large.side * np.array([-0.5, 0.5])
    small = tag_in("apriltag:36h11:1", cell / np.sqrt(2))
    x, y = centers[np.argmin(np.linalg.norm(centers, axis=-1))].tolist()
    return [PupilTag("pair", tag, RADIUS) for tag in (large, replace(small, center=(x, y)))]


def bounds(pad: Marker, poses: PoseDistribution) -> tuple[Array, Array]:
    """Bound (P,) in degrees on the rotation from the dots in view, and their number."""
    image = ImageNoise(DEFAULT_OPTICS.blur_px, DEFAULT_OPTICS.noise_grey, DEFAULT_OPTICS.light - DEFAULT_OPTICS.dark)
    seen = coverage(pad, PAPER_CAMERA, poses)
    total = dot_information(seen, PAPER_CAMERA, image).sum(axis=1)
    results = np.full(len(poses), np.inf)
    results[seen.served] = np.rad2deg(rotation_bound(covariance(total[seen.served])))
    return results, np.asarray(seen.count, dtype=float)


def judged(result: Found, rotation: Array, translation: Array) -> dict[str, Any]:
    """What is counted of one view."""
    if result is None:
        return {"found": False, "wrong": False, "deg": np.nan, "flip_deg": np.nan, "noise2": np.nan}
    off, noise, rotated = result
    if off.max() >= WRONG_PX:
        return {"found": False, "wrong": True, "deg": np.nan, "flip_deg": np.nan, "noise2": np.nan}
    mirrored = mirrored_rotation(rotation, translation)
    deg, other = (float(np.rad2deg(angle_between(rotated, item))) for item in (rotation, mirrored))
    return {"found": True, "wrong": False, "deg": deg, "flip_deg": other, "noise2": np.mean(noise**2)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--marker", help="marker.json of the pad; designed if left out")
    asked = parser.parse_args()
    pad = mg.Marker.load(asked.marker) if asked.marker else mg.design(n="auto", radius=RADIUS, poses=WIDE).marker
    poses = poses_of(asked.views, asked.seed)
    bound, count = bounds(pad, poses)
    print(f"{len(pad)} dots; bounds from {int(count.min())} to {int(count.max())} dots in view\n")
    rivals = {
        "pad": pad_contestant(pad),
        "nested AprilTags 36h11": tag_contestant(nested_pair()),
        "ArUco 4x4": tag_contestant([SquareTag("aruco", tag_in("aruco:DICT_4X4_50:0", RADIUS), RADIUS)]),
    }
    print("| | distance, m | views | found | wrong | flips | RMS, deg | median, deg | bound, deg | noise | ratio |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name, look in rivals.items():
        rows = [
            judged(look(rotation, translation, np.random.default_rng([asked.seed, k])), rotation, translation)
            for k, (rotation, translation) in enumerate(zip(poses.rotation, poses.translation, strict=True))
        ]
        table(name, {key: np.array([row[key] for row in rows]) for key in rows[0]}, poses.distance, bound)


def table(name: str, rows: dict[str, Array], distance: Array, bound: Array) -> None:
    """Print the rows of one contestant."""
    for low, high in [*pairwise(EDGES), (NEAREST, FARTHEST)]:
        here = (distance >= low) & (distance <= high)
        seen = here & rows["found"].astype(bool)
        deg = rows["deg"][seen]
        flips = np.sum((rows["flip_deg"][seen] < deg) & (deg > APART * bound[seen]))
        cells = [name, f"{low:g} to {high:g}", here.sum(), seen.sum(), int(rows["wrong"][here].sum()), flips]
        if len(deg):
            rms, middle = np.sqrt(np.mean(deg**2)), np.median(deg)
            cells += [f"{rms:.3g}", f"{middle:.3g}"]
            if name == "pad":
                least = np.sqrt(np.mean(bound[seen] ** 2))
                noise = np.sqrt(np.mean(rows["noise2"][seen]))
                # The error of three degrees of freedom has a median of some 0.89 of its RMS.
                ratio = middle / (0.888 * np.median(bound[seen])) if least > STEEP_DEG else rms / least
                cells += [f"{least:.3g}", f"{noise:.3f}", f"{ratio / noise:.3f}"]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
