"""What the report is made of: real trials and bounds, drawn views, foreign words."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives import Setting
from markergen.presentation.results import json_bytes
from markergen.render import DEFAULT_OPTICS
from markergen.validation.bounds import image_covariance
from markergen.validation.metrics import statistics
from markergen.validation.report import html_report
from markergen.validation.report.measured import sample_pose_errors
from markergen.validation.report.subject import Subject
from markergen.validation.validation import run_validation
from markergen.validation.views import Picture, SyntheticViews

HOSTILE = '</pre><script>alert("x")</script><img src=x onerror=alert(1)> $\\frac{ \ud800'


@pytest.fixture(scope="module")
def few(setting):
    """Every fifth of the paper's poses: all distances and tilts, four azimuths of each."""
    poses = paper()
    return Setting(
        setting.boundary, setting.camera, PoseDistribution("paper", poses.rotation[::5], poses.translation[::5])
    )


@pytest.fixture(scope="module")
def budget(pentagon, few):
    errors = ErrorSources(1e-4, np.diag([0.5, 0.5, 0.5, 0.5]) ** 2)
    image = image_covariance(pentagon, few.camera, few.poses, DEFAULT_OPTICS)
    return pose_budget(pentagon.xyz, few.poses.rotation, few.poses.translation, few.camera, image, errors)


@pytest.fixture(scope="module")
def results(pentagon, few, budget):
    """Real trials and bounds; views drawn from the covariances, as if the detector were perfect."""
    series = SyntheticViews(pentagon, few.camera, few.poses, 0, errors=ErrorSources(1e-4, np.diag([0.5] * 4) ** 2))
    results = run_validation(series, runs=3, workers=1)
    results["views"] = synthetic_views(pentagon, few, budget)
    return json.loads(json_bytes(results))


def synthetic_views(marker, setting, budget):
    poses, rng = setting.poses, np.random.default_rng(1)
    errors = sample_pose_errors(budget.image + budget.print)
    every = np.linalg.cholesky(image_covariance(marker, setting.camera, poses, DEFAULT_OPTICS))
    samples = []
    for k in range(2 * len(poses)):
        pose, error = k // 2, errors[k // 2, k]
        dots = (every[pose] @ rng.standard_normal((len(marker), 2, 1)))[..., 0]
        samples.append(
            {
                "view": k,
                "pose": pose,
                "distance": float(poses.distance[pose]),
                "polar_angle_deg": round(float(poses.polar_angle_deg[pose]), 2),
                "azimuth_deg": 0.0,
                "rotation_deg": float(np.rad2deg(np.linalg.norm(error[:3]))),
                "translation_pct": float(100 * np.linalg.norm(error[3:]) / poses.distance[pose]),
                "rotation_vector_deg": np.rad2deg(error[:3]).tolist(),
                "translation_error_mm": (1e3 * error[3:]).tolist(),
                "nees": 6.0,
                "point_px_rms": float(np.sqrt(np.mean(np.sum(dots**2, axis=-1)))),
                "dots": list(range(len(marker))),
                "error_px": dots.tolist(),
            }
        )

    def summary(chosen):
        return {
            "count": len(chosen),
            "detected": len(chosen),
            "wrong": 0,
            "rate": 1.0,
            "point_px": statistics(np.array([np.hypot(*dot) for sample in chosen for dot in sample["error_px"]])),
            "uncorrected_px": statistics(np.full(3, 0.2)),
            "image_bound_px": 0.0044,
            "homography_px": statistics(np.full(3, 0.01)),
            "estimators": {
                name: {
                    key: statistics(factor * np.array([sample[key] for sample in chosen]))
                    for key in ("rotation_deg", "translation_pct")
                }
                for name, factor in (("detect", 1.0), ("sqpnp", 1.2))
            },
            "nees": {
                "count": len(chosen),
                "mean": 6.0,
                "interval": [5.5, 6.5],
                "coverage": 0.95,
                "coverage_interval": [0.9, 0.98],
            },
        }

    def groups(masks):
        return {name: summary([sample for sample in samples if mask[sample["pose"]]]) for name, mask in masks.items()}

    return {
        **summary(samples),
        "optics": dict(vars(DEFAULT_OPTICS)),
        "background": "plain",
        "hidden": 0,
        "print_sigma_mm": 0.1,
        "by_polar_angle": groups(poses.by_polar_angle()),
        "by_distance": groups(poses.by_distance()),
        "samples": samples,
        "failures": [
            {"view": 7, "pose": 79, "distance": 1.5, "polar_angle_deg": 70.0, "azimuth_deg": 0.0, "reason": HOSTILE}
        ],
    }


@pytest.fixture(scope="module")
def pictures():
    """Twelve pictures with the noise of a view, of its size."""
    rng = np.random.default_rng(0)
    noisy = [np.clip(rng.normal(200, 2, (480, 640)), 0, 255).astype(np.uint8) for _ in range(12)]
    return [
        Picture(
            f"view-{k}", HOSTILE if k == 0 else f"View {k}", "What it shows.", bytes(cv2.imencode(".png", image)[1])
        )
        for k, image in enumerate(noisy)
    ]


@pytest.fixture(scope="module")
def hostile(pentagon):
    return replace(
        pentagon,
        provenance={"spec_hash": HOSTILE, "seed": HOSTILE, "versions": {HOSTILE: HOSTILE}, "spec": [HOSTILE]},
    )


@pytest.fixture(scope="module")
def html(results, hostile, few, pictures, budget):
    return html_report(results, hostile, few, pictures, budget)


@pytest.fixture
def subject(results, pentagon, few, budget):
    return Subject(results, pentagon, few, budget)


@pytest.fixture
def ax():
    return new_axes()


def new_axes():
    from matplotlib.figure import Figure

    return Figure().add_subplot()
