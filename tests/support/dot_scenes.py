"""Images of dots whose places and sizes are known exactly."""

import cv2
import numpy as np

SHARP = 8
"""Side of the squares of pixels that are drawn for one."""


def scene(dots, shape=(240, 320), light=190, dark=50, noise=2.0, blur=0.7, seed=0):
    """Image of ellipses (center, semi, angle in degrees, size of the hole)."""
    drawn = np.full((SHARP * shape[0], SHARP * shape[1]), light, np.uint8)
    for center, semi, angle, hole in dots:
        place = np.rint(16 * (SHARP * (np.asarray(center) + 0.5) - 0.5)).astype(int).tolist()
        for size, grey in ((1, dark), (hole, light)):
            axes = np.rint(16 * SHARP * size * np.asarray(semi)).astype(int).tolist()
            if size:
                cv2.ellipse(drawn, place, axes, angle, 0, 360, grey, -1, cv2.LINE_8, 4)
    image = cv2.resize(drawn, shape[::-1], interpolation=cv2.INTER_AREA).astype(float)
    image = cv2.GaussianBlur(image, (0, 0), blur) + noise * np.random.default_rng(seed).standard_normal(shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
