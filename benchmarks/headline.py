"""The error to plan with beside the views' own figure, for ten markers and cameras.

    python -m benchmarks.headline [--views 400] [--only NAME ...] [--json F]

Each row: what `validate` says to expect in its hardest distance and tilt and over all poses, and the RMS that rendered
views gave there, with its 95 % interval (bootstrap over the views). `claimed` is the first-order covariance alone.
`flips` are those expected and those of the views, where the mirrored pose is 10 deg off or more; `wrong` counts the
comparisons of `headline.views` that failed, of five.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import markergen as mg
from markergen.maths.information import mirrored_rotation
from markergen.maths.rotation import angle_between, exponential
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import PoseDistribution
from markergen.validation.error_to_plan_with import cells_of
from markergen.validation.metrics import flipped

FISHEYE = Camera(1280, 1024, 420, 420, 639.5, 511.5, Distortion("equidistant", (0.02, -0.01, 0.003, -0.0005)))
HIGH = Camera(2592, 1944, 3240, 3240, 1295.5, 971.5)
SMALL = {"n": 5, "radius": "60mm", "dot": "18mm"}
HEADINGS = (
    "marker       hardest, m deg (views)    claimed  expected     views    95 % interval    all: claimed  expected     "
    "views    95 % interval   flips  views  found    sampled  wrong     CPU s"
)


@dataclass(frozen=True)
class Case:
    """A marker, by the options of `design`, and how it is validated."""

    design: Mapping[str, Any]
    camera: Camera = PAPER_CAMERA
    poses: str = "paper"
    validate: Mapping[str, Any] = field(default_factory=dict)


CASES = {
    "pentagon": Case({"n": 5}),
    "four small": Case({"n": 4, "radius": "50mm", "dot": "16mm"}),
    "twenty": Case({"n": 20, "dot": "24mm"}, poses="paper-roll"),
    "rectangle": Case({"n": 6, "boundary": "rect:0.2x0.1"}, poses="cone:distance=0.5..1.2,tilt=40..70,azimuth=-30..30"),
    "relief": Case({"n": 6, "relief": "25mm"}),
    "tag": Case({"n": 8, "tag": "aruco:DICT_4X4_50:7"}),
    "light dots": Case({"n": 7, "colors": "inverted"}, poses="cone:distance=0.5..1.5,tilt=0..60"),
    "fisheye": Case({"n": 8}, FISHEYE, "cone:distance=0.4..0.9,tilt=0..60"),
    "2592 x 1944": Case({"n": 8, "radius": "75mm", "dot": "15mm"}, HIGH, "cone:distance=0.6..1.5,tilt=0..65"),
    "far": Case({"n": 5}, poses="cone:distance=2.5..4,tilt=0..50"),
    "frontal": Case(SMALL, poses="cone:distance=1.3..1.5,tilt=0..10"),
    "flips": Case(SMALL, poses="cone:distance=1.3..1.5,tilt=12..22", validate={"print_sigma": "0.3mm"}),
    "bad print": Case(SMALL, validate={"print_sigma": "0.3mm"}),
    "exact print": Case({"n": 5}, validate={"print_sigma": 0.0}),
}
"""Markers and cameras by name."""


def main() -> None:
    """Print a row for each case, and the number of disagreements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=400)
    parser.add_argument("--only", nargs="*", choices=list(CASES), default=list(CASES))
    parser.add_argument("--json", type=Path, help="where to write the headlines")
    options = parser.parse_args()
    print(HEADINGS, flush=True)
    results, wrong = {}, 0
    for name in options.only:
        start = time.process_time()
        validation = run(CASES[name], options.views)
        results[name] = dict(validation.headline)
        wrong += validation.headline["views"]["disagreements"]
        print(row(name, validation, time.process_time() - start), flush=True)
    print(f"{wrong} of {5 * len(results)} comparisons disagree")
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")


def run(case: Case, views: int) -> mg.Validation:
    """Design a marker and validate it by views alone."""
    marker = mg.design(**case.design, camera=case.camera, poses=case.poses).marker
    return mg.validate(marker, case.camera, poses=case.poses, runs=0, views=views, workers=1, **case.validate)


def row(name: str, validation: mg.Validation, seconds: float) -> str:
    """One line: expected errors, those of the views, and whether they agree."""
    headline, views, poses = validation.headline, validation.views, validation.setting.poses
    assert views is not None
    hardest, over_all = headline["hardest"]["rotation_deg"], headline["all"]
    samples = [item for item in views["samples"] if item["rotation_deg"] is not None]
    inside = cells_of(poses)[hardest["distance"], hardest["tilt"]]
    there = [item for item in samples if inside[item["pose"]]]
    flips = sum(_flipped(poses, item) for item in samples)
    place = f"{hardest['distance']} {hardest['tilt']} ({len(there)})"
    expected_flips = views["count"] * over_all["flip_rate"]
    return (
        f"{name:<12} {place:>21}  {hardest['first_order_deg']:9.4f} {hardest['rotation_deg']:9.4f} "
        f"{_measured(there)}  {over_all['first_order_deg']:14.4f} {over_all['rotation_deg']:9.4f} {_measured(samples)} "
        f"{expected_flips:7.2f} {flips:>6} {views['detected']:>6} {over_all['sampled']:>5}/{over_all['poses']:<4} "
        f"{headline['views']['disagreements']:>6} {seconds:9.1f}"
    )


def _flipped(poses: PoseDistribution, item: Mapping[str, Any]) -> bool:
    rotation, translation = poses.rotation[item["pose"]], poses.translation[item["pose"]]
    estimate = exponential(np.deg2rad(item["rotation_vector_deg"])) @ rotation
    apart = np.rad2deg(angle_between(mirrored_rotation(rotation, translation), rotation)) > 10
    return bool(apart and flipped(estimate[None], rotation, translation)[0])


def _measured(samples: list[Any]) -> str:
    errors = np.square([sample["rotation_deg"] for sample in samples])
    if not len(errors):
        return f"{'-':>9} {'-':>16}"
    rng = np.random.default_rng(0)
    drawn = np.sqrt(np.mean(rng.choice(errors, size=(2000, len(errors))), axis=1))
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{np.sqrt(np.mean(errors)):9.4f} {f'{low:.4f}..{high:.4f}':>16}"


if __name__ == "__main__":
    main()
