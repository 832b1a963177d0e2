"""How noisy an image is."""

import numpy as np
from numpy.typing import NDArray

_PIECE = 32


def grey_noise(image: NDArray[np.uint8] | NDArray[np.uint16]) -> float:
    """Standard deviation of the grey noise: of neighbors' differences, over sqrt(2), where they are small.

    In every eighth row, the fifth part of the pieces of 32 px that differ least count: plain paper is there, if
    anywhere. Zero for images without such pieces.

    Parameters
    ----------
    image : array (h, w), grey levels
    """
    rows = image[::8, : image.shape[1] // _PIECE * _PIECE].astype(np.float32)
    if not rows.size:
        return 0.0
    spread = np.mean(np.square(np.diff(rows.reshape(-1, _PIECE), axis=1)), axis=1)
    # Saturated pieces have no noise to show.
    spread = spread[spread > 0]
    return float(np.sqrt(np.percentile(spread, 20) / 2)) if len(spread) else 0.0
