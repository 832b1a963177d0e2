"""Presentation of detections: drawn into their image, as plain JSON values, and in words."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.detect.results import Detection
from markergen.errors import InputError
from markergen.estimators.weighted_pose import PoseEstimate
from markergen.geometry.outlines import walked
from markergen.maths.projection import apply_homography, to_camera
from markergen.maths.rotation import logarithm
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.rig import Rig, Target
from markergen.read.images import check_frame

_FOUND, _GUESSED = (0, 110, 255), (255, 200, 0)
"""Orange and cyan in cv2's order (blue, green, red): dots that were found, and predicted places of the others."""
_AXES = {"x": (60, 60, 230), "y": (60, 160, 40), "z": (220, 110, 30)}

_UNREAD = {
    "small": ", its tag too small to be read",
    "outside": ", its tag outside the image",
    "faint": ", its tag too faint to be read",
    "covered": ", its tag covered",
    "unclear": ", its tag unclear",
}
"""Words for the states of a tag that was not read."""

_BITS = 4
"""Fractional bits of coordinates for drawing with cv2."""
_OUTLINE = 2 * np.pi * np.arange(64) / 64


def overlay(
    image: NDArray[np.uint8] | NDArray[np.uint16],
    markers: Target | Sequence[Target],
    camera: Camera | None,
    detections: Sequence[Detection],
) -> bytes:
    """Return the image as PNG bytes with every detection drawn in; the same input gives the same bytes.

    Crosses are the measured control points, outlines the dots as predicted by pose or homography, and boxed numbers
    their ids; a dot that was not found has only its outline. With a pose, the axes of the marker frame are drawn at its
    origin, half the marker's radius long.
    """
    import cv2

    levels = np.asarray(image if image.dtype == np.uint8 else image >> 8, dtype=np.uint8)
    canvas = cv2.cvtColor(levels, cv2.COLOR_GRAY2BGR)
    given = [markers] if isinstance(markers, Marker | Rig) else list(markers)
    for detection in detections:
        _draw(canvas, given[detection.marker], camera, detection)
    return bytes(cv2.imencode(".png", canvas)[1])


def draw(frame: NDArray[Any], marker: Target, camera: Camera | None, detection: Detection) -> NDArray[Any]:
    """Draw a detection into a color image and return it; for a grey image, return a copy in color.

    Parameters
    ----------
    frame : array (h, w, 3) BGR or (h, w, 4) BGRA, or grey (h, w) or (h, w, 1), of uint8 or uint16

    Raises
    ------
    InputError
        If the frame has another form, or is in color and read-only.
    """
    frame = check_frame(frame)
    if frame.ndim == 2 or frame.shape[2] == 1:
        frame = np.repeat(frame.reshape(*frame.shape[:2], 1), 3, axis=2)
    elif not frame.flags.writeable:
        raise InputError("a frame that can be drawn into", "a read-only array", "give frame.copy()")
    if frame.dtype == np.uint8 and frame.shape[2] == 3 and frame.flags.c_contiguous:
        _draw(frame, marker, camera, detection)
        return frame
    # cv2 draws smooth lines and text only in 8 bits, three colors and its own memory layout.
    levels = frame[..., :3] if frame.dtype == np.uint8 else frame[..., :3] >> 8
    before = np.ascontiguousarray(levels, dtype=np.uint8)
    canvas = before.copy()
    _draw(canvas, marker, camera, detection)
    changed = (canvas != before).any(axis=-1)
    most = np.iinfo(frame.dtype).max
    frame[changed, :3] = canvas[changed] * frame.dtype.type(most // 255)
    frame[changed, 3:] = most
    return frame


def _draw(canvas: NDArray[Any], target: Target, camera: Camera | None, detection: Detection) -> None:
    pixels = {int(i): pixel for i, pixel in zip(detection.ids, detection.pixels, strict=True)}
    labels = {number: str(number) for number in pixels}
    if isinstance(target, Marker):
        _draw_marker(canvas, target, camera, detection, set(pixels))
    elif detection.pose is not None:
        dots = target.dots
        labels = {number: str(dots[number][1]) for number in pixels}
        for k, each in enumerate(target.plates):
            rotation, translation = each.camera_pose(detection.pose.rotation, detection.pose.translation)
            if rotation[:, 2] @ translation < 0:
                own = {dots[number][1] for number in pixels if target.owner[number] == k}
                pose = replace(detection.pose, rotation=rotation, translation=translation)
                _draw_marker(canvas, each.marker, camera, replace(detection, pose=pose), own)
    if detection.pose is not None:
        for axis, (name, color) in enumerate(_AXES.items()):
            ends = np.zeros((2, 3))
            ends[1, axis] = target.radius / 2
            pixel = _seen(ends, camera, detection)
            _polyline(canvas, pixel, color, width=2)
            _label(canvas, pixel[1], name, color)
    for pixel in detection.pixels if detection.unlabeled is None else detection.unlabeled.pixels:
        for arm in ((4, 0), (0, 4)):
            _polyline(canvas, pixel + np.array([arm, arm]) * [[-1], [1]], _FOUND)
    for identity, pixel in pixels.items():
        _label(canvas, pixel, labels[identity], _FOUND)


def _draw_marker(
    canvas: NDArray[Any], marker: Marker, camera: Camera | None, detection: Detection, found: set[int]
) -> None:
    """Draw the outlines of a marker and its dots, of which some were found."""
    for ring in marker.boundary.outlines():
        # In short steps, since a lens bends straight edges.
        points, _ = walked(ring, marker.boundary.radius / 40)
        _polyline(canvas, _seen(points, camera, detection), _FOUND, closed=True)
    for point in marker.control_points:
        color = _FOUND if point.id in found else _GUESSED
        for diameter in (point.feature.diameter, point.feature.inner_diameter):
            circle = np.stack([np.cos(_OUTLINE), np.sin(_OUTLINE), 0 * _OUTLINE], axis=-1) * diameter / 2
            if diameter:
                _polyline(canvas, _seen(circle + [point.x, point.y, point.z], camera, detection), color, closed=True)


def _seen(points: Array, camera: Camera | None, detection: Detection) -> Array:
    """Return pixels (m, 2) of marker points (m, 2 or 3), by pose or homography; nan where these are undefined."""
    nowhere = np.full((len(points), 2), np.nan)
    if detection.pose is not None and camera is not None:
        rotation, translation = detection.pose.rotation[None], detection.pose.translation[None]
        depth = to_camera(points, rotation, translation)[0, :, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = camera.project(points, rotation, translation)[0]
        return np.where(depth[:, None] > 0, pixels, np.nan)
    if detection.homography is None:
        return nowhere
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = apply_homography(detection.homography, points[:, :2])
    return pixels if camera is None else camera.to_pixels(camera.ideal.from_pixels(pixels))


def _polyline(
    canvas: NDArray[Any], pixels: Array, color: tuple[int, int, int], closed: bool = False, width: int = 1
) -> None:
    import cv2

    # Far outside the image, coordinates would overflow cv2's fixed point, and are not visible anyway.
    if np.isfinite(pixels).all() and np.abs(pixels).max() < 2**20:
        corners = np.rint(pixels * 2**_BITS).astype(np.int32)
        cv2.polylines(canvas, [corners], closed, color, width, cv2.LINE_AA, _BITS)


def _label(canvas: NDArray[Any], pixel: Array, text: str, color: tuple[int, int, int]) -> None:
    import cv2

    if not (np.isfinite(pixel).all() and np.abs(pixel).max() < 2**15):
        return
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    x, y = int(pixel[0]) + 7, int(pixel[1]) - 7
    cv2.rectangle(canvas, (x - 2, y - height - 3), (x + width + 2, y + 3), color, cv2.FILLED)
    cv2.putText(canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


def as_dict(detection: Detection, markers: Sequence[Target], names: Sequence[str]) -> dict[str, Any]:
    """Return the result for one marker in the form documented in docs/detect.md.

    Parameters
    ----------
    markers, names
        Markers and rigs that were looked for, and their names.
    """
    marker = markers[detection.marker]
    ids = marker.ids.tolist()
    places = {"dots": [list(marker.dots[number]) for number in detection.ids]} if marker.frame == "rig" else {}
    dots = detection if detection.unlabeled is None else detection.unlabeled
    return {
        "marker": names[detection.marker],
        "found": detection.found,
        "reason": reason(detection, names),
        "ids": detection.ids.tolist(),
        **places,
        "missing": sorted(set(ids) - set(detection.ids.tolist())) if detection.found else ids,
        "pixels": dots.pixels.tolist(),
        "covariance_px2": dots.covariance.tolist(),
        "ellipse_centers": dots.ellipse_centers.tolist(),
        "homography": None if detection.homography is None else detection.homography.tolist(),
        "pose": None if detection.pose is None else _pose(detection.pose),
        "tag": _tag(detection, marker),
        "tag_state": detection.tag_state,
        "verdict": _verdict(detection),
        "turns_deg": np.rad2deg(detection.turns).tolist(),
    }


def reason(detection: Detection, names: Sequence[str]) -> str:
    """Return why a marker was not found, with the name of the other marker if two of them fit the same dots."""
    if detection.rival is None:
        return detection.reason
    return f"{detection.reason}: {names[detection.marker]} and {names[detection.rival]}"


def in_words(detection: Detection, markers: Sequence[Target], names: Sequence[str]) -> str:
    """Return one line: the marker, and its dots found or the reason; for a pose its distance, tilt and sigma."""
    name, target = names[detection.marker], markers[detection.marker]
    if not detection.found:
        return f"{name} not found: {reason(detection, names)}"
    line = f"{name}, {len(detection.ids)} of {len(target)} dots{_UNREAD.get(detection.tag_state, '')}"
    if target.frame == "rig":
        line += f" on {len(set(target.owner[detection.ids].tolist()))} of {len(target.plates)} markers"
    if detection.pose is None:
        return f"{line}, homography only, no pose without a camera"
    pose = detection.pose
    toward = -pose.rotation.T @ pose.translation
    distance = float(np.linalg.norm(toward))
    tilt = float(np.rad2deg(np.arccos(np.clip(toward[2] / distance, -1, 1))))
    tilted = "" if target.frame == "rig" else f", tilted by {tilt:.2f} deg"
    line += (
        f", {distance:.4f} m away{tilted}; 1 sigma: {pose.budget.rotation_deg['total']:.2g} deg, "
        f"{1e3 * pose.budget.translation['total']:.2g} mm"
    )
    if pose.alternative is not None:
        line += f"; the mirrored pose fits as well, likelihood ratio {pose.likelihood_ratio:.2g}"
    verdict = detection.verdict
    return line if verdict is None or verdict.consistent else f"{line}; {verdict}"


def _tag(detection: Detection, marker: Target) -> dict[str, Any] | None:
    if detection.tag is None or not isinstance(marker, Marker) or marker.tag is None:
        return None
    return {"family": marker.tag.family, "id": marker.tag.id, "corners": detection.tag.tolist()}


def _verdict(detection: Detection) -> dict[str, Any] | None:
    verdict = detection.verdict
    if verdict is None:
        return None
    return {**verdict._asdict(), "causes": [cause._asdict() for cause in verdict.causes]}


def _pose(pose: PoseEstimate) -> dict[str, Any]:
    budget = pose.budget
    alternative = None
    if pose.alternative is not None:
        alternative = {**transform_as_dict(*pose.alternative), "likelihood_ratio": pose.likelihood_ratio}
    return {
        **transform_as_dict(pose.rotation, pose.translation),
        "covariance": budget.total.tolist(),
        "sigma": {
            "rotation_deg": {name: float(part) for name, part in budget.rotation_deg.items()},
            "translation": {name: float(part) for name, part in budget.translation.items()},
        },
        "chi2": pose.chi2,
        "degrees_of_freedom": pose.degrees_of_freedom,
        "alternative": alternative,
    }


def transform_as_dict(rotation: Array, translation: Array) -> dict[str, Any]:
    """Return a pose as plain JSON values: matrix, m, rotation vector in rad, and quaternion (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return {
        "rotation": rotation.tolist(),
        "translation": translation.tolist(),
        "rotation_vector": logarithm(rotation).tolist(),
        "quaternion_xyzw": quaternion.tolist(),
    }
