"""Calls of single stages of the compiled core, for their tests."""

import ctypes
from ctypes import byref, c_void_p

import numpy as np
from markergen_detect.core import library
from structures import BLOB, ImageStruct


def image_struct(image, inverted=False):
    """An array (h, w) of uint8 or uint16, whose rows may be those of a larger one, as the core takes it."""
    assert image.dtype in (np.uint8, np.uint16)
    assert image.strides[1] == image.itemsize or not image.size
    struct = ImageStruct(image.ctypes.data, *image.shape, image.strides[0], image.itemsize == 2, inverted)
    struct.kept = image
    return struct


def find_blobs(image, smallest=0.0, most=10_000, inverted=False):
    actual = c_void_p()
    count = library().find_blobs(byref(image_struct(image, inverted)), smallest, most, byref(actual))
    assert count >= 0
    blobs = np.frombuffer(ctypes.string_at(actual, count * BLOB.itemsize), BLOB).copy()
    free = ctypes.CDLL(None).free
    free.argtypes = [c_void_p]
    free(actual)
    return blobs


def fit_blobs(image, blobs, which=None, inverted=False):
    which = np.arange(len(blobs)) if which is None else np.asarray(which, dtype=np.int64)
    fitted = blobs.copy()
    struct = image_struct(image, inverted)
    assert library().fit_blobs(byref(struct), None, fitted.ctypes.data, which.ctypes.data, len(which)) == 0
    return fitted


def drawn(shape, ellipses, rng=None, blur=0.7, light=200.0, dark=40.0, noise=1.0, dtype=np.uint8, fine=5):
    """Dots (n, 6), x, y, semi-axes, angle and size of the hole relative to the outline, behind a Gaussian blur of this
    standard deviation, px, in squares of pixels: sampled `fine` times as finely, with shares of samples at outlines."""
    from scipy.ndimage import gaussian_filter

    ink = np.zeros([fine * side for side in shape])
    for x, y, a, b, angle, hole in ellipses:
        rows, columns = (slice(max(int(fine * (c - a - 1)), 0), max(int(fine * (c + a + 2)), 0)) for c in (y, x))
        v, u = np.mgrid[rows, columns]
        u, v = (u + 0.5) / fine - 0.5 - x, (v + 0.5) / fine - 0.5 - y
        p, q = (u * np.cos(angle) + v * np.sin(angle)) / a, (v * np.cos(angle) - u * np.sin(angle)) / b
        rho = np.hypot(p, q) + 1e-12
        steepness = np.hypot(p / a, q / b) / rho
        disk = np.clip(0.5 + fine * (1 - rho) / steepness, 0, 1)
        disk -= np.clip(0.5 + fine * (hole - rho) / steepness, 0, 1) if hole else 0
        part = ink[rows, columns]
        part[...] = np.maximum(part, disk[: part.shape[0], : part.shape[1]])
    ink = gaussian_filter(ink, fine * blur, mode="nearest")
    ink = ink.reshape(shape[0], fine, shape[1], fine).mean(axis=(1, 3))
    grey = light - (light - dark) * ink
    if rng is not None:
        grey = grey + noise * rng.standard_normal(shape)
    return np.clip(np.rint(grey), 0, np.iinfo(dtype).max).astype(dtype)


def matched(blobs, centers, within=1.0):
    """The index of the blob at each center, -1 where there is none."""
    apart = np.linalg.norm(blobs["center"][None] - np.asarray(centers)[:, None], axis=-1)
    if not len(blobs):
        return np.full(len(apart), -1)
    return np.where(apart.min(axis=1) < within, apart.argmin(axis=1), -1)


def grid(rng, semi, shape, hole=0.0, tilt=1.5):
    """Dots of one size at random places near the nodes of a grid, half of them rings if there is a hole."""
    step = 2 * semi * tilt + 12
    x, y = np.meshgrid(*(np.arange(step / 2 + 4, side - step / 2 - 4, step) for side in shape[::-1]))
    places = np.stack([x.ravel(), y.ravel()], axis=-1)
    count = len(places)
    places += rng.uniform(-2, 2, places.shape)
    longer = rng.uniform(1, tilt, count)
    holes = hole * (np.arange(count) % 2)
    return np.column_stack([places, semi * longer, np.full(count, semi), rng.uniform(0, np.pi, count), holes])
