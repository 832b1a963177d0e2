"""Whether a page reads the right way round: its letters and digits against those of the font, or their mirror images.

A layout that is its own mirror image, such as a regular polygon with its key ring, does not tell whether a sheet has
been mirrored; what is written on it does.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.scene import FilledPath

Array = NDArray[np.float64]

CHARACTERS = "1245679aefghkprtyFGJKLPRQ"
"""Those of one piece whose mirror image is none of them, roughly."""

LEAST_PX, MOST_PX = 12, 120
"""Height of a character in pixels of the image that it is looked at in."""

LEAST_VOTES, MAJORITY = 4, 3.0
"""Characters that must be recognized, and how many times as often one way as the other."""

NEAR, CLEAR = 0.05, 2.0
"""How far a shape may be from a character's, and how many times as far from all of the mirrored ones."""

FINE = 0.08
"""Pixel of that image in mm, about; characters are 1.5 mm high or more."""

BAND = 8_000_000
"""Pixels that are looked at at once."""

MOST_SHAPES = 20_000

MIRROR = np.array([1, 1, 1, 1, -1, 1, -1])
"""What a mirror makes of the signs of the invariants."""

DRAWN_PX = 60
"""Height of the capitals that these are compared with, px."""


def reads_upright(grey: NDArray[np.uint8], scale: Array) -> bool | None:
    """Tell whether the characters on a page, at `scale` (x, y) pixels per mm, are mirrored; None if none is told.

    The page may be turned any way.
    """
    import cv2

    step = max(round(FINE * float(scale.min())), 1)
    height, width = (side // step for side in grey.shape)
    if min(height, width) < 1:
        return None
    small = cv2.resize(grey[: height * step, : width * step], (width, height), interpolation=cv2.INTER_AREA)
    level = (int(small.min()) + int(small.max())) / 2
    rows = max(BAND // width, 4 * MOST_PX)
    for dark in (True, False):
        votes = np.zeros(2)
        # What one band cuts the next one has whole.
        for top in range(0, height, rows - MOST_PX):
            votes += _votes((small[top : top + rows] < level) == dark, scale)
        plain, mirrored = votes
        if plain + mirrored >= LEAST_VOTES and max(plain, mirrored) >= MAJORITY * min(plain, mirrored):
            return bool(plain > mirrored)
    return None


def _votes(ink: NDArray[np.bool_], scale: Array) -> Array:
    """How many characters are plain, and how many mirrored."""
    import cv2

    votes = np.zeros(2)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(ink.astype(np.uint8), connectivity=8)
    sides = stats[1:, 2:4]
    sized = (sides.max(axis=1) >= LEAST_PX) & (sides.max(axis=1) <= MOST_PX) & (sides.min(axis=1) >= LEAST_PX / 4)
    for index in 1 + np.flatnonzero(sized)[:MOST_SHAPES]:
        left, top, across, down, _ = stats[index]
        y, x = np.nonzero(labels[top : top + down, left : left + across] == index)
        votes += _vote(_invariants(x / scale[0], -y / scale[1], np.ones(len(x))))
    return votes


def _vote(shape: Array) -> Array:
    """(1, 0) for a character, (0, 1) for a mirrored one, (0, 0) for what is neither or both."""
    known = _font()
    plain, mirrored = (float(np.linalg.norm(known - each, axis=-1).min()) for each in (shape, shape * MIRROR))
    if min(plain, mirrored) > NEAR or max(plain, mirrored) < CLEAR * min(plain, mirrored):
        return np.zeros(2)
    return np.array([1.0, 0.0]) if plain < mirrored else np.array([0.0, 1.0])


def _invariants(x: Array, y: Array, weight: Array) -> Array:
    """Seven numbers of a shape that no turn, shift or scale changes; a mirror changes the sign of the 5th and 7th.

    From its complex moments of second and third order (Flusser).
    """
    mass = weight.sum()
    z = (x - (weight @ x) / mass) + 1j * (y - (weight @ y) / mass)
    z = z / np.sqrt(weight @ np.abs(z) ** 2 / mass)

    def moment(p: int, q: int) -> complex:
        return complex(weight @ (z**p * np.conj(z) ** q) / mass)

    c20, c21, c30 = moment(2, 0), moment(2, 1), moment(3, 0)
    c12 = np.conj(c21)
    second, third = c20 * c12**2, c30 * c12**3
    return np.array([abs(c20), abs(c21), abs(c30), second.real, second.imag, third.real, third.imag])


@cache
def _font() -> Array:
    """Invariants (g, 7) of the characters of the fonts that sheets are written in."""
    import cv2

    from markergen.drawing.text import FACES, text

    rows = []
    for face in FACES:
        for character in CHARACTERS:
            contours = _contours(text(character, 20.0, 20.0, DRAWN_PX, face=face))
            picture = np.zeros((3 * DRAWN_PX, 3 * DRAWN_PX), dtype=np.uint8)
            cv2.fillPoly(picture, [np.rint(16 * contour).astype(np.int32) for contour in contours], 1, shift=4)
            y, x = np.nonzero(picture)
            # The picture has y up already: its rows are the outline's y.
            rows.append(_invariants(x.astype(float), y.astype(float), np.ones(len(x))))
    return np.array(rows)


def _contours(outline: FilledPath) -> list[Array]:
    """Closed polygons of an outline of lines and quadratic curves."""
    contours: list[list[Array]] = []
    for command, points in outline.segments:
        if command == "M":
            contours.append([np.array(points[0])])
        elif command == "Q":
            start, (control, end) = contours[-1][-1], np.array(points)
            for t in (0.25, 0.5, 0.75, 1.0):
                contours[-1].append((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end)
        elif points:
            contours[-1] += [np.array(point) for point in points]
    return [np.array(contour) for contour in contours]
