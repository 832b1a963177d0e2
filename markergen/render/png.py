"""Images as PNG, with marks where something was found."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_COLOR = (0, 140, 255)
"""Orange, as cv2 orders it: blue, green, red."""

_SUBPIXEL_BITS = 4


def png(image: NDArray[np.uint8], pixels: NDArray[np.float64] | None = None, labels: Sequence[object] = ()) -> bytes:
    """Grey image (h, w) as PNG bytes, with a cross and a label at each of the pixels (m, 2).

    The same input gives the same bytes. Points that are not finite get no mark.
    """
    import cv2

    if pixels is None:
        return bytes(cv2.imencode(".png", image)[1])
    drawn = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for pixel, label in zip(pixels, labels or [""] * len(pixels), strict=True):
        if not np.isfinite(pixel).all():
            continue
        for arm in ((5, 0), (0, 5)):
            first, second = (np.rint((pixel + side * np.array(arm)) * 2**_SUBPIXEL_BITS) for side in (-1, 1))
            cv2.line(
                drawn, first.astype(int).tolist(), second.astype(int).tolist(), _COLOR, 1, cv2.LINE_AA, _SUBPIXEL_BITS
            )
        corner = (int(pixel[0]) + 7, int(pixel[1]) - 7)
        cv2.putText(drawn, str(label), corner, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _COLOR, 1, cv2.LINE_AA)
    return bytes(cv2.imencode(".png", drawn)[1])
