"""Rendering and detecting the default marker, beside OpenCV's ArUco detector on a tag in the same circle, one core.

python -m benchmarks.views
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np

from benchmarks.condition import fastest
from markergen.detect import detect
from markergen.detect.photometric import refine
from markergen.estimators.budget import ErrorSources
from markergen.model.spec import Spec
from markergen.optimize.design import design
from markergen.render import DEFAULT_OPTICS, render_view

VIEWS = 20
ERRORS = ErrorSources()


def main() -> None:
    """Print ms per view of each step, and its ratio to ArUco's detection with sub-pixel corners of as many views."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    found = design(Spec())
    marker, camera, poses = found.marker, found.setting.camera, found.setting.poses
    chosen = np.linspace(0, len(poses) - 1, VIEWS).astype(int)
    views = [(poses.rotation[k], poses.translation[k]) for k in chosen]
    images = [render_view(marker, camera, *view, DEFAULT_OPTICS, np.random.default_rng(0)) for view in views]
    detections = [detect(image, marker, camera, ERRORS) for image in images]
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    tag = cv2.aruco.generateImageMarker(dictionary, 7, 170)
    tags = [np.pad(tag, ((155, 155), (235, 235)), constant_values=225) for _ in images]
    peer = cv2.aruco.ArucoDetector(dictionary, parameters)

    steps: dict[str, Callable[[], object]] = {
        "aruco detect": lambda: [peer.detectMarkers(image) for image in tags],
        "render": lambda: [
            render_view(marker, camera, *view, DEFAULT_OPTICS, np.random.default_rng(0)) for view in views
        ],
        "detect": partial(_each, lambda image, _: detect(image, marker, camera, ERRORS), images, detections),
        "photometric": partial(
            _each, lambda image, found: refine(image, marker, camera, found, ERRORS), images, detections
        ),
    }
    times = fastest(*steps.values(), rounds=5)
    print(f"{VIEWS} views of {camera.width}x{camera.height} px, {len(marker)} dots, one core")
    print(f"{'':>14} {'ms':>8} {'views/s':>8} {'ratio':>6}")
    for name, seconds in zip(steps, times, strict=True):
        print(f"{name:>14} {1e3 * seconds / VIEWS:>8.2f} {VIEWS / seconds:>8.1f} {seconds / times[0]:>6.2f}")


def _each(step: Callable[..., object], images: Sequence[object], detections: Sequence[object]) -> None:
    for image, found in zip(images, detections, strict=True):
        step(image, found)


if __name__ == "__main__":
    main()
