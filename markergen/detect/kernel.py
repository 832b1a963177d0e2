"""The compiled part of detection, which is optional: `python -m markergen.detect.kernel_build` builds it."""

import ctypes
import functools
import os
import sys
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from markergen.arrays import Array

Integers = NDArray[np.int64]
Eight = NDArray[np.uint8]

VARIABLE = "MARKERGEN_KERNEL"
"""Environment variable; `off` switches the compiled part off. Read at its first use."""

_FIELDS, _SETTINGS, _UNKNOWNS, _FACTS = 11, 46, 15, 7
_SECTORS, _LIMITS, _EDGE = 24, 24, 14
_DAMPING, _STAGES, _GATES, _GUESS = 5, 4, 7, 5
_QUARTER, _TABLE, _BLUR, _SAME = 12, 14, 4, 4
"""Lengths of rows and structures in kernel.c, kernel_fit.c and kernel_blur.c."""


def library() -> ctypes.CDLL | None:
    """Return the compiled library, or None where it is missing, outdated or switched off.

    Where it is None, callers take their twin in NumPy; tests replace this function. Calls free the global interpreter
    lock.
    """
    return _loaded()[0]


def missing() -> str | None:
    """Return None if the compiled part is there, else one line that says why not and what to do."""
    return _loaded()[1]


@functools.cache
def _loaded() -> tuple[ctypes.CDLL | None, str | None]:
    # Not imported with this package, so that it can be run as a module.
    from markergen.detect.kernel_build import LIBRARY, SOURCE, digest

    if os.environ.get(VARIABLE, "").lower() == "off":
        return None, f"detection runs without its compiled part, several times slower: {VARIABLE} is off"
    remedy = f"with a C compiler, `{os.path.basename(sys.executable)} -m markergen.detect.kernel_build` builds it"  # noqa: PTH119
    path = SOURCE.with_name(LIBRARY)
    if not path.is_file():
        return None, f"detection runs without its compiled part, several times slower; {remedy}"
    try:
        loaded = ctypes.CDLL(str(path))
        loaded.kernel_source.restype = ctypes.c_char_p
        if loaded.kernel_source() != digest().encode():
            return None, f"detection runs without its compiled part, which is of another version; {remedy}"
        _declare(loaded)
    except (OSError, AttributeError) as error:
        return None, f"detection runs without its compiled part, which cannot be loaded ({error}); {remedy}"
    return loaded, None


def _declare(loaded: ctypes.CDLL) -> None:
    whole, real, address = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
    loaded.dark_components.argtypes = [
        address, whole, whole, whole, ctypes.c_int, whole, address, whole,
    ]  # fmt: skip
    loaded.dark_components.restype = whole
    loaded.fit_dots.argtypes = [
        address, whole, whole, whole, ctypes.c_int, whole, *[address] * 4, real, real, real, *[address] * 5,
    ]  # fmt: skip
    loaded.fit_dots.restype = whole
    loaded.elliptic.argtypes = [whole, *[address] * 5]
    loaded.elliptic.restype = whole
    loaded.difference_squares.argtypes = [address, whole, whole, whole, address]
    loaded.difference_squares.restype = None
    loaded.disk_outlines.argtypes = [whole, whole, *[address] * 8]
    loaded.disk_outlines.restype = None
    loaded.refine_poses.argtypes = [whole, whole, *[address] * 7, whole, ctypes.c_double, address]
    loaded.refine_poses.restype = ctypes.c_int
    loaded.estimate_pose.argtypes = [whole, whole, *[address] * 5, whole, *[address] * 3, whole, *[address] * 4]
    loaded.estimate_pose.restype = whole
    loaded.solve_blurred.argtypes = [whole, whole, *[address] * 13]
    loaded.solve_blurred.restype = None
    loaded.distinct_blobs.argtypes = [whole, *[address] * 7]
    loaded.distinct_blobs.restype = None
    loaded.judge_poses.argtypes = [whole, whole, *[address] * 10]
    loaded.judge_poses.restype = None
    loaded.homography.argtypes = [whole, *[address] * 3]
    loaded.homography.restype = None
    loaded.guess_poses.argtypes = [*[whole] * 6, *[address] * 21]
    loaded.guess_poses.restype = whole
    loaded.follow_poses.argtypes = [*[whole] * 5, *[address] * 14]
    loaded.follow_poses.restype = ctypes.c_int
    loaded.even_edges.argtypes = [address, whole, whole, whole, address, whole, *[address] * 3]
    loaded.even_edges.restype = whole


def dark_components(image: Eight, step: int, least: int) -> Integers:
    """Return the connected components of dark pixels: see kernel.c, and the twin in components.py.

    Parameters
    ----------
    image : array (h, w)
    step : int, 0 to 255
        Least depth below the mean of the surroundings, grey levels.
    least : int
        Minimum number of pixels.

    Returns
    -------
    array (k, 11), in no particular order
    """
    loaded = library()
    assert loaded is not None
    image = _rows(image)
    height, width = image.shape
    if max(height, width) >= 1 << 30 or not 0 <= step <= 255:
        raise ValueError(f"an image of {width} x {height} px, or a step of {step}, is out of range")
    capacity = 1024 + image.size // 256
    while True:
        found = np.empty((capacity, _FIELDS), dtype=np.int64)
        count: int = loaded.dark_components(
            image.ctypes.data, height, width, image.strides[0], step, max(least, 1), at(found), capacity
        )
        if count < 0:
            raise MemoryError("no memory for rows of dark pixels")
        if count <= capacity:
            return found[:count]
        capacity = count


def fit_dots(
    image: Eight | NDArray[np.uint16],
    semi: Array,
    angle: Array,
    band: Array,
    ring: NDArray[np.bool_],
    filled: NDArray[np.bool_],
    noise: float,
    saturation: float,
    unlit: float,
    settings: Array,
    table: Array,
    unknowns: Array,
) -> tuple[Array, Array, Array]:
    """Fit dots to grey levels: see kernel_fit.c, and the twin in ellipse_descent.py.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
    semi, angle, band : arrays (B, 2), (B,), (B,)
        Rough ellipses, and half the width of the bands along their outlines, px.
    ring, filled : arrays (B,)
        True for rings, and where the inside of the outline counts as well.
    noise, saturation, unlit : float, grey levels
        Maximum noise; the level above which the image shows none, and that of the unknowns, reckoned from `unlit`.
    settings, table : arrays
        Constants in the order of kernel_fit.c, and the normal distribution and its density.
    unknowns : array (B, 15)

    Returns
    -------
    unknowns (B, 15), inverse normal matrices (B, 15, 15), and in this order (7, B): variance, noise, complete, misfit,
    uneven, odd, pairs
    """
    loaded = library()
    assert loaded is not None
    if image.dtype not in (np.uint8, np.uint16) or image.ndim != 2:
        raise ValueError(f"an image of 8 or 16 bits is needed, not {image.shape} of {image.dtype}")
    if image.strides[1] != image.itemsize or image.strides[0] < 0:
        image = image.copy()
    count, (height, width) = len(unknowns), image.shape
    inputs = shaped(semi, count, 2), shaped(angle, count), shaped(band, count)
    kinds = shaped(ring + 2 * filled, count, dtype=np.uint8)
    settings = shaped(settings, _SETTINGS)
    table = shaped(table, int(settings[-1]), 2)
    unknowns = np.array(shaped(unknowns, count, _UNKNOWNS))
    inverse, facts = np.empty((count, _UNKNOWNS, _UNKNOWNS)), np.empty((count, _FACTS))
    arrays = settings, table, unknowns, inverse, facts
    status = loaded.fit_dots(
        image.ctypes.data, height, width, image.strides[0], image.itemsize == 2, count,
        *(at(each) for each in (*inputs, kinds)), noise, saturation, unlit,
        *(at(each) for each in arrays),
    )  # fmt: skip
    if status < 0:
        raise MemoryError("no memory for the pixels of a dot")
    return unknowns, inverse, facts.T


def elliptic(found: Integers, limits: Array) -> tuple[Array, Array, Integers]:
    """Return centers, spreads and indices of components like ellipses: see kernel.c, and the twin in components.py.

    Parameters
    ----------
    found : array (k, 11)
    limits : array (6,)
    """
    loaded = library()
    assert loaded is not None
    found = np.ascontiguousarray(found)
    if found.shape != (len(found), _FIELDS) or found.dtype != np.int64 or limits.shape != (6,):
        raise ValueError(f"components of {_FIELDS} numbers and 6 limits are needed, not {found.shape}, {limits.shape}")
    index, center, spread = np.empty(len(found), np.int64), np.empty((len(found), 2)), np.empty((len(found), 2, 2))
    arrays = found, np.ascontiguousarray(limits, dtype=float), index, center, spread
    count: int = loaded.elliptic(len(found), *(at(each) for each in arrays))
    return center[:count], spread[:count], index[:count]


def difference_squares(pieces: Eight) -> Integers:
    """Return the sums of squared differences of neighbors in pieces of 32 px of rows (h, 32 m), an array (h m,)."""
    loaded = library()
    assert loaded is not None
    pieces = _rows(pieces)
    height, width = pieces.shape
    if width % 32:
        raise ValueError(f"rows of {width} px are not made of pieces of 32")
    sums = np.empty(pieces.size // 32, dtype=np.int64)
    loaded.difference_squares(pieces.ctypes.data, height, width, pieces.strides[0], at(sums))
    return sums


def disk_outlines(
    points: Array, radii: Array, rotation: Array, translation: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return centers, images of the middles, shapes and visibility of disks: see kernel.c, and `outlines`."""
    loaded = library()
    assert loaded is not None
    k, n = len(rotation), len(points)
    given = (
        shaped(points, n, 3), shaped(radii, n), shaped(rotation, k, 3, 3), shaped(translation, k, 3),
    )  # fmt: skip
    center, point, shape = np.empty((k, n, 2)), np.empty((k, n, 2)), np.empty((k, n, 2, 2))
    seen = np.empty((k, n), dtype=np.bool_)
    loaded.disk_outlines(k, n, *(at(each) for each in (*given, center, point, shape, seen)))
    return center, point, shape, seen


def refine_poses(
    points: Array,
    radii: Array,
    seen: Array,
    weight: Array,
    rotation: Array,
    translation: Array,
    steps: int,
    tolerance: float,
    damping: tuple[float, ...],
) -> tuple[Array, Array, Array]:
    """Refine k poses: see kernel.c, and the twin in conic_projection.py.

    Parameters
    ----------
    points, radii, seen, weight, rotation, translation, steps, tolerance
        As for `conic_projection.refine_poses`.
    damping : tuple
        Start, least, slack, ridge and factor of the damping.
    """
    loaded = library()
    assert loaded is not None
    k, n = len(rotation), len(points)
    fixed = shaped(points, n, 3), shaped(radii, n), shaped(seen, k, n, 2), shaped(weight, k, n, 2, 2)
    refined = [
        np.array(each, dtype=float, order="C").reshape(k, *shape)
        for each, shape in ((rotation, (3, 3)), (translation, (3,)))
    ]
    chi2 = np.empty(k)
    schedule = shaped(damping, _DAMPING)
    addresses = [at(each) for each in (*fixed, *refined, chi2)]
    if loaded.refine_poses(k, n, *addresses, steps, tolerance, at(schedule)):
        raise MemoryError("no memory for residuals")
    return refined[0], refined[1], chi2


def guess_poses(
    pairs: tuple[NDArray[np.intp], ...],
    layout: tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp]],
    blobs: tuple[Array, ...],
    strange: NDArray[np.bool_],
    settings: tuple[float, ...],
    least: int,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, Array]:
    """Return guessed poses: see kernel.c, and the twin in pose_hypotheses.py.

    Parameters
    ----------
    pairs : tuple
        First and second blobs (m,), and pairs of control points (q, 2).
    layout : tuple
        Points, radii, rings, and near dots (n, k).
    blobs : tuple
        Centers (b, 2), shapes (b, 2, 2), areas, slacks (b,), positions and normals (b, 2, 3).
    settings : tuple
        As in kernel.c.

    Returns
    -------
    start, votes (K,), quality (K,), rotation (K, 3, 3), translation (K, 3)
    """
    loaded = library()
    assert loaded is not None
    first, second, chosen = pairs
    points, radii, rings, near = layout
    center, shape, area, slack, position, normal = blobs
    m, q, b, n, close = len(first), len(chosen), len(center), len(points), near.shape[1]
    fixed = [
        indices(first, b, m),
        indices(second, b, m),
        indices(chosen, n, q, 2),
        shaped(points, n, 3),
        shaped(radii, n),
        shaped(rings, n, dtype=np.bool_),
        indices(near, n, n, close),
        shaped(center, b, 2),
        shaped(shape[:, [0, 0, 1], [0, 1, 1]], b, 3),
        shaped(area, b),
        shaped(slack, b),
        shaped(position, b, 2, 3),
        shaped(normal, b, 2, 3),
        shaped(strange, 2, b, dtype=np.bool_),
        shaped(np.argsort(center[:, 0]), b, dtype=np.int64),
        shaped(settings, _GUESS),
    ]
    sizes = m, q, b, close, least
    capacity = 1024
    while True:
        start, votes = np.empty((2, capacity), dtype=np.int64)
        quality, rotation, translation = np.empty(capacity), np.empty((capacity, 3, 3)), np.empty((capacity, 3))
        arrays = *fixed, start, votes, quality, rotation, translation
        count: int = loaded.guess_poses(*sizes, capacity, *(at(each) for each in arrays))
        if count < 0:
            raise MemoryError("no memory for pairs of dots")
        if count <= capacity:
            return start[:count], votes[:count], quality[:count], rotation[:count], translation[:count]
        capacity = count


def follow_poses(
    layout: tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp], bool],
    start: NDArray[np.intp] | None,
    labels: NDArray[np.intp] | None,
    ellipses: tuple[Array, Array, NDArray[np.bool_]],
    gates: tuple[float, ...],
    rotation: Array,
    translation: Array,
    damping: tuple[float, ...],
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Return the labelings (A, n) to which k poses lead, misfits (A,) and poses: see kernel.c.

    Parameters
    ----------
    layout : tuple
        Points (n, 3), radii (n,), rings (n,), near dots (n, m), and whether it is flat.
    start, labels : array (k,) of int, or array (k, n) of int; the other one is None
        Control point that each guess starts from; or given labelings.
    ellipses : tuple
        Centers (b, 2), shapes (b, 2, 2), and which are surely no disks, no rings (2, b).
    gates : tuple
        As in kernel.c.
    """
    loaded = library()
    assert loaded is not None
    points, radii, rings, near, flat = layout
    center, shape, strange = ellipses
    k, n, b, close = len(rotation), len(points), len(center), near.shape[1]
    found = np.full((k, _STAGES, n), -1, dtype=np.int64)
    if labels is not None:
        found[:, 0] = indices(labels, b, k, n, least=-1)
    misfit = np.full((k, _STAGES), np.nan)
    turn, shift = np.empty((k, _STAGES, 3, 3)), np.empty((k, _STAGES, 3))
    turn[:, 0], shift[:, 0] = rotation, translation
    arrays = [
        shaped(points, n, 3),
        shaped(radii, n),
        shaped(rings, n, dtype=np.bool_),
        indices(near, n, n, close),
        None if start is None else indices(start, n, k),
        shaped(center, b, 2),
        shaped(shape[:, [0, 0, 1], [0, 1, 1]], b, 3),
        shaped(strange, 2, b, dtype=np.bool_),
        shaped(gates, _GATES),
        shaped(damping, _DAMPING),
        found,
        misfit,
        turn,
        shift,
    ]
    addresses = [None if each is None else at(each) for each in arrays]
    if loaded.follow_poses(k, n, b, int(flat), close, *addresses):
        raise MemoryError("no memory for labelings")
    there = ~np.isnan(misfit)
    return found[there], misfit[there], turn[there], shift[there]


def even_edges(image: Eight, rough: Array, circle: Array, limits: Array) -> Array:
    """Return the even edges near rough outlines: see kernel.c, and the twin in candidates.py.

    Parameters
    ----------
    image : array (h, w), of at least 2 x 2 px
    rough : array (k, 5)
    circle : array (2, 24)
        Points of the unit circle.
    limits : array
        Those of the twin, in the order of kernel.c.
    """
    loaded = library()
    assert loaded is not None
    image = _rows(image)
    height, width = image.shape
    if min(height, width) < 2:
        raise ValueError(f"an image of at least 2 x 2 px is needed, not {width} x {height} px")
    k = len(rough)
    rough, circle, limits = shaped(rough, k, 5), shaped(circle, 2, _SECTORS), shaped(limits, _LIMITS)
    found = np.empty((k + 1, _EDGE))
    addresses = [at(each) for each in (circle, limits, found)]
    count = loaded.even_edges(image.ctypes.data, height, width, image.strides[0], at(rough), k, *addresses)
    return found[:count]


def solve_blurred(
    outlines: tuple[Array, Array, Array, NDArray[np.bool_], Array, Array],
    steps: int,
    quarter: Array,
    table: Array,
    settings: tuple[float, ...],
) -> tuple[Array, Array, Array, Array]:
    """Return semi-axes (2, k), blur, depth and level (k,): see kernel_blur.c, and the twin in blurred_outlines.py.

    Parameters
    ----------
    outlines : tuple of arrays (k,)
        Longer and shorter semi-axes, slope, whether it is a ring's, and limits of the blur.
    quarter, table, settings : arrays (12,), (4, 14) and (4,)
        Constants in the order of kernel_blur.c.
    """
    loaded = library()
    assert loaded is not None
    k = len(outlines[0])
    given = [shaped(each, k, dtype=np.bool_ if i == 3 else float) for i, each in enumerate(outlines)]
    constants = shaped(quarter, _QUARTER), shaped(table, 4, _TABLE), shaped(settings, _BLUR)
    solved = np.empty((5, k))
    addresses = [at(each) for each in (*given, *constants, solved, *solved[2:])]
    loaded.solve_blurred(k, steps, *addresses)
    return solved[:2], solved[2], solved[3], solved[4]


def distinct_blobs(
    center: Array, semi: Array, variance: Array, side: Array, settings: tuple[float, ...]
) -> NDArray[np.bool_]:
    """Return which blobs (k,) are kept: see kernel_blur.c, and the twin in candidates.py."""
    loaded = library()
    assert loaded is not None
    k, kept = len(center), np.empty(len(center), dtype=np.bool_)
    order = shaped(np.argsort(center[:, 0], kind="stable"), k, dtype=np.int64)
    given = shaped(center, k, 2), shaped(semi, k, 2), shaped(variance, k), shaped(side, k), shaped(settings, _SAME)
    loaded.distinct_blobs(k, *(at(each) for each in (order, *given, kept)))
    return kept


_START = ctypes.c_char * 0


def at(array: NDArray[Any]) -> Any:
    """Return an array's address for a call, in a third of the time of `array.ctypes.data`."""
    data: Any = array
    return _START.from_buffer(data) if array.flags.writeable and array.size else array.ctypes.data


def shaped(values: ArrayLike, *shape: int, dtype: DTypeLike = float) -> NDArray[Any]:
    """Return a contiguous array with this shape, or raise ValueError."""
    values = np.ascontiguousarray(values, dtype=dtype)
    return values if values.shape == shape else np.ascontiguousarray(np.broadcast_to(values, shape))


def indices(values: NDArray[np.intp], end: int, *shape: int, least: int = 0) -> Integers:
    """Return a contiguous array with this shape of indices from `least` to below `end`, or raise ValueError."""
    values = shaped(values, *shape, dtype=np.int64)
    if values.size and not (values.min() >= least and values.max() < end):
        raise ValueError(f"indices from {least} to {end - 1} are needed, not {values.min()} to {values.max()}")
    return values


def _rows(image: Eight) -> Eight:
    """Return an image whose rows are contiguous, which need not be each behind the other."""
    if image.dtype != np.uint8 or image.ndim != 2:
        raise ValueError(f"an image of 8 bits is needed, not {image.shape} of {image.dtype}")
    return image if image.strides[1] == 1 and image.strides[0] >= 0 else np.ascontiguousarray(image)
