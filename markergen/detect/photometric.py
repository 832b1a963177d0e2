"""Photometric refinement: the dots as the pose predicts them, aligned with the grey levels of the image itself.

Each dot is aligned separately, not the pose: a dot's shape, tilt and curvature come from the pose, while its place in
the marker's plane is free. Aligning a pose with all pixels at once would assume that the dots are exactly where the
marker specifies; every error of the print would become an error of the pose that no covariance includes. Even for a
perfect print the gain would be next to nothing: over the paper's poses the rotation would be 1 to 2 % better, since the
dots' shapes carry little information on it compared to their places. Places measured one by one carry only the image's
errors, and the pose estimated from them weighs these against the print's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.detect.blobs import Image, as_dark
from markergen.detect.plane_model import (
    BLUR,
    DARK,
    LIGHT,
    PLACE,
    SLOPE,
    SPREAD,
    UNKNOWNS,
    Grey,
    PredictedDot,
    Surroundings,
    grey_levels,
    surroundings,
)
from markergen.detect.pose import DEFAULT_ERRORS, estimate_pose
from markergen.detect.results import Detection
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.dlt import estimate_homography
from markergen.maths.projection import apply_homography, plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker

REFINEMENTS = ("none", "photometric")
"""Refinements that may follow a detection."""


def check_refinement(name: str) -> None:
    """Refuse an unknown refinement; raises InputError."""
    if name not in REFINEMENTS:
        raise InputError(f"a refinement: {' or '.join(REFINEMENTS)}", repr(name), "choose one of these")


def refine(
    image: Image,
    marker: Marker,
    camera: Camera | None,
    detection: Detection,
    errors: ErrorSources = DEFAULT_ERRORS,
) -> Detection:
    """Measure the dots of a detection again, from the grey levels of the image around their predicted outlines.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
        The image that the detection comes from.
    camera : Camera or None
        Without one, the detection's homography replaces the pose.

    Returns
    -------
    Detection
        The detection with new `pixels` and `covariance`, and with homography and pose estimated from them. A dot that
        looks different than predicted, such as one half hidden, keeps its values, and so does a detection that found
        nothing.

    Raises
    ------
    InputError
        If there is neither pose nor homography (a marker with relief and no camera), or the image is not of the
        camera's size.
    """
    if not detection.found:
        return detection
    height, width = image.shape
    if camera is not None and (width, height) != (camera.width, camera.height):
        raise InputError(
            f"an image of {camera.width}x{camera.height} px, the camera's size",
            f"{width}x{height} px",
            "give the camera that took the image",
        )
    # Without a known camera, use one whose normalized coordinates are pixels.
    lens = camera or Camera(width, height, 1, 1, 0, 0)
    position = {point.id: i for i, point in enumerate(marker.control_points)}
    chosen = np.array([position[int(i)] for i in detection.ids])
    dots = _predicted(marker, chosen, lens, detection)
    aligned = align_dots(as_dark(image, marker.light), lens, dots, inverted=marker.light)
    good = aligned.good
    pixels = np.where(good[:, None], aligned.pixels, detection.pixels)
    covariance = np.where(good[:, None, None], aligned.covariance, detection.covariance)
    points = marker.xyz[chosen]
    homography, pose = detection.homography, detection.pose
    if homography is not None:
        ideal = lens.ideal.to_pixels(lens.from_pixels(pixels))
        mapped: Array = np.asarray(estimate_homography(points[:, :2], ideal), dtype=float)
        # Four points with three on a line have a pose, but no homography of their own.
        homography = mapped if np.isfinite(mapped).all() else homography
    if camera is not None:
        pose = estimate_pose(points, pixels, covariance, camera, errors.of(marker, chosen)) or pose
    return replace(detection, pixels=pixels, covariance=covariance, homography=homography, pose=pose)


def _predicted(marker: Marker, chosen: NDArray[np.intp], lens: Camera, detection: Detection) -> list[PredictedDot]:
    """Return the chosen dots as predicted by the detection's pose, or else its homography."""
    xyz = marker.xyz
    if detection.pose is not None:
        rotation = np.broadcast_to(detection.pose.rotation, (len(xyz), 3, 3))
        shift = detection.pose.translation + xyz[:, 2:] * detection.pose.rotation[:, 2]
        homography = np.asarray(plane_homography(rotation, shift, np.eye(3)), dtype=float)
    elif detection.homography is not None:
        homography = np.linalg.inv(lens.matrix) @ np.broadcast_to(detection.homography, (len(xyz), 3, 3))
    else:
        raise InputError("a camera for a marker with relief", "none", "give the camera that took the image")
    features = [point.feature for point in marker.control_points]
    radius = np.array([feature.diameter / 2 for feature in features])
    inner = np.array([feature.inner_diameter / 2 for feature in features])
    to_plane = np.zeros((len(xyz), 3, 3))
    to_plane[:, 0, 0] = to_plane[:, 1, 1] = radius
    to_plane[:, :2, 2], to_plane[:, 2, 2] = xyz[:, :2], 1
    planes = homography @ to_plane
    seen = lens.from_pixels(detection.pixels)
    dots = []
    for i, place in zip(chosen, seen, strict=True):
        inverse = np.linalg.inv(planes[i])
        others = np.delete(planes[:, :, 2], i, axis=0) @ inverse.T
        neighbors = np.column_stack([others[:, :2] / others[:, 2:], np.delete(radius, i) / radius[i]])
        dots.append(PredictedDot(planes[i], apply_homography(inverse, place[None])[0], inner[i] / radius[i], neighbors))
    return dots


_LEAST_PIXELS = 3 * UNKNOWNS

_ITERATIONS, _LOOSE = 12, 2
"""Maximum number of iterations, and the number before strict outlier rejection, which needs the model to fit."""
_CONVERGED_PX = 1e-3
"""Step in px below which the iteration ends; the next would be under 1e-4 px."""

_DAMPING = 1e-3
"""Marquardt's lambda: blur, size and contrast of a dot of a few pixels are nearly degenerate."""

_LOOSE_OUTLIER = 0.5
"""Maximum error of pixels in the first iterations, as a share of the contrast."""
_OUTLIER_FLAT, _OUTLIER_EDGE, _OUTLIER_NOISE, _OUTLIER_BLUR = 0.05, 0.3, 6.0, 3.0
"""Pixels belong to something else if they are off by more than the first share of the contrast, and this multiple of
the noise, where the model is flat; by more than the second share on an edge, where the point spread need not be
Gaussian and a lower limit would cut a dot's own pixels on one side; or if they are within this multiple of the blur of
such pixels."""

_LEAST_SHARE = 0.9
"""Minimum share of a dot's information that must remain after outlier rejection."""

_MAX_MISFIT, _MAX_NOISE = 0.06, 1.5
"""Maximum RMS residual: a share of the contrast, for errors of the model, plus a multiple of the noise."""

_MAX_MOVE_PX = 1.0
"""Maximum move from the start, the center of a fitted ellipse; a dot that moves farther is not the one detected."""

_USUAL_BLUR, _BLUR_MARGIN = 0.75, 1.3
"""Blur in px for which pixels are first gathered, and the factor by which it may be exceeded."""

_LEAST_BLUR, _MOST_BLUR = 0.25, 6.0
_MOST_SPREAD, _MOST_SLOPE = 0.3, 0.2
"""Limits of the unknowns: px, radii, and the light's change over a dot's half-width."""

_NARROW = 1.7
"""Minimum half-width of a disk or hole in blurs: narrower ones have no edges that the model describes."""

_FLAT = 0.01
"""Limit of the edge's profile below which the model is flat and residuals are pure noise."""

_ROUNDING = 1 / 12
"""Variance of rounding to whole grey levels, a lower limit."""

_SHARP = 0.5
"""Blur in px below which an edge is sampled too coarsely for model errors to cancel: they act as noise."""

_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Alignment:
    """Measured places of m dots in the image.

    Attributes
    ----------
    pixels : array (m, 2), px of the image as taken
    covariance : array (m, 2, 2), px^2
        Covariance from the noise of the image.
    good : array (m,) of bool
        False where the image contradicts the model; such rows are nan.
    """

    pixels: Array
    covariance: Array
    good: Mask


def align_dots(image: Grey, camera: Camera, dots: Sequence[PredictedDot], inverted: bool = False) -> Alignment:
    """Fit the model `grey_levels` to the pixels around each dot by least squares.

    The covariance is the inverse of the normal matrix times the variance of the noise. The noise is estimated from
    residuals where the model is flat, light and dark: those at the edge also contain errors of the modeled point
    spread, which are not noise and, being even about the center, do not move it.

    Parameters
    ----------
    image : array (h, w)
    camera : Camera
        Maps normalized coordinates to pixels of this image.
    inverted : bool
        True for light dots in an inverted image: places without light have its highest grey level.
    """
    to_image = np.array([dot.image(camera, dot.start)[1] for dot in dots])
    top = float(np.iinfo(image.dtype).max)
    unlit = top if inverted else 0.0
    blur = np.full(len(dots), _USUAL_BLUR)
    while True:
        pixels = surroundings(image, camera, dots, blur, unlit)
        state, good = _fit(pixels, _first(dots, pixels, blur), to_image, top - unlit)
        # A band for too small a blur contains neither the true levels nor the noise.
        wide = blur < _blur_range(state)[1] / _BLUR_MARGIN
        if not (wide & good).any():
            break
        blur = np.where(wide, 2 * blur, blur)

    residual, jacobian, edge, seen = _compare(state, pixels, top - unlit)
    kept = seen & _own(state, residual, edge, pixels)
    shift = state[:, PLACE] - [dot.start for dot in dots]
    good &= np.linalg.norm((to_image @ shift[:, :, None])[..., 0], axis=-1) < _MAX_MOVE_PX
    narrowest = np.linalg.svd(to_image, compute_uv=False)[:, 1] * [dot.hole or 1 for dot in dots]
    good &= narrowest > _NARROW * _blur_range(state)[1]
    good &= _credible(state, residual, edge, kept, pixels.parts)
    variance = _noise(state, residual, edge, kept & good[pixels.dot], pixels)
    centers, covariance = np.full((len(dots), 2), np.nan), np.full((len(dots), 2, 2), np.nan)
    for i in np.flatnonzero(good).tolist():
        centers[i], derivative = dots[i].image(camera, state[i, PLACE])
        normal = _normal(jacobian, kept, pixels.parts[i])
        # Never quite singular, whatever the pixels.
        place = np.linalg.inv(normal + 1e-9 * np.diag(np.diag(normal)))[PLACE, PLACE]
        covariance[i] = variance * derivative @ place @ derivative.T
    return Alignment(centers, covariance, good)


def _fit(pixels: Surroundings, state: Array, to_image: Array, top: float) -> tuple[Array, Mask]:
    """Return the fitted state (m, 10), and for which dots (m,) the fit succeeded."""
    good = np.ones(len(state), dtype=bool)
    for iteration in range(_ITERATIONS):
        residual, jacobian, edge, seen = _compare(state, pixels, top)
        if iteration < _LOOSE:
            # A slope would be fitted to foreign pixels.
            jacobian[SLOPE] = 0
            kept = seen & (np.abs(residual) < _LOOSE_OUTLIER * (state[:, LIGHT] - state[:, DARK])[pixels.dot])
        else:
            kept = seen & _own(state, residual, edge, pixels)
        step, solved = _steps(jacobian, residual, kept, pixels.parts)
        good &= solved
        state[good] = _bounded(state[good] + step[good])
        moved = np.linalg.norm((to_image @ step[:, PLACE, None])[good, :, 0], axis=-1)
        if iteration >= _LOOSE and moved.max(initial=0) < _CONVERGED_PX:
            break
    return state, good


def _compare(state: Array, pixels: Surroundings, top: float) -> tuple[Array, Array, Array, Mask]:
    """Return residual (N,), Jacobian (10, N) and edge (N,), and whether the level is below saturation (N,)."""
    model, jacobian, edge = grey_levels(state, pixels)
    seen = model < top
    ground = (edge < _FLAT) & (model > 0.5 * (state[:, LIGHT] + state[:, DARK])[pixels.dot])
    for part in pixels.parts:
        # If nearly all the ground is saturated, only edges would distinguish the light's slope from a shift.
        if np.count_nonzero(ground[part] & seen[part]) < 0.5 * np.count_nonzero(ground[part]):
            jacobian[SLOPE, part] = 0
    return pixels.grey - np.minimum(model, top), jacobian, edge, seen


def _blur_range(state: Array) -> tuple[Array, Array]:
    """Return the least and largest standard deviation (m,) of the blur along any direction, px."""
    s11, s12, s22 = state[:, BLUR].T
    mean, half = 0.5 * (s11 + s22), np.hypot(0.5 * (s11 - s22), s12)
    return np.sqrt(mean - half), np.sqrt(mean + half)


def _first(dots: Sequence[PredictedDot], pixels: Surroundings, blur: Array) -> Array:
    """Return the initial state (m, 10)."""
    state = np.zeros((len(dots), UNKNOWNS))
    state[:, PLACE] = [dot.start for dot in dots]
    state[:, BLUR] = blur[:, None] ** 2 * [1, 0, 1]
    for i, part in enumerate(pixels.parts):
        if part.stop > part.start:
            state[i, [DARK, LIGHT]] = np.percentile(pixels.grey[part], [5, 90])
    return state


def _own(state: Array, residual: Array, edge: Array, pixels: Surroundings) -> Mask:
    """Return a mask (N,) of the dots' own pixels: neither outliers nor within the blur of one."""
    from scipy.spatial import KDTree

    contrast = state[:, LIGHT] - state[:, DARK]
    widest = _OUTLIER_EDGE * contrast
    narrowest = np.clip(_OUTLIER_NOISE * _typical(residual, pixels.parts), _OUTLIER_FLAT * contrast, widest)
    limit = narrowest[pixels.dot] + (widest - narrowest)[pixels.dot] * np.sqrt(edge)
    own = np.abs(residual) < limit
    reach = _OUTLIER_BLUR * _blur_range(state)[1]
    for i, part in enumerate(pixels.parts):
        outliers = ~own[part]
        if outliers.any():
            where = pixels.pixel[:, part].T
            own[part] = np.isinf(KDTree(where[outliers]).query(where, distance_upper_bound=reach[i])[0])
    return own


def _typical(residual: Array, parts: list[slice]) -> float:
    """Return the standard deviation of a typical dot's residuals, by their median: disturbed dots do not count."""
    medians = [np.median(np.abs(residual[part])) for part in parts if part.stop > part.start]
    return float(np.median(medians)) / 0.6745 if medians else 0.0


def _steps(jacobian: Array, residual: Array, kept: Mask, parts: list[slice]) -> tuple[Array, Mask]:
    """Return damped Gauss-Newton steps (m, 10), and which dots (m,) have one; undetermined unknowns stay unchanged."""
    normal = np.array([_normal(jacobian, kept, part) for part in parts])
    gradient = np.array([jacobian[:, part] @ (residual[part] * kept[part]) for part in parts])
    enough = np.array([np.count_nonzero(kept[part]) >= _LEAST_PIXELS for part in parts])
    enough &= np.isfinite(normal).all(axis=(1, 2))
    normal[~enough], gradient[~enough] = np.eye(UNKNOWNS), 0
    np.einsum("mii->mi", normal)[:] *= 1 + _DAMPING  # a view of the diagonals
    return np.linalg.solve(normal, gradient[..., None])[..., 0], enough


def _normal(jacobian: Array, kept: Mask, part: slice) -> Array:
    """Return the normal matrix (10, 10) of one dot, with a 1 on the diagonal for undetermined unknowns."""
    used = jacobian[:, part] * kept[part]
    normal = used @ used.T
    silent = np.flatnonzero(np.diagonal(normal) == 0)
    normal[silent, silent] = 1
    return normal


def _bounded(state: Array) -> Array:
    """Clip the state (m, 10) to plausible blur, spread and slope."""
    blur = state[:, BLUR][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(blur)
    blur = vectors * np.clip(values, _LEAST_BLUR**2, _MOST_BLUR**2)[:, None] @ vectors.swapaxes(-1, -2)
    state[:, BLUR] = blur.reshape(-1, 4)[:, [0, 1, 3]]
    state[:, SPREAD] = np.clip(state[:, SPREAD], -_MOST_SPREAD, _MOST_SPREAD)
    state[:, SLOPE] = np.clip(state[:, SLOPE], -_MOST_SLOPE, _MOST_SLOPE)
    return state


def _credible(state: Array, residual: Array, edge: Array, kept: Mask, parts: list[slice]) -> Mask:
    """Return whether (m,) the image shows the dots as modeled."""
    contrast = state[:, LIGHT] - state[:, DARK]
    credible = contrast > 0
    noise = _typical(residual, parts)
    for i in np.flatnonzero(credible):
        part = parts[i]
        bounded = np.clip(residual[part], -0.5 * contrast[i], 0.5 * contrast[i])
        weight = edge[part] ** 2
        share = weight @ kept[part] / max(weight.sum(), _TINY)
        misfit = np.sqrt(np.mean(bounded**2))
        credible[i] = share >= _LEAST_SHARE and misfit < _MAX_MISFIT * contrast[i] + _MAX_NOISE * noise
    return credible


def _noise(state: Array, residual: Array, edge: Array, kept: Mask, pixels: Surroundings) -> float:
    """Return the variance of the grey noise at the edges of the dots, from residuals where the model is flat.

    The variance of shot noise grows linearly with the level: in the middle of an edge it is the mean of the variances
    in the light and in the dark.
    """
    middle = 0.5 * (state[:, LIGHT] + state[:, DARK])[pixels.dot]
    flat = kept & (edge < _FLAT)
    sides = [residual[flat & side] for side in (pixels.grey > middle, pixels.grey <= middle)]
    variances = [side @ side / (side.size - 3) for side in sides if side.size >= _LEAST_PIXELS]
    variance = float(np.mean(variances)) if variances else 0.0
    if not variances or np.median(_blur_range(state)[0][pixels.dot[kept]]) < _SHARP:
        weight = edge[kept] ** 2
        variance = max(variance, float(weight @ residual[kept] ** 2 / max(weight.sum(), _TINY)))
    return max(variance, _ROUNDING)
