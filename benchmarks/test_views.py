"""Rendering and detecting 20 views of the default marker, beside ArUco's detection of as many views of a tag.

The tag is in the same circle, and its corners are refined to sub-pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from markergen.detect import Found, detect
from markergen.estimators.budget import ErrorSources
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.spec import Spec
from markergen.optimize.design import design
from markergen.render import DEFAULT_OPTICS, render_view

VIEWS, ERRORS, GROUP = 20, ErrorSources(), "20 views of 640x480 px"

Array = NDArray[Any]


@dataclass(frozen=True)
class Scenery:
    marker: Marker
    camera: Camera
    views: list[tuple[Array, Array]]
    images: list[Array]

    def rendered(self) -> list[Array]:
        return [
            render_view(self.marker, self.camera, *view, DEFAULT_OPTICS, np.random.default_rng(0))
            for view in self.views
        ]

    def detected(self) -> list[Found]:
        return [detect(image, self.marker, self.camera, ERRORS) for image in self.images]


@pytest.fixture(scope="module")
def scenery() -> Scenery:
    cv2.setNumThreads(1)
    actual = design(Spec())
    poses = actual.setting.poses
    views = [(poses.rotation[k], poses.translation[k]) for k in np.linspace(0, len(poses) - 1, VIEWS).astype(int)]
    bare = Scenery(actual.marker, actual.setting.camera, views, [])
    return Scenery(bare.marker, bare.camera, views, bare.rendered())


def test_detect_aruco(compare: Callable[..., Any]) -> None:
    cv2.setNumThreads(1)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    tag = cv2.aruco.generateImageMarker(dictionary, 7, 170)
    image = np.pad(tag, ((155, 155), (235, 235)), constant_values=225)
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    compare(GROUP, lambda: [detector.detectMarkers(image) for _ in range(VIEWS)])


def test_render_ours(compare: Callable[..., Any], scenery: Scenery) -> None:
    compare(GROUP, scenery.rendered)


def test_detect_ours(compare: Callable[..., Any], scenery: Scenery) -> None:
    compare(GROUP, scenery.detected)
