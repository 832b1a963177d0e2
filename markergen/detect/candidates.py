"""Candidate dots: dark regions with an even edge from dark to light all around, and their rough ellipses."""

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices
from markergen.detect import kernel
from markergen.detect.blobs import Blobs, Image
from markergen.detect.blurred_outlines import unblurred
from markergen.detect.components import Components, find_components

Bools = NDArray[np.bool_]
Eight = NDArray[np.uint8]

# Columns of the rows that describe an edge, in pixels and grey levels of a level of the pyramid; see `_even_edges`.
CENTER, AXES, LIGHT, STEP, UNEVEN, RMS, SLOPE, MIDDLE, INVERSE = (
    slice(0, 2),
    slice(2, 5),
    5,
    6,
    7,
    8,
    9,
    10,
    slice(11, 14),
)
COLUMNS = 14

_SECTORS = 24
_OFFSETS = np.array([-5.0, -3, -2, -1, 0, 1, 2, 3, 5])
_ZERO = 4
"""Places across the outline where its profile is sampled, px, as in kernel.c, and the index of the outline's own."""

_INSIDE, _OUTSIDE = -2.0, 1.5
_LEAST_STEP, _STEP_SHARE = 6.0, 0.3
_LEAST_EIGHTHS = 6
"""The first, cheap test: 6 of 8 directions have a step of at least 6 grey levels and 0.3 of the mean between pixels
inside and outside of the outline of a component, which is too large by about a pixel."""

_EVERY = 2, 1
_MIN_SECTORS = 9, 17
"""Sectors that must have an edge, of every other one at first, then of all: a quarter or a little more may be hidden,
washed out by light, or cut off."""
_MIN_STEP = 12.0
_ALIKE = 0.35
"""Minimum step: in grey levels of 8 bits, and, like the inverse of its maximum, relative to the median."""
_MAX_UNEVEN = 0.5, 0.38
"""Maximum standard deviation of the step over the sectors, without the three least and three largest, over its median,
of a component's outline and of the ellipse found. In photographs, dots have 0.02, 95 % of them below 0.15; leaves,
letters, cloth and stones 0.1 to 0.6."""
_MAX_RMS = (0.28, 0.03), (0.22, 0.015)
"""Maximum RMS distance of the edge from the ellipse, px, and what is added for each px of its shorter semi-axis. Dots
have 0.02 to 0.15, clutter 0.1 to 1."""
_MIN_SEMI, _MAX_ELONGATION = 0.5, 12.0
_ROUNDS = 2, 3
"""Solutions of least squares, each with weights by the residuals of the one before."""
_LEAST_SCALE, _SOFT = 0.04, 2.5
"""Residuals of more than 2.5 times their scale, which is at least 0.04 px, lose most of their weight."""

_TURNS = 2 * np.pi * np.arange(_SECTORS) / _SECTORS
_CIRCLE = np.stack([np.cos(_TURNS), np.sin(_TURNS)])
_MIDDLE, _MIDDLE_SHARE, _MIDDLE_PX = 0.05, 0.2, 0.6
"""The middle is the mean of center and eight points at 0.2 of the outline less 0.6 px of its shorter semi-axis, but at
0.05 at least: where the hole is wide, noise is averaged away."""

_LIMITS = np.array(
    [
        _INSIDE, _OUTSIDE, _LEAST_STEP, _STEP_SHARE, _LEAST_EIGHTHS, *_MIN_SECTORS, _MIN_STEP, _ALIKE, *_MAX_UNEVEN,
        *_MAX_RMS[0], *_MAX_RMS[1], *_ROUNDS, _MIN_SEMI, _MAX_ELONGATION, _LEAST_SCALE, _SOFT, _MIDDLE,
        _MIDDLE_SHARE, _MIDDLE_PX,
    ]
)  # fmt: skip
"""In the order of kernel.c."""

_MIN_COARSE = 3.0
"""Minimum shorter semi-axis of a component of a coarser level than the finest: the finer level has seen smaller dots
better."""

_CLEAR_DOUBT = 0.5
_CLEAR_UNEVEN, _CLEAR_RMS = 0.2, 0.15
_GROWN_PX = 1.0
"""Dots whose edge is more even than this, and closer to the ellipse, px, are not measured again at coarser levels,
where their components are larger than they by up to a pixel."""

_SMALLEST, _LARGEST = 1e-6, 1e9
"""Limits, px, beyond which a rough outline is none, as in kernel.c."""

_SAME_PLACE, _SAME_SIZE = 0.5, 0.3
_BLURRED_PX = 1.0
"""Outlines whose centers and semi-axes differ by less than these shares of the shorter semi-axis are of one dot; of
coarser levels, also if the semi-axes differ by a pixel of the level."""
_LARGE_PX = 8.0
_MISFIT = 1.6
"""Variance of the crossings relative to the weighted mean square of their distances from the ellipse: five of 24
degrees of freedom went into it, and the largest distances count less."""
_CROSSING_PX, _CENTER_PX = 0.04, 0.015
"""Least standard deviation of a crossing, and of a center beyond what follows from the crossings, in pixels of the
level: edges are neither straight nor of one width, and pixels are squares."""


def find_blobs(image: Image) -> Blobs:
    """Find what could be a dot, with rough ellipses, the most likely dots first.

    Where components of dark pixels have an edge from dark to light all around, of about the same step, the place where
    the grey level is halfway between both sides is found to a fraction of a pixel on 24 normals of the outline. An
    ellipse is fitted to these places, with little weight on those that disagree, twice. Up to seven of the 24 may be
    missing: hidden, in a highlight, or beyond the image's edge. Of a sharp dot, center and semi-axes are good to a few
    hundredths of a pixel.

    Near convex edges, and where a dot or a ring's ink is no wider than the blur, the grey level halfway is not at the
    edge; the semi-axes are corrected for that (`unblurred`).

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16

    Returns
    -------
    Blobs
        None of them fitted. `middle` is evidence of a ring: the level in the middle relative to what a disk, 0, and a
        ring with a hole of half its size, 1, of this outline and blur would show; 0.5 where both would show the same.
        `covariance` follows from the distances of the edge from the ellipse.
    """
    components = find_components(image)
    scale = np.ldexp(1.0, components.level)
    rough = _outlines(components, scale)
    finest = int(np.log2(components.coarsest))
    sought = (components.level == finest) | (_least(rough[:, AXES]) > _MIN_COARSE)
    clear, parts, scales = np.zeros((0, 3)), [np.zeros((0, COLUMNS))], [np.zeros(0)]
    for level, grey in enumerate(components.levels, finest):
        # Places in pixels of the finer level become those of this one, of which each is two by two.
        clear = (clear - [0.5, 0.5, 0]) / 2
        of_level = rough[sought & (components.level == level)]
        if not len(of_level):
            continue
        edges = even_edges(grey, of_level[~_known(of_level, clear, grey.shape[1])])
        clear = np.concatenate([clear, _clear(edges)])
        if level > finest:
            # Corners show at the finer level, which gives more exact ellipses, too.
            level, grey = level - 1, components.levels[level - 1 - finest]
            edges = even_edges(grey, np.column_stack([2 * edges[:, CENTER] + 0.5, 2 * edges[:, AXES]]))
        parts.append(edges)
        scales.append(np.full(len(edges), float(1 << level)))
    edges, scale = np.concatenate(parts), np.concatenate(scales)
    blobs = _blobs(edges, scale, components)
    kept = _distinct(blobs, scale)
    return blobs.take(kept[np.argsort(_doubt(edges[kept]), kind="stable")])


def _clear(edges: Array) -> Array:
    """Return place and mean semi-axis (j, 3) of edges that no coarser level shows better."""
    edges = edges[(edges[:, UNEVEN] < _CLEAR_UNEVEN) & (edges[:, RMS] < _CLEAR_RMS)]
    return np.stack([edges[:, 0], edges[:, 1], _mean_semi(edges)], axis=-1)


def _known(rough: Array, clear: Array, width: int) -> Bools:
    """Return whether outlines (k, 5) have the size and, but for a pixel or two, the place of dots found (j, 3)."""
    if not len(clear):
        return np.zeros(len(rough), dtype=bool)

    def pixels(rows: Array) -> Indices:
        return np.asarray(np.rint(rows[:, 1]) * (width + 2) + np.rint(rows[:, 0]), dtype=np.intp)

    found = pixels(clear)
    order = np.argsort(found)
    around = np.add.outer(np.arange(-1, 2) * (width + 2), np.arange(-1, 2)).reshape(-1)
    sought = np.add.outer(pixels(rough), around)
    place = order[np.minimum(np.searchsorted(found, sought, sorter=order), len(found) - 1)]
    size = clear[place, 2]
    alike = np.abs(_mean_semi(rough)[:, None] - size) < _SAME_SIZE * size + _GROWN_PX
    return np.asarray(((found[place] == sought) & alike).any(axis=1))


def _outlines(components: Components, scale: Array) -> Array:
    """Return center and axes (k, 5) of components in pixels of their level.

    Axes are the symmetric matrix A (a11, a12, a22) whose product with the unit circle is the outline: the root of Q.
    """
    xx, xy, yy = (components.spread[:, row, column] / scale**2 for row, column in ((0, 0), (0, 1), (1, 1)))
    determinant = np.sqrt(np.maximum(xx * yy - xy * xy, 1e-12))
    root = np.sqrt(xx + yy + 2 * determinant)
    x, y = (components.center.T - (scale - 1) / 2) / scale
    return np.stack([x, y, (xx + determinant) / root, xy / root, (yy + determinant) / root], axis=-1)


def _least(axes: Array) -> Array:
    """Return the shorter semi-axes (k,)."""
    a, b, c = axes.T
    return np.asarray((a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b * b))


def _mean_semi(ellipses: Array) -> Array:
    """Return the geometric means (k,) of the semi-axes."""
    a, b, c = ellipses[:, AXES].T
    return np.asarray(np.sqrt(a * c - b * b))


def even_edges(image: Eight, rough: Array) -> Array:
    """Return the even edges near rough outlines: center and axes (k, 5).

    Returns
    -------
    array (j, 14)
        Of those that have one, in the same order: center and axes; level outside; median step; unevenness; RMS distance
        from the ellipse; difference of the mean levels 1 px outside and 1 px inside; level in the middle; xx, xy and yy
        of the center's covariance if every crossing's variance were 1.
    """
    if not len(rough) or min(image.shape) < 2:
        return np.zeros((0, COLUMNS))
    if kernel.library() is None:
        return _even_edges(image, rough)
    return kernel.even_edges(image, rough, _CIRCLE, _LIMITS)


def _even_edges(image: Eight, rough: Array) -> Array:
    """Return the even edges near rough outlines: the twin of the function in kernel.c."""
    rough = rough[(np.abs(rough) < _LARGEST).all(axis=1) & (_least(rough[:, AXES]) > _SMALLEST)]
    chosen = _stands_out(image, rough)
    found = rough[chosen]
    for done in range(2):
        found = _at_crossings(image, found[:, :5], done)
    size = np.maximum(_MIDDLE, _MIDDLE_SHARE - _MIDDLE_PX / _least(found[:, AXES]))
    inside = found.copy()
    inside[:, AXES] *= size[:, None]
    x, y = _on_outline(inside, np.concatenate([np.zeros((2, 1)), _CIRCLE[:, ::3]], axis=1))
    found[:, MIDDLE] = _bilinear(image, x, y).mean(axis=-1)
    return found


def _on_outline(ellipses: Array, circle: Array) -> Array:
    """Return the points (2, k, t) of ellipses for points (2, t) of the unit circle."""
    x, y, a, b, c = ellipses[:, :5, None].swapaxes(0, 1)
    return np.stack([x + a * circle[0] + b * circle[1], y + b * circle[0] + c * circle[1]])


def _normals(ellipses: Array, circle: Array) -> Array:
    """Return the outward unit normals (2, k, t)."""
    a, b, c = ellipses[:, AXES, None].swapaxes(0, 1)
    normal = np.stack([c * circle[0] - b * circle[1], a * circle[1] - b * circle[0]])
    return np.asarray(normal / np.sqrt(normal[0] ** 2 + normal[1] ** 2))


def _within(points: Array, image: Eight) -> Bools:
    height, width = image.shape
    x, y = points
    return np.asarray((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))


def _stands_out(image: Eight, rough: Array) -> Indices:
    """Return the indices of outlines with a step from dark to light in most of eight directions."""
    height, width = image.shape
    place, normal = _on_outline(rough, _CIRCLE[:, ::3]), _normals(rough, _CIRCLE[:, ::3])

    def level(offset: Array | float) -> Array:
        x, y = np.floor(place + offset * normal + 0.5)
        x, y = np.clip(x, 0, width - 1).astype(np.intp), np.clip(y, 0, height - 1).astype(np.intp)
        return image[y, x].astype(float)

    step = level(_OUTSIDE) - level(np.maximum(_INSIDE, -_least(rough[:, AXES]))[:, None])
    enough = np.maximum(_LEAST_STEP, _STEP_SHARE * step.mean(axis=1))
    good = (step > enough[:, None]) & _within(place, image)
    return np.flatnonzero(good.sum(axis=1) >= _LEAST_EIGHTHS)


def _at_crossings(image: Eight, ellipses: Array, done: int) -> Array:
    """Return rows (j, 14), without the middle, of the ellipses through the edges near given ones (k, 5).

    Parameters
    ----------
    done : int
        How often that was done before.
    """
    circle = _CIRCLE[:, :: _EVERY[done]]
    place, normal = _on_outline(ellipses, circle), _normals(ellipses, circle)
    # At most as far inside as the middle of the shorter axis.
    offset = np.maximum(_OFFSETS, -_least(ellipses[:, AXES])[:, None])
    grey = _bilinear(image, *(place[..., None] + normal[..., None] * offset[:, None]))
    # The nearest place where the level rises past the mean of the lightest outside and the darkest inside.
    light, dark = grey[..., _ZERO:].max(axis=-1), grey[..., : _ZERO + 1].min(axis=-1)
    half = ((light + dark) / 2)[..., None]
    below, above = grey[..., :-1], grey[..., 1:]
    rises = (below < half) & (above >= half)
    share = (half - below) / np.where(rises, above - below, 1)
    crossing = offset[:, None, :-1] + share * (offset[:, 1:] - offset[:, :-1])[:, None]
    crossing = np.where(rises, crossing, np.inf)
    nearest = np.argmin(np.abs(crossing), axis=-1)
    away = np.take_along_axis(crossing, nearest[..., None], axis=-1)[..., 0]

    step = light - dark
    median = np.median(step, axis=1)
    good = np.isfinite(away) & _within(place, image)
    good &= (step > _ALIKE * median[:, None]) & (_ALIKE * step < median[:, None])
    odd = circle.shape[1] // 8
    uneven = np.std(np.sort(step, axis=1)[:, odd:-odd], axis=1)
    chosen = np.flatnonzero(
        (good.sum(axis=1) >= _MIN_SECTORS[done]) & (median >= _MIN_STEP) & (uneven < _MAX_UNEVEN[done] * median)
    )
    good, median, grey = good[chosen], median[chosen], grey[chosen]
    away, normal = np.where(good, away[chosen], 0), normal[:, chosen]
    count = good.sum(axis=1)

    # The derivatives of the distance along the normal with respect to center and axes.
    columns = [*normal, normal[0] * circle[0], normal[0] * circle[1] + normal[1] * circle[0], normal[1] * circle[1]]
    rows = np.stack(columns, axis=-1)
    weight = good.astype(float)
    for solved in range(1, _ROUNDS[done] + 1):
        weighted = (rows * weight[..., None]).swapaxes(-1, -2)
        square = weighted @ rows + 1e-9 * np.eye(5)
        move = np.linalg.solve(square, weighted @ away[..., None])
        residual = away - (rows @ move)[..., 0]
        if solved < _ROUNDS[done]:
            scale = np.median(np.where(good, np.abs(residual), 0), axis=1)
            scale = _SOFT * np.maximum(1.48 * scale, _LEAST_SCALE)
            weight = good / (1 + (residual / scale[:, None]) ** 2) ** 2
    found = np.zeros((len(chosen), COLUMNS))
    found[:, :5] = ellipses[chosen] + move[..., 0]
    found[:, LIGHT], found[:, STEP] = np.median(light[chosen], axis=1), median
    found[:, UNEVEN] = uneven[chosen] / median
    found[:, RMS] = np.sqrt((weight * residual**2).sum(axis=1) / weight.sum(axis=1))
    found[:, SLOPE] = ((grey[..., _ZERO + 1] - grey[..., _ZERO - 1]) * good).sum(axis=1) / count
    found[:, INVERSE] = np.linalg.inv(square)[:, [0, 0, 1], [0, 1, 1]]
    shorter = _least(found[:, AXES])
    longer = found[:, 2] + found[:, 4] - shorter
    fits = (shorter > _MIN_SEMI) & (longer < _MAX_ELONGATION * shorter)
    return found[fits & (found[:, RMS] < _MAX_RMS[done][0] + _MAX_RMS[done][1] * shorter)]


def _bilinear(image: Eight, x: Array, y: Array) -> Array:
    """Return grey levels at places, those beyond the image's edge as at the edge."""
    height, width = image.shape
    x, y = np.clip(x, 0, width - 1.001), np.clip(y, 0, height - 1.001)
    column, row = x.astype(np.intp), y.astype(np.intp)
    right, down = x - column, y - row
    flat, place = np.ascontiguousarray(image).reshape(-1), row * width + column
    a, b, c, d = (flat[place + shift].astype(float) for shift in (0, 1, width, width + 1))
    top = a + right * (b - a)
    return np.asarray(top + down * (c + right * (d - c) - top))


def _doubt(edges: Array) -> Array:
    """Return how unlike those of dots the edges are (k,), from 0: uneven, off the ellipse, or faint."""
    limit = _MAX_RMS[1][0] + _MAX_RMS[1][1] * _least(edges[:, AXES])
    uneven, off, faint = edges[:, UNEVEN] / _MAX_UNEVEN[1], edges[:, RMS] / limit, _MIN_STEP / edges[:, STEP]
    return np.asarray(uneven**2 + off**2 + faint**2)


def _blobs(edges: Array, scale: Array, components: Components) -> Blobs:
    """Return the blobs of edges (k, 14) of levels whose pixels have `scale` (k,) times the side of the image's."""
    a, b, c = edges[:, AXES].T
    shorter = _least(edges[:, AXES])
    longer = a + c - shorter
    slope = edges[:, SLOPE] / edges[:, STEP]
    middle = 1 - (edges[:, LIGHT] - edges[:, MIDDLE]) / edges[:, STEP]
    found = unblurred(longer, shorter, slope, middle, scale, _doubt(edges) < _CLEAR_DOUBT)
    variance = np.maximum(_MISFIT * edges[:, RMS] ** 2, _CROSSING_PX**2)
    covariance = edges[:, INVERSE] * variance[:, None] + _CENTER_PX**2 * np.array([1, 0, 1])
    light = components.low + components.unit * edges[:, LIGHT]
    return Blobs(
        center=scale[:, None] * edges[:, CENTER] + (scale[:, None] - 1) / 2,
        semi=(scale * np.maximum(found.semi, _MIN_SEMI)).T,
        angle=np.arctan2(2 * b, a - c) / 2,
        ring=found.hole > 0.5,
        covariance=(scale[:, None] ** 2 * covariance)[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        light=light,
        dark=light - components.unit * edges[:, STEP] / found.depth,
        blur=found.blur,
        middle=found.hole,
        fitted=np.zeros(len(edges), dtype=bool),
    )


def _distinct(blobs: Blobs, scale: Array) -> Indices:
    """Return the indices of blobs without one of the same place and size whose center is more certain."""
    variance = blobs.covariance[:, 0, 0] + blobs.covariance[:, 1, 1]
    if kernel.library() is not None:
        limits = _SAME_PLACE, _SAME_SIZE, _BLURRED_PX, _LARGE_PX
        return np.flatnonzero(kernel.distinct_blobs(blobs.center, blobs.semi, variance, scale, limits))
    shorter, kept = blobs.semi[:, 1], np.ones(len(blobs), dtype=bool)
    # Small ones, of which there may be many, are near few others in x. Those in between are in both groups.
    for group in (shorter < 2 * _LARGE_PX, shorter > _LARGE_PX):
        index = np.flatnonzero(group)
        index = index[np.argsort(blobs.center[index, 0], kind="stable")]
        x, y, semi, side = *blobs.center[index].T, blobs.semi[index], scale[index]
        reach = _SAME_PLACE * semi[:, 1]
        furthest = reach.max(initial=0)
        for apart in range(1, len(index)):
            gap = x[apart:] - x[:-apart]
            if gap.min() > furthest:
                break
            i = np.flatnonzero(gap < reach[:-apart])
            i = i[np.abs(y[i + apart] - y[i]) < reach[i]]
            if not len(i):
                continue
            j = i + apart
            same = _SAME_SIZE * np.maximum(semi[i, 1], semi[j, 1])
            same += _BLURRED_PX * np.where(side[i] == side[j], 0, np.maximum(side[i], side[j]))
            alike = np.abs(semi[i] - semi[j]).max(axis=1) < same
            i, j = index[i[alike]], index[j[alike]]
            kept[np.where(variance[i] <= variance[j], j, i)] = False
    return np.flatnonzero(kept)
