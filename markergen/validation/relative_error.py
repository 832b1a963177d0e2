"""Relative error of the DLT's homography in noisy trials, between the bounds of Acuna & Willert 2018, section III."""
# tests: tests/validation/test_relative_error.py

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.estimators import Correspondences
from markergen.maths.dlt import relative_error_bounds
from markergen.presentation.tables import number
from markergen.validation.trials import TrialResults, noisy_images


def relative_error_of(results: TrialResults) -> dict[str, Any] | None:
    """Return medians over poses of the error of h and of its bounds, in unit coordinates; None without c(A) or noise.

    One trial at each pose. ``beyond`` counts those that are not between their bounds, of which the upper one is of
    first order; ``tightness`` has the medians of lower bound over error and of error over upper bound.
    """
    experiment = replace(results.experiment, runs=1)
    if results.condition is None or not (results.experiment.runs and experiment.noise_px):
        return None
    camera, center = experiment.camera, experiment.poses.translation
    points = experiment.points[:, :2] / experiment.radius
    exact = camera.ideal.project(experiment.points, experiment.poses.rotation, center)
    noisy = np.stack(
        [
            Correspondences.from_distorted(experiment.points, images, camera).image_points[0]
            for index in range(len(center))
            for images in noisy_images(experiment, index)
        ]
    )

    def unit(pixels: Array) -> Array:
        normalized = (pixels - camera.ideal.matrix[:2, 2]) / camera.focal
        depth = center[:, None, 2:]
        return np.asarray((normalized - center[:, None, :2] / depth) * depth / experiment.radius)

    error, lower, upper = relative_error_bounds(points, unit(exact), unit(noisy))
    beyond = (error > upper * (1 + 1e-9)) | (error < lower * (1 - 1e-9))
    return {
        "count": len(error),
        "error": np.median(error),
        "lower": np.median(lower),
        "upper": np.median(upper),
        "tightness": {"lower": np.median(lower / error), "upper": np.median(error / upper)},
        "beyond": int(beyond.sum()),
    }


def relative_error_sentence(row: Mapping[str, Any]) -> str:
    """State the error of h between its bounds."""
    beyond = f"; {row['beyond']} are not between them" if row["beyond"] else ""
    between = f"between the bounds {number(row['lower'], 2)} and {number(row['upper'], 2)}{beyond}"
    return (
        f"Relative error of the DLT's h, median of {row['count']} trials in unit coordinates: "
        f"{number(row['error'], 2)}, {between}."
    )
