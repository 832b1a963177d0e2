"""Drawing of what was found into its image, a window that shows it by Tk, and poses as plain JSON values."""

# tests: tests/detect/test_presentation.py tests/detect/test_detector.py tests/detect/test_window.py

import gc
import os
import sys
from collections.abc import Sequence
from time import monotonic
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
    """Return the upper eight of the bits in use: many a sensor of 10 or 12 bits leaves the upper ones of 16 empty."""
    unused = max(int(levels.max(initial=0)).bit_length() - 8, 0)
    return np.asarray(levels >> unused, dtype=np.uint8)


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
    taken: list[Array] = []
    if pose is not None:
        for axis, (name, color) in zip(np.eye(3), _AXES.items(), strict=True):
            pixels = _seen(result, None, np.stack([0 * axis, axis]) * target.radius / 2)
            _polyline(canvas, pixels, color, width=2)
            _label(canvas, pixels[1], name, color, result.pixels, taken)
    for pixel in result.pixels:
        for arm in ((4, 0), (0, 4)):
            _polyline(canvas, pixel + np.array([arm, arm]) * [[-1], [1]], _FOUND)
    row = {number: k for k, number in enumerate(target.ids.tolist())}
    for number, pixel in zip(result.ids.tolist(), result.pixels, strict=False):
        _label(canvas, pixel, str(target.dots[row[number]][1]), _FOUND, result.pixels, taken)


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


def _label(
    canvas: NDArray[Any], pixel: Array, text: str, color: tuple[int, int, int], points: Array, taken: list[Array]
) -> None:
    """Draw text beside a pixel where it hides neither points (k, 2) nor boxes taken before; without room, none."""
    import cv2

    if not (np.abs(pixel) < _FARTHEST).all():
        return
    larger = max(1.0, len(canvas) / 720)
    size, bold = 0.45 * larger, round(larger)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, bold)
    for side, rise in ((1, -1), (-1, -1), (-1, 1), (1, 1)):
        x, y = (pixel + [side * (7 + width / 2) - width / 2, rise * (7 + height / 2) + height / 2]).astype(int).tolist()
        box = np.array([[x - 2, y - height - 3], [x + width + 2, y + 3]])
        hides = ((points > box[0]) & (points < box[1])).all(axis=1).any()
        if not hides and not any((box[0] < other[1]).all() and (other[0] < box[1]).all() for other in taken):
            taken.append(box)
            cv2.rectangle(canvas, box[0].tolist(), box[1].tolist(), color, cv2.FILLED)
            cv2.putText(canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), bold, cv2.LINE_AA)
            return


def transform_as_dict(rotation: Array, translation: Array) -> dict[str, Any]:
    """Return a pose as plain JSON values: matrix, m, rotation vector in rad, and quaternion (x, y, z, w)."""
    from scipy.spatial.transform import Rotation

    return {
        "rotation": rotation.tolist(),
        "translation": translation.tolist(),
        "rotation_vector": logarithm(rotation).tolist(),
        "quaternion_xyzw": Rotation.from_matrix(rotation).as_quat(canonical=True).tolist(),
    }


SECONDS_BETWEEN, SHOWING_SHARE = 0.03, 0.25
"""Least time in s between images, and the share of all time that showing them may take: the rest is for the search."""

_WINDOW_REMEDY = "give --overlay out.mp4 to write a video, or --no-window"


def has_display() -> bool:
    """Return whether a window can be expected to open."""
    return bool(os.environ.get("DISPLAY")) if sys.platform.startswith("linux") else True


class Window:
    """A window, closed by q, Esc or its button; images larger than the screen are reduced.

    Raises
    ------
    InputError
        If there is no display, or Python has no Tk.
    """

    def __init__(self, title: str) -> None:
        no_display = InputError("a display for a window", "none", _WINDOW_REMEDY)
        if not has_display():
            raise no_display
        try:
            import tkinter
        except ImportError:
            raise InputError("a Python with Tk for a window", "none (python3-tk)", _WINDOW_REMEDY) from None
        try:
            self._root = tkinter.Tk()
        except tkinter.TclError:
            raise no_display from None
        self._photo: Any = None
        self._label = tkinter.Label(self._root, borderwidth=0)
        self._label.pack()
        self._next = -np.inf
        self.closed = False
        self._root.title(title)
        self._root.resizable(False, False)
        for key in ("q", "<Escape>"):
            self._root.bind(key, self._close)
        self._root.protocol("WM_DELETE_WINDOW", self._close)

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show an image (h, w, 3), BGR, unless it comes too soon after the last one."""
        import tkinter

        import cv2

        start = monotonic()
        if not self.closed and start >= self._next:
            height, width = image.shape[:2]
            scale = min(
                1.0, 0.9 * self._root.winfo_screenwidth() / width, 0.9 * self._root.winfo_screenheight() / height
            )
            if scale < 1:
                image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
            header = f"P6 {image.shape[1]} {image.shape[0]} 255 ".encode()
            self._photo = tkinter.PhotoImage(data=header + image[..., ::-1].tobytes(), format="PPM", master=self._root)
            self._label.configure(image=self._photo)
            self._root.update()
            self._next = start + max(SECONDS_BETWEEN, (monotonic() - start) / SHOWING_SHARE)
        else:
            self._root.update()

    def close(self) -> None:
        """Close the window."""
        self._close()
        self._root.destroy()
        # Tcl ends the program if another thread collects what is left of the window.
        del self._photo, self._label, self._root
        gc.collect()

    def _close(self, _: object = None) -> None:
        self.closed = True
