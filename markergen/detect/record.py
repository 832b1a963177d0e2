"""A detection as plain JSON values, and in words."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.detect.detection import Detection
from markergen.detect.pose import PoseEstimate
from markergen.maths.rotation import logarithm
from markergen.model.marker import Marker


def as_dict(detection: Detection, markers: Sequence[Marker], names: Sequence[str]) -> dict[str, Any]:
    """Return what was found of one marker in the form that docs/detect.md describes.

    Parameters
    ----------
    markers, names
        The markers that were looked for, and what to call each.
    """
    marker = markers[detection.marker]
    known = [point.id for point in marker.control_points]
    dots = detection if detection.unlabeled is None else detection.unlabeled
    return {
        "marker": names[detection.marker],
        "found": detection.found,
        "reason": reason(detection, names),
        "ids": detection.ids.tolist(),
        "missing": sorted(set(known) - set(detection.ids.tolist())) if detection.found else known,
        "pixels": dots.pixels.tolist(),
        "covariance_px2": dots.covariance.tolist(),
        "ellipse_centers": dots.ellipse_centers.tolist(),
        "homography": None if detection.homography is None else detection.homography.tolist(),
        "pose": None if detection.pose is None else _pose(detection.pose),
        "tag": _tag(detection, marker),
    }


def reason(detection: Detection, names: Sequence[str]) -> str:
    """Why a marker was not found, with the name of the other marker where two of them fit the same dots."""
    if detection.rival is None:
        return detection.reason
    return f"{detection.reason}: {names[detection.marker]} and {names[detection.rival]}"


def in_words(detection: Detection, markers: Sequence[Marker], names: Sequence[str]) -> str:
    """One line: the marker and how many of its dots were found, or why not; of a pose the distance, tilt and sigma."""
    name, total = names[detection.marker], len(markers[detection.marker])
    if not detection.found:
        return f"{name} not found: {reason(detection, names)}"
    line = f"{name}, {len(detection.ids)} of {total} dots"
    if detection.pose is None:
        return f"{line}, homography only"
    pose = detection.pose
    toward = -pose.rotation.T @ pose.translation
    distance = float(np.linalg.norm(toward))
    tilt = float(np.rad2deg(np.arccos(np.clip(toward[2] / distance, -1, 1))))
    line += (
        f", {distance:.4f} m away, tilted by {tilt:.2f} deg; 1 sigma: {pose.budget.rotation_deg['total']:.2g} deg, "
        f"{1e3 * pose.budget.translation['total']:.2g} mm"
    )
    if pose.alternative is not None:
        line += f"; the mirrored pose fits as well, likelihood ratio {pose.likelihood_ratio:.2g}"
    return line


def _tag(detection: Detection, marker: Marker) -> dict[str, Any] | None:
    if detection.tag is None or marker.tag is None:
        return None
    return {"family": marker.tag.family, "id": marker.tag.id, "corners": detection.tag.tolist()}


def _pose(pose: PoseEstimate) -> dict[str, Any]:
    budget = pose.budget
    alternative = None
    if pose.alternative is not None:
        alternative = {**_transform(*pose.alternative), "likelihood_ratio": pose.likelihood_ratio}
    return {
        **_transform(pose.rotation, pose.translation),
        "covariance": budget.total.tolist(),
        "sigma": {
            "rotation_deg": {name: float(part) for name, part in budget.rotation_deg.items()},
            "translation": {name: float(part) for name, part in budget.translation.items()},
        },
        "chi2": pose.chi2,
        "degrees_of_freedom": pose.degrees_of_freedom,
        "alternative": alternative,
    }


def _transform(rotation: Any, translation: Any) -> dict[str, Any]:
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return {
        "rotation": rotation.tolist(),
        "translation": translation.tolist(),
        "rotation_vector": logarithm(np.asarray(rotation)).tolist(),
        "quaternion_xyzw": quaternion.tolist(),
    }
