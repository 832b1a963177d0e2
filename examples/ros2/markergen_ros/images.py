"""From sensor_msgs/Image and CameraInfo to what the detector takes, without cv_bridge."""

from typing import Any

import numpy as np
from markergen_detect import Camera, DescriptionError
from numpy.typing import NDArray

ENCODINGS = {"mono8": (1, 1), "8UC1": (1, 1), "bgr8": (3, 1), "rgb8": (3, 1), "bgra8": (4, 1), "rgba8": (4, 1)}
ENCODINGS |= {"mono16": (1, 2), "16UC1": (1, 2), "bgr16": (3, 2), "rgb16": (3, 2), "8UC3": (3, 1)}
"""Channels, and bytes of each."""
LUMA = np.array([0.114, 0.587, 0.299])
"""Of blue, green and red, ITU-R BT.601."""


def array_of(message: Any) -> NDArray[Any]:
    """Return an image (h, w) or (h, w, channels), BGR; rows may be padded, 16 bits in either byte order.

    Raises DescriptionError for another encoding, such as a Bayer pattern, and for an image with less data than it says.
    """
    if message.encoding not in ENCODINGS:
        expected, result = ", ".join(ENCODINGS), message.encoding or "no encoding"
        raise DescriptionError(f"expected an image in {expected}, found {result}; convert it, as image_proc does")
    channels, size = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    used, data = width * channels * size, np.frombuffer(bytes(message.data), np.uint8)
    if step < used or len(data) < height * step:
        expected = f"expected {height} rows of at least {used} bytes"
        raise DescriptionError(f"{expected}, found {len(data)} bytes with step {step}; check the camera's driver")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :used])
    order = ">" if message.is_bigendian else "<"
    image = rows.view(f"{order}u{size}").astype(f"u{size}").reshape(height, width, channels)
    if message.encoding.startswith("rgb"):
        image = image[..., [2, 1, 0, 3][:channels]]
    return image[..., 0] if channels == 1 else image


def grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image as grey levels of the same type."""
    return image if image.ndim == 2 else np.rint(image[..., :3] @ LUMA).astype(image.dtype)


def camera_of(message: Any) -> Camera:
    """Return the camera of a CameraInfo; raises DescriptionError if it was never calibrated, or belongs to a part."""
    roi = getattr(message, "roi", None)
    if max(message.binning_x, message.binning_y) > 1 or (roi is not None and (roi.x_offset or roi.y_offset)):
        raise DescriptionError("expected a camera_info of whole images, found binning or a region; use the whole ones")
    k, d = list(message.k), list(message.d)
    numbers = {"width": message.width, "height": message.height, "fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5]}
    return Camera.load({**numbers, "distortion": {"model": message.distortion_model, "coefficients": d} if d else None})
