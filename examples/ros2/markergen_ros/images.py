"""From sensor_msgs/Image to an array as OpenCV has it, without cv_bridge."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError

ENCODINGS = {"mono8": (1, 1), "8UC1": (1, 1), "bgr8": (3, 1), "rgb8": (3, 1), "bgra8": (4, 1), "rgba8": (4, 1)}
ENCODINGS |= {"mono16": (1, 2), "16UC1": (1, 2), "bgr16": (3, 2), "rgb16": (3, 2), "8UC3": (3, 1)}
"""Channels, and bytes of each."""


def array_of(message: Any) -> NDArray[Any]:
    """Return an image (h, w) or (h, w, channels), BGR; rows may be padded, 16 bits in either byte order.

    Raises InputError for another encoding, such as a Bayer pattern, and for an image with less data than it says.
    """
    if message.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise InputError(f"an image in {known}", message.encoding or "no encoding", "convert it, as image_proc does")
    channels, size = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    used, data = width * channels * size, np.frombuffer(bytes(message.data), np.uint8)
    if step < used or len(data) < height * step:
        expected = f"{height} rows of at least {used} bytes"
        raise InputError(expected, f"{len(data)} bytes with step {step}", "check the camera's driver")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :used])
    order = ">" if message.is_bigendian else "<"
    image = rows.view(f"{order}u{size}").astype(f"u{size}").reshape(height, width, channels)
    if message.encoding.startswith("rgb"):
        image = image[..., [2, 1, 0, 3][:channels]]
    return image[..., 0] if channels == 1 else image
