"""Drawing of what was found into its image, and poses as plain JSON values."""
# tests: tests/detect/test_presentation.py tests/detect/test_detector.py

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.outlines import walked
from markergen.maths.projection import apply_homography, to_camera
from markergen.maths.rotation import logarithm
from markergen.model.body import Plate
from markergen.read.images import check_frame

if TYPE_CHECKING:
    from markergen.detect.results import Found

_FOUND, _PREDICTED = (0, 110, 255), (255, 200, 0)
"""Orange and cyan in cv2's order (blue, green, red): dots that were found, and predicted places of the others."""
_AXES = {"x": (60, 60, 230), "y": (60, 160, 40), "z": (220, 110, 30)}
_BITS = 4
"""Fractional bits of coordinates for drawing with cv2."""
_FARTHEST = 2**15
"""Coordinates in px beyond which nothing is drawn: they would overflow cv2's, and are not visible anyway."""
_TURN = 2 * np.pi * np.arange(64) / 64
_CIRCLE = np.stack([np.cos(_TURN), np.sin(_TURN), 0 * _TURN], axis=-1) / 2


def overlay(image: NDArray[np.uint8] | NDArray[np.uint16], results: "Sequence[Found]") -> bytes:
    """Return the image as PNG bytes with every result drawn in; the same input gives the same bytes.

    Crosses are the measured control points, outlines the dots as predicted by pose or homography, and boxed numbers
    their ids; a dot that was not found has only its outline. With a pose, the axes of the marker frame are drawn at its
    origin, half the marker's radius long.
    """
    import cv2

    canvas = cv2.cvtColor(_eight_bits(image), cv2.COLOR_GRAY2BGR)
    for result in results:
        _draw(canvas, result)
    return bytes(cv2.imencode(".png", canvas)[1])


def draw(frame: NDArray[Any], result: "Found") -> NDArray[Any]:
    """Draw a result into a color image and return it; for a grey image, return a copy in color (see `Found.draw`)."""
    frame = check_frame(frame)
    if frame.ndim == 2 or frame.shape[2] == 1:
        frame = np.repeat(frame.reshape(*frame.shape[:2], 1), 3, axis=2)
    elif not frame.flags.writeable:
        raise InputError("a frame that can be drawn into", "a read-only array", "give frame.copy()")
    if frame.dtype == np.uint8 and frame.shape[2] == 3 and frame.flags.c_contiguous:
        _draw(frame, result)
        return frame
    # cv2 draws smooth lines and text only in 8 bits, three colors and its own memory layout.
    before = np.ascontiguousarray(_eight_bits(frame[..., :3]))
    canvas = before.copy()
    _draw(canvas, result)
    changed = (canvas != before).any(axis=-1)
    most = np.iinfo(frame.dtype).max
    frame[changed, :3] = canvas[changed] * frame.dtype.type(most // 255)
    frame[changed, 3:] = most
    return frame


def _eight_bits(levels: NDArray[Any]) -> NDArray[np.uint8]:
    return np.asarray(levels if levels.dtype == np.uint8 else levels >> 8, dtype=np.uint8)


def _draw(canvas: NDArray[Any], result: "Found") -> None:
    target, pose, ids = result.marker, result.pose, set(result.ids.tolist())
    for k, plate in enumerate(target.plates):
        first = target.first[k]
        if pose is not None:
            rotation, translation = plate.camera_pose(pose.rotation, pose.translation)
            if rotation[:, 2] @ translation >= 0:
                continue
        for ring in plate.marker.boundary.outlines():
            # In short steps, since a lens bends straight edges.
            points, _ = walked(ring, plate.marker.boundary.radius / 40)
            _polyline(canvas, _seen(result, plate, np.pad(points, ((0, 0), (0, 1)))), _FOUND, closed=True)
        for number, point in zip(target.ids[first:].tolist(), plate.marker.control_points, strict=False):
            color = _FOUND if number in ids else _PREDICTED
            for diameter in filter(None, (point.feature.diameter, point.feature.inner_diameter)):
                circle = _CIRCLE * diameter + [point.x, point.y, point.z]
                _polyline(canvas, _seen(result, plate, circle), color, closed=True)
    if pose is not None:
        for axis, (name, color) in zip(np.eye(3), _AXES.items(), strict=True):
            pixels = _seen(result, None, np.stack([0 * axis, axis]) * target.radius / 2)
            _polyline(canvas, pixels, color, width=2)
            _label(canvas, pixels[1], name, color)
    for pixel in result.pixels:
        for arm in ((4, 0), (0, 4)):
            _polyline(canvas, pixel + np.array([arm, arm]) * [[-1], [1]], _FOUND)
    row = {number: k for k, number in enumerate(target.ids.tolist())}
    for number, pixel in zip(result.ids.tolist(), result.pixels, strict=False):
        _label(canvas, pixel, str(target.dots[row[number]][1]), _FOUND)


def _seen(result: "Found", plate: Plate | None, points: Array) -> Array:
    """Return pixels (m, 2) of points (m, 3) of a plate, or of the body; nan where these are undefined."""
    pose, camera = result.pose, result.camera
    with np.errstate(divide="ignore", invalid="ignore"):
        if pose is not None and camera is not None:
            place = points if plate is None else plate.to_body(points)
            one = place, pose.rotation[None], pose.translation[None]
            return np.where(to_camera(*one)[0, :, 2:] > 0, camera.project(*one)[0], np.nan)
        if result.homography is None:
            return np.full((len(points), 2), np.nan)
        pixels = apply_homography(result.homography, points[:, :2])
        return pixels if camera is None else camera.to_pixels(camera.ideal.from_pixels(pixels))


def _polyline(
    canvas: NDArray[Any], pixels: Array, color: tuple[int, int, int], closed: bool = False, width: int = 1
) -> None:
    import cv2

    # Also false for nan.
    if (np.abs(pixels) < _FARTHEST).all():
        corners = np.rint(pixels * 2**_BITS).astype(np.int32)
        cv2.polylines(canvas, [corners], closed, color, width, cv2.LINE_AA, _BITS)


def _label(canvas: NDArray[Any], pixel: Array, text: str, color: tuple[int, int, int]) -> None:
    import cv2

    if (np.abs(pixel) < _FARTHEST).all():
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
        x, y = int(pixel[0]) + 7, int(pixel[1]) - 7
        cv2.rectangle(canvas, (x - 2, y - height - 3), (x + width + 2, y + 3), color, cv2.FILLED)
        cv2.putText(canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


def transform_as_dict(rotation: Array, translation: Array) -> dict[str, Any]:
    """Return a pose as plain JSON values: matrix, m, rotation vector in rad, and quaternion (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    return {
        "rotation": rotation.tolist(),
        "translation": translation.tolist(),
        "rotation_vector": logarithm(rotation).tolist(),
        "quaternion_xyzw": Rotation.from_matrix(rotation).as_quat(canonical=True).tolist(),
    }
