"""Explain a file whose dots are the marker's after a change of scale, unit or shape: what to undo, and its words."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markergen.verification.matching import DotSet, best_match, dots_of
from markergen.verification.reading import Page, Reading
from markergen.verification.words import Finding, scale_finding

Array = NDArray[np.float64]

FEWEST = 3
"""Minimum number of dots of one size that can be the marker's."""

MOST_TRIED = 8
"""Maximum number of sizes of circles that are tried as those of the dots."""

SAME = 1.02
"""Maximum ratio between circles of one size."""

ROUGH = 0.02
"""Maximum misfit of a shear or stretch, as a share of the marker's size, that is tried."""


def changes(page: Page, expected: DotSet) -> Iterator[tuple[Array, Array]]:
    """Linear maps that a page may have undergone: the map (2, 2) to undo it, and the change in the marker frame.

    The change is upper triangular: scales along x and y on its diagonal, and a shear.
    """
    identity = np.eye(2)
    for ratio in _ratios(page, expected):
        found = dots_of(moved_page(page, identity / ratio), expected)
        if len(found) < FEWEST:
            continue
        change = _stretch(expected, found) if len(found) == len(expected) else None
        if change is not None:
            turn, shape = change
            yield turn @ np.linalg.inv(ratio * shape) @ turn.T, ratio * shape
        yield identity / ratio, ratio * identity


def _ratios(page: Page, expected: DotSet) -> list[float]:
    """Ratios of sizes of circles to that of most dots, those that occur as often as the dots first."""
    radii = page.circles[:, 2]
    if not len(radii):
        return []
    if not np.isfinite(radii).all():
        apart = [np.sqrt(np.mean(np.sum((c - c.mean(axis=0)) ** 2, axis=1))) for c in
                 (page.circles[:, :2], expected.centers)]  # fmt: skip
        return [float(apart[0] / apart[1])] if apart[0] > 0 and len(radii) == len(expected) else []
    sizes, often = np.unique(expected.radii, return_counts=True)
    usual = float(sizes[np.argmax(often)])
    ordered = np.sort(radii[radii > 0])
    groups = np.split(ordered, np.flatnonzero(ordered[1:] > SAME * ordered[:-1]) + 1)
    groups = [group for group in groups if len(group) >= FEWEST - 1]
    groups.sort(key=lambda group: (abs(len(group) - int(often.max())), -group[0]))
    return [float(np.median(group)) / usual for group in groups[:MOST_TRIED]]


def _stretch(expected: DotSet, found: DotSet) -> tuple[Array, Array] | None:
    """Rotation, possibly mirrored, and upper triangular map, whose product maps the layout onto the found dots.

    Both are made equally wide in all directions first, after which a rotation maps one onto the other.
    """
    sides = []
    for dots in (expected, found):
        offset = dots.centers - dots.centers.mean(axis=0)
        value, vector = np.linalg.eigh(offset.T @ offset / len(offset))
        if value.min() <= 1e-9 * value.max():
            return None
        sides.append(offset @ (vector / np.sqrt(value)) @ vector.T)
    scale = float(np.ptp(expected.centers))
    even, evened = (replace(dots, centers=scale * side) for dots, side in zip((expected, found), sides, strict=True))
    match = best_match(even, evened, found.ordered, None)
    if match is None or (match.found < 0).any():
        return None
    source = expected.centers - expected.centers.mean(axis=0)
    target = found.centers[match.found] - found.centers.mean(axis=0)
    matrix = np.linalg.lstsq(source, target, rcond=None)[0].T
    if np.linalg.norm(source @ matrix.T - target, axis=1).max() > ROUGH * scale or np.linalg.det(matrix) == 0:
        return None
    turn, shape = np.linalg.qr(matrix)
    signs = np.sign(np.diag(shape))
    return turn * signs, shape * signs[:, None]


def change_findings(change: Array, expected: DotSet, tolerance: float, pixels: bool) -> list[Finding]:
    """Findings about a change, upper triangular, in the marker frame."""
    half = np.ptp(expected.centers, axis=0) / 2
    x, y = float(change[0, 0]), float(change[1, 1])
    slant = float(change[0, 1] / change[1, 1])
    findings = []
    if abs(slant) * half.max() > tolerance:
        said = f"sheared by {abs(np.degrees(np.arctan(slant))):.3g} degrees: its axes are not at right angles"
        findings.append(Finding("sheared", said, "undo the skew, or export it again"))
    if max(abs(x - 1), abs(y - 1)) * half.max() > tolerance:
        findings.append(scale_finding(x, y, half, tolerance, pixels))
    return findings


def moved(reading: Reading, matrix: Array) -> Reading:
    """Reading with a linear map (2, 2) applied to all flat pages."""
    return replace(reading, pages=tuple(moved_page(page, matrix) for page in reading.pages))


def moved_page(page: Page, matrix: Array) -> Page:
    """Page with a linear map (2, 2) applied; circles stay circles of the same area."""
    scale = float(np.sqrt(abs(np.linalg.det(matrix))))
    circles = np.column_stack([page.circles[:, :2] @ matrix.T, scale * page.circles[:, 2]])
    picture = None
    if page.picture is not None:
        back, seen = np.linalg.inv(matrix), page.picture
        picture = replace(seen, sample=lambda points: seen.sample(points @ back.T), grain=seen.grain * scale)
    lines = None if page.lines is None else page.lines @ matrix.T
    return replace(page, circles=circles, corners=page.corners @ matrix.T, picture=picture, lines=lines)
