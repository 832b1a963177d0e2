"""Check the tag of a marker in a file, by the corners of its outlines or by its cells in pixels."""

# tests: tests/verification/test_check.py tests/verification/test_solids.py

from collections.abc import Callable

import numpy as np

from markergen.arrays import Array
from markergen.model.tag import Tag
from markergen.verification.findings import PlaneMotion
from markergen.verification.reading import Page
from markergen.verification.words import Finding

Sample = Callable[[Array], Array]

NAMES = ("top left", "top right", "bottom right", "bottom left")

ABSENT = "is not in its place"

BILEVEL = 0.75
"""Pixels by which a corner may be off in black and white: two edges by half a pixel each are 0.71."""

NEAR = 0.25
"""Maximum distance at which a corner counts as one of the tag's, as a share of a cell."""


def tag_findings(tag: Tag, page: Page, motion: PlaneMotion, tolerance: float) -> list[Finding]:
    """List the errors of a tag, with a tolerance in mm."""
    measured = page.picture is not None and page.picture.measured
    # A seam between tiles adds corners of its own.
    tiled = page.picture is not None and not page.picture.whole
    errors = [] if measured or tiled else _in_outlines(tag, page.corners, motion, tolerance)
    if page.picture is None or errors:
        return errors
    # In black and white, an edge along the rows of pixels may be off by half of one.
    allowed = max(tolerance, BILEVEL * page.picture.grain) if page.picture.bilevel else tolerance
    errors = _in_pixels(tag, page.picture.sample, motion, allowed if measured else None)
    if not errors or measured or tiled:
        return errors
    remedy = "show all layers, remove what covers it, and print the whole page"
    return [Finding("tag", f"the tag {tag} does not show as it should", remedy)]


def _in_outlines(tag: Tag, corners_seen: Array, motion: PlaneMotion, tolerance: float) -> list[Finding]:
    from scipy.spatial import cKDTree

    cell = float(np.linalg.norm(np.diff(motion.to_page(1e3 * tag.corners[:2]), axis=0))) / tag.cells
    wanted = motion.to_page(1e3 * np.concatenate(tag.outlines))
    if not len(corners_seen):
        return [not_there(tag)]
    tree = cKDTree(corners_seen)
    strange = tree.query(wanted)[0] > NEAR * cell
    # A corner inside the black square that is not one of the tag's belongs to another tag.
    corners = motion.to_page(1e3 * tag.corners)
    sides = [corners[1] - corners[0], corners[3] - corners[0]]
    place = np.stack([(corners_seen - corners[0]) @ side / (side @ side) for side in sides], axis=-1)
    inside = corners_seen[((place > 0) & (place < 1)).all(axis=-1)]
    more = len(inside) > 0 and bool((cKDTree(wanted).query(inside)[0] > NEAR * cell).any())
    if strange.any() or more:
        return [not_there(tag)]
    nearest = corners_seen[tree.query(corners)[1]]
    return corners_off(corners, nearest, tolerance)


def _in_pixels(tag: Tag, seen_at: Sample, motion: PlaneMotion, tolerance: float | None) -> list[Finding]:
    def sample(points: Array) -> Array:
        return np.nan_to_num(seen_at(points), nan=255.0)

    cells = tag.cells
    grid = (np.arange(-1, cells + 1) + 0.5) / cells - 0.5
    x, y = np.meshgrid(grid, -grid)
    middles = motion.to_page(1e3 * (tag.side * np.stack([x.ravel(), y.ravel()], axis=-1) + tag.center))
    seen = sample(middles).reshape(x.shape)
    level = (seen.min() + seen.max()) / 2
    ink = np.pad(tag.ink, 1)
    dark = seen < level
    if np.ptp(seen) < 32 or not (np.array_equal(dark, ink) or np.array_equal(~dark, ink)):
        return [not_there(tag)]
    if tolerance is None:
        return []
    corners = motion.to_page(1e3 * tag.corners)
    return corners_off(corners, _edges(corners, sample, cells), tolerance)


def _edges(corners: Array, sample: Sample, cells: int) -> Array:
    """Corners (4, 2) where the fitted edges of the border's ink intersect."""
    lines = []
    for k in range(4):
        start, end = corners[k], corners[(k + 1) % 4]
        along = (end - start) / np.linalg.norm(end - start)
        # They run clockwise.
        outward = np.array([-along[1], along[0]])
        half = 0.5 * float(np.linalg.norm(end - start)) / cells
        steps = (np.arange(200) + 0.5) / 200 * 2 * half - half
        feet = start + np.linspace(0.15, 0.85, 15)[:, None] * (end - start)
        values = sample((feet[:, None] + steps[:, None] * outward).reshape(-1, 2)).reshape(15, 200)
        inner, outer = values[:, :20].mean(axis=1), values[:, -20:].mean(axis=1)
        share = (values.mean(axis=1) - outer) / (inner - outer)
        points = feet + (2 * half * share - half)[:, None] * outward
        middle = points.mean(axis=0)
        direction = np.linalg.svd(points - middle)[2][0]
        lines.append((middle, direction))
    # Where each edge meets the previous one.
    crossings = []
    for (a, u), (b, v) in zip([lines[-1], *lines], lines, strict=False):
        step = np.linalg.solve(np.stack([u, -v], axis=-1), b - a)
        crossings.append(a + step[0] * u)
    return np.array(crossings)


def corners_off(wanted: Array, corners: Array, tolerance: float) -> list[Finding]:
    """Findings about corners (4, 2) of a tag in mm that are elsewhere."""
    off = np.linalg.norm(corners - wanted, axis=-1)
    return [
        Finding("tag", f"the {NAMES[k]} corner of the tag is {1e3 * off[k]:.4g} um off")
        for k in np.flatnonzero(off > tolerance)
    ]


def not_there(tag: Tag) -> Finding:
    """Finding about a tag of which another or nothing is in its place."""
    return Finding("tag", f"the tag {tag} {ABSENT}")
