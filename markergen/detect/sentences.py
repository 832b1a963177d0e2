"""What became of each image, in words for the terminal."""

from collections.abc import Sequence

import numpy as np

from markergen.detect.batch import Job, Outcome
from markergen.detect.detection import Detection
from markergen.detect.record import reason


def image_lines(job: Job, outcome: Outcome) -> list[str]:
    """One line for the image and each marker in it, then the notes of its reader."""
    if outcome.error:
        return [f"{outcome.path}: not used: {outcome.error}"]
    lines = [f"{outcome.path}: {_marker(job, detection)}" for detection in outcome.detections]
    return [*lines, *(f"  {note}" for note in outcome.notes)]


def summary(outcomes: Sequence[Outcome]) -> str:
    """How many of the images had a marker, and how many could not be used."""
    found, unused = sum(outcome.found for outcome in outcomes), sum(bool(outcome.error) for outcome in outcomes)
    line = f"found a marker in {found} of {len(outcomes)} image{'s' * (len(outcomes) != 1)}"
    return f"{line}, {unused} could not be used" if unused else line


def _marker(job: Job, detection: Detection) -> str:
    name, total = job.names[detection.marker], len(job.markers[detection.marker])
    if not detection.found:
        return f"{name} not found: {reason(detection, job.names)}"
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
