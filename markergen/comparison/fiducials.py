"""Square tags and ChArUco boards: detection by cv2.aruco, with the settings that determine its accuracy."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.comparison.contestants import Sighting
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera
from markergen.model.tag import Board, Tag, dictionary_of

PIXEL_OFFSET = {"none": 0.0, "subpix": 0.0, "contour": 0.0, "apriltag": 0.5}
"""Offset to subtract from both corner coordinates for each refinement, in px of the image that is searched.

The AprilTag code counts from the corner of the top left pixel, the rest of cv2.aruco from its middle: see
`detect_fiducial` for the measurements.
"""

_QUIET = 20
"""Minimum step from black to white for the AprilTag code, grey levels. Its default of 5 is within 2.5 sigma of a noise
of 2 grey levels, and takes thirty times as long for the same corners."""
_LEAST_SHARE, _LEAST_PERIMETER_PX = 0.03, 18.0
"""Perimeter of the smallest tag: the default, but not less than a few pixels. In small images of a fine pattern, such
as a checkerboard of single pixels, every pixel would otherwise count as a square, and comparing them takes seconds."""
_ITERATIONS, _ACCURACY_PX = 200, 1e-3
"""Termination of cornerSubPix. The defaults, 30 and 0.1 px, stop as far from the minimum as the desired error."""


@dataclass(frozen=True)
class FiducialSettings:
    """Settings of cv2.aruco for a tag or a board.

    Attributes
    ----------
    refinement : str
        Refinement of the tags' corners: ``none``, ``subpix`` (cornerSubPix), ``contour`` (lines through the contour's
        pixels) or ``apriltag`` (lines through the gradient's edge, and quads found as AprilTag 2 does).
    window : int
        Half the window of ``subpix``, px, but at most half a cell of the tag.
    quad_sigma : float
        Blur for the quad search of ``apriltag``, px.
    threshold_window : int
        Window of the adaptive threshold, px; 0 tries OpenCV's three, 3, 13 and 23.
    calibrated : bool
        For a board: predict its inner corners, and missed tags, from the pose of the tags rather than from local
        homographies.
    min_tags : int
        For a board: minimum number of detected tags beside an inner corner.
    """

    refinement: str = "subpix"
    window: int = 5
    quad_sigma: float = 0.0
    threshold_window: int = 0
    calibrated: bool = False
    min_tags: int = 2


TAG_SETTINGS: Mapping[str, FiducialSettings] = {
    "NONE": FiducialSettings("none"),
    "CONTOUR": FiducialSettings("contour"),
    "CONTOUR, threshold window 53 px": FiducialSettings("contour", threshold_window=53),
    "SUBPIX, window 3 px": FiducialSettings("subpix", window=3),
    "SUBPIX, window 5 px": FiducialSettings("subpix", window=5),
    "SUBPIX, window 8 px": FiducialSettings("subpix", window=8),
    "SUBPIX, window 16 px": FiducialSettings("subpix", window=16),
    "APRILTAG": FiducialSettings("apriltag"),
    "APRILTAG, quad sigma 0.8": FiducialSettings("apriltag", quad_sigma=0.8),
}
"""Settings to choose from for a tag; the first is OpenCV's default."""

BOARD_SETTINGS: Mapping[str, FiducialSettings] = {
    "NONE, uncalibrated": FiducialSettings("none"),
    "SUBPIX, uncalibrated": FiducialSettings("subpix"),
    "CONTOUR, uncalibrated": FiducialSettings("contour"),
    "NONE": FiducialSettings("none", calibrated=True),
    "SUBPIX": FiducialSettings("subpix", calibrated=True),
    "SUBPIX, min. 1 tag": FiducialSettings("subpix", calibrated=True, min_tags=1),
    "CONTOUR": FiducialSettings("contour", calibrated=True),
    "APRILTAG": FiducialSettings("apriltag", calibrated=True),
}
"""Settings to choose from for a board; the first is OpenCV's default, and those without a remark are calibrated."""


def detect_fiducial(
    image: NDArray[np.uint8], fiducial: Tag | Board, settings: FiducialSettings, camera: Camera
) -> Sighting:
    """Find one tag or board in a grey image with cv2.aruco.

    The corners follow our pixel convention. Measured in noise-free views (blur 0.7 px, 100 of the paper's poses, two
    kinds of tag), the mean offset of all corners in x and y, in px of the image searched, each +-0.02 or better:

        NONE -0.02, 0.00    SUBPIX 0.00, 0.00    CONTOUR 0.02, 0.00    APRILTAG 0.48, 0.46; enlarged 0.50, 0.49

    So APRILTAG counts from the image's corner, and half a pixel is subtracted; for the tags of a board this is done
    before its inner corners are predicted from them, which are then off by 0.00, 0.00 for every refinement. The rest is
    not a matter of convention: NONE, SUBPIX and CONTOUR place a tag's blurred corners too far inside, by 0.5, 0.2 and
    0.7 px.

    Parameters
    ----------
    image : array (h, w) of uint8
    camera : Camera
        Camera that took the image, for a board with `settings.calibrated`. cv2.aruco does not support the fisheye
        model: boards are then searched without the camera.

    Returns
    -------
    Sighting
        Rows of the fiducial's `corners` and their pixels, without a pose. A board counts as found with four or more
        inner corners that are not collinear.
    """
    if isinstance(fiducial, Tag):
        return _find_tag(image, fiducial, settings)
    return _find_board(image, fiducial, settings, camera)


def find_tags(image: NDArray[np.uint8], family: str, settings: FiducialSettings) -> list[tuple[int, Array]]:
    """Find the ids and corners (4, 2) in px of all tags of a family in a grey image."""
    corners, ids, _ = _tag_detector(family, settings, _least_perimeter(image)).detectMarkers(image)
    numbers = [] if ids is None else [int(i) for i in np.ravel(ids)]
    offset = PIXEL_OFFSET[settings.refinement]
    return [(i, np.reshape(c, (4, 2)).astype(float) - offset) for c, i in zip(corners, numbers, strict=True)]


def _find_tag(image: NDArray[np.uint8], tag: Tag, settings: FiducialSettings) -> Sighting:
    seen = find_tags(image, tag.family, settings)
    quads = [corners for number, corners in seen if number == tag.id]
    if not quads:
        others = [number for number, _ in seen]
        return Sighting(reason=f"no tag with id {tag.id}" + (f", but {others}" if others else ""))
    # Of several with the same id, take the largest.
    return Sighting(np.arange(4), max(quads, key=lambda quad: float(np.sum((quad[2] - quad[0]) ** 2))))


def _find_board(image: NDArray[np.uint8], board: Board, settings: FiducialSettings, camera: Camera) -> Sighting:
    detector = _board_detector(board, settings, camera if settings.calibrated else None)
    offset = np.float32(PIXEL_OFFSET[settings.refinement])
    if offset:
        # The inner corners are predicted from those of the tags, so these must be in our convention before that.
        pixels, ids, _, tags = detector.detectBoard(
            image, None, None, *_board_tags(image, board, settings, detector, offset)
        )
    else:
        pixels, ids, _, tags = detector.detectBoard(image)
    if ids is None or len(ids) < 4:
        seen = 0 if tags is None else len(tags)
        return Sighting(reason=f"{0 if ids is None else len(ids)} inner corners beside {seen} tags")
    numbers = np.ravel(ids).astype(np.intp)
    spread = board.corners[numbers] - board.corners[numbers].mean(axis=0)
    if np.linalg.matrix_rank(spread, tol=1e-6 * board.square) < 2:
        return Sighting(reason="inner corners on one line only")
    return Sighting(numbers, np.reshape(pixels, (-1, 2)).astype(float))


def _board_tags(
    image: NDArray[np.uint8], board: Board, settings: FiducialSettings, detector: Any, offset: np.float32
) -> tuple[Any, Any]:
    """Find the corners and ids of a board's tags as detectBoard does itself, moved by the offset."""
    finder = _tag_detector(board.family, settings, _least_perimeter(image))
    corners, ids, rejected = finder.detectMarkers(image)
    corners, rejected = ([quad - offset for quad in quads] for quads in (corners, rejected))
    if settings.calibrated and ids is not None:
        parameters = detector.getCharucoParameters()
        corners, ids, _, _ = finder.refineDetectedMarkers(
            image, detector.getBoard(), corners, ids, rejected, parameters.cameraMatrix, parameters.distCoeffs
        )
    return (corners, ids) if ids is not None and len(ids) else (None, None)


def enlarged(image: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Enlarge an image (h, w) by cubic interpolation; the top left corner, (-0.5, -0.5), stays in place."""
    if factor == 1:
        return image
    import cv2

    height, width = image.shape
    return np.asarray(cv2.resize(image, (width * factor, height * factor), interpolation=cv2.INTER_CUBIC))


def as_taken(pixels: Array, factor: int) -> Array:
    """Pixels (..., 2) of an enlarged image in the image as taken."""
    return np.asarray((pixels + 0.5) / factor - 0.5, dtype=float)


def _least_perimeter(image: NDArray[np.uint8]) -> float:
    """Return the perimeter of the smallest tag as a share of the image's longer side."""
    return max(_LEAST_SHARE, _LEAST_PERIMETER_PX / max(image.shape))


def _parameters(settings: FiducialSettings) -> Any:
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{settings.refinement.upper()}")
    parameters.cornerRefinementWinSize = settings.window
    parameters.relativeCornerRefinmentWinSize = 0.5
    parameters.cornerRefinementMaxIterations = _ITERATIONS
    parameters.cornerRefinementMinAccuracy = _ACCURACY_PX
    if settings.threshold_window:
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = settings.threshold_window
    parameters.aprilTagQuadSigma = settings.quad_sigma
    parameters.aprilTagMinWhiteBlackDiff = _QUIET
    return parameters


@lru_cache(maxsize=64)
def _tag_detector(family: str, settings: FiducialSettings, least_perimeter: float) -> Any:
    import cv2

    parameters = _parameters(settings)
    parameters.minMarkerPerimeterRate = least_perimeter
    return cv2.aruco.ArucoDetector(dictionary_of(family), parameters)


@lru_cache(maxsize=64)
def _board_detector(board: Board, settings: FiducialSettings, camera: Camera | None) -> Any:
    import cv2

    parameters = cv2.aruco.CharucoParameters()
    parameters.minMarkers = settings.min_tags
    parameters.tryRefineMarkers = settings.calibrated
    if camera is not None and LENSES[camera.distortion.model].opencv:
        parameters.cameraMatrix = camera.matrix
        parameters.distCoeffs = np.array(camera.distortion.coefficients or (0.0,) * 4)
    layout = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square, board.tag_side, dictionary_of(board.family)
    )
    return cv2.aruco.CharucoDetector(layout, parameters, _parameters(settings))
