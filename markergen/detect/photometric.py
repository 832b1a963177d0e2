"""Photometric refinement: the dots as the pose predicts them, aligned with the grey levels of the image itself.

What is aligned is each dot by itself, not the pose: a dot's shape, tilt and curvature come from the pose, its place in
the marker's plane is free. A pose aligned with all pixels at once takes the dots to be exactly where the marker says;
every error of the print then becomes an error of the pose that no covariance knows of, and for a perfect print it
gains next to nothing: over the paper's poses the rotation would be 1 to 2 % better, as what the dots' shapes tell of it
is little beside what their places do. Places measured
one by one carry the image's errors alone, and the pose that follows from them weighs these against the print's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.detect.blobs import Image
from markergen.detect.detection import Detection
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
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.dlt import estimate_homography
from markergen.maths.projection import apply_homography, plane_homography
from markergen.model.camera import Camera
from markergen.model.marker import Marker

Array = NDArray[np.float64]

REFINEMENTS = ("none", "photometric")
"""What may follow a detection."""


def check_refinement(name: str) -> None:
    """Refuse the name of a refinement that there is not."""
    if name not in REFINEMENTS:
        raise InputError(f"a refinement: {' or '.join(REFINEMENTS)}", repr(name), "choose one of these")


def refine(
    image: Image,
    marker: Marker,
    camera: Camera | None,
    detection: Detection,
    errors: ErrorSources = DEFAULT_ERRORS,
) -> Detection:
    """Measure the dots of a detection again, by the grey levels of the image around their predicted outlines.

    Parameters
    ----------
    image : array (h, w) of uint8 or uint16
        The one that the detection comes from.
    camera : Camera or None
        Without one the detection's homography takes the place of the pose.

    Returns
    -------
    Detection
        With new `pixels` and `covariance`, and with homography and pose estimated from these. A dot that the image
        shows otherwise than predicted, such as one half hidden, keeps what it had, and so does a detection that found
        nothing.

    Raises
    ------
    InputError
        If there is neither pose nor homography (a marker with relief and no camera), or the image has another size
        than the camera's.
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
    # A camera whose normalized coordinates are pixels stands for the one that is not known.
    lens = camera or Camera(width, height, 1, 1, 0, 0)
    position = {point.id: i for i, point in enumerate(marker.control_points)}
    chosen = np.array([position[int(i)] for i in detection.ids])
    aligned = align_dots(image, lens, _predicted(marker, chosen, lens, detection))
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
    """The chosen dots as the detection's pose, or else its homography, puts them."""
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


Mask = NDArray[np.bool_]

_LEAST_PIXELS = 3 * UNKNOWNS

_ITERATIONS, _LOOSE = 12, 2
"""Most iterations, and how many come before the sharp look at outliers, which needs the model to fit."""
_CONVERGED_PX = 1e-3
"""A step below this ends the iteration; the next would be under 1e-4 px."""

_DAMPING = 1e-3
"""Marquardt's lambda: blur, size and contrast of a dot of a few pixels are hardly told apart."""

_LOOSE_OUTLIER = 0.5
"""Share of the contrast by which pixels may be off at the beginning."""
_OUTLIER_FLAT, _OUTLIER_EDGE, _OUTLIER_NOISE, _OUTLIER_BLUR = 0.05, 0.3, 6.0, 3.0
"""Pixels belong to something else if they are off by more than the first share of the contrast, and so many times the
noise, where the model is flat; by more than the second share on an edge, where the point spread need not be Gaussian
and a lower limit would cut a dot's own pixels on one side; or if they are within so many times the blur of such."""

_LEAST_SHARE = 0.9
"""A dot is no good if outliers have taken more of its information than the rest."""

_MAX_MISFIT, _MAX_NOISE = 0.06, 1.5
"""Largest RMS residual: this share of the contrast, for what the model misses, plus so many times the noise."""

_MAX_MOVE_PX = 1.0
"""The start is the center of a fitted ellipse; a dot that moves farther is not the one that was found."""

_USUAL_BLUR, _BLUR_MARGIN = 0.75, 1.3
"""Blur in px that the pixels are first gathered for, and by how much it may be more."""

_LEAST_BLUR, _MOST_BLUR = 0.25, 6.0
_MOST_SPREAD, _MOST_SLOPE = 0.3, 0.2
"""Bounds of the unknowns: px, radii, and the light's change over a dot's half-width."""

_NARROW = 1.7
"""A disk or hole whose least half-width is less than so many times the blur has no edges that the model describes."""

_FLAT = 0.01
"""Where the edge's profile is below this the model is flat and residuals are noise alone."""

_ROUNDING = 1 / 12
"""Variance that whole grey levels leave at least."""

_SHARP = 0.5
"""An edge of less blur, in px, is sampled too coarsely for what the model misses to cancel: it acts as noise."""

_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Alignment:
    """Places of m dots in the image.

    Attributes
    ----------
    pixels : array (m, 2), px of the image as taken
    covariance : array (m, 2, 2), px^2
        From the noise of the image.
    good : array (m,) of bool
        False where the image disagrees with the model; such rows are nan.
    """

    pixels: Array
    covariance: Array
    good: Mask


def align_dots(image: Grey, camera: Camera, dots: Sequence[PredictedDot]) -> Alignment:
    """Least-squares fit of the model `grey_levels` to the pixels around each dot.

    The covariance is the inverse of the normal matrix times the variance of the noise. This is read off the residuals
    where the model is flat, light and dark: those at the edge also hold what the model misses of the point spread,
    which is no noise and, being even about the center, does not move it.

    Parameters
    ----------
    image : array (h, w)
    camera : Camera
        Takes normalized coordinates to pixels of this image.
    dots : one or more
    """
    to_image = np.array([dot.image(camera, dot.start)[1] for dot in dots])
    top = float(np.iinfo(image.dtype).max)
    blur = np.full(len(dots), _USUAL_BLUR)
    while True:
        pixels = surroundings(image, camera, dots, blur)
        state, good = _fit(pixels, _first(dots, pixels, blur), to_image, top)
        # A band for less blur than there is tells neither the levels nor the noise.
        wide = blur < _blur_range(state)[1] / _BLUR_MARGIN
        if not (wide & good).any():
            break
        blur = np.where(wide, 2 * blur, blur)

    residual, jacobian, edge, seen = _compare(state, pixels, top)
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
    """Fitted state (m, 10), and for which dots (m,) there is one."""
    good = np.ones(len(state), dtype=bool)
    for iteration in range(_ITERATIONS):
        residual, jacobian, edge, seen = _compare(state, pixels, top)
        if iteration < _LOOSE:
            # A slope would be laid through what is not the dot's.
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
    """Residual (N,), jacobian (10, N) and edge (N,), and whether the level is below that of saturation (N,)."""
    model, jacobian, edge = grey_levels(state, pixels)
    seen = model < top
    ground = (edge < _FLAT) & (model > 0.5 * (state[:, LIGHT] + state[:, DARK])[pixels.dot])
    for part in pixels.parts:
        # Where nearly all the ground is saturated, edges alone would have to tell the slope of the light from a shift.
        if np.count_nonzero(ground[part] & seen[part]) < 0.5 * np.count_nonzero(ground[part]):
            jacobian[SLOPE, part] = 0
    return pixels.grey - np.minimum(model, top), jacobian, edge, seen


def _blur_range(state: Array) -> tuple[Array, Array]:
    """Least and largest standard deviation (m,) of the blur along any direction, px."""
    s11, s12, s22 = state[:, BLUR].T
    mean, half = 0.5 * (s11 + s22), np.hypot(0.5 * (s11 - s22), s12)
    return np.sqrt(mean - half), np.sqrt(mean + half)


def _first(dots: Sequence[PredictedDot], pixels: Surroundings, blur: Array) -> Array:
    """State (m, 10) to begin with."""
    state = np.zeros((len(dots), UNKNOWNS))
    state[:, PLACE] = [dot.start for dot in dots]
    state[:, BLUR] = blur[:, None] ** 2 * [1, 0, 1]
    for i, part in enumerate(pixels.parts):
        if part.stop > part.start:
            state[i, [DARK, LIGHT]] = np.percentile(pixels.grey[part], [5, 90])
    return state


def _own(state: Array, residual: Array, edge: Array, pixels: Surroundings) -> Mask:
    """Mask (N,) of the pixels that belong to their dot: neither outliers nor so near to one that they are blurred."""
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
    """Standard deviation of the residuals of a typical dot, taken from their median: a disturbed dot does not count."""
    medians = [np.median(np.abs(residual[part])) for part in parts if part.stop > part.start]
    return float(np.median(medians)) / 0.6745 if medians else 0.0


def _steps(jacobian: Array, residual: Array, kept: Mask, parts: list[slice]) -> tuple[Array, Mask]:
    """Damped Gauss-Newton steps (m, 10), and which dots (m,) have one; what no pixel tells of stays as it is."""
    normal = np.array([_normal(jacobian, kept, part) for part in parts])
    gradient = np.array([jacobian[:, part] @ (residual[part] * kept[part]) for part in parts])
    enough = np.array([np.count_nonzero(kept[part]) >= _LEAST_PIXELS for part in parts])
    enough &= np.isfinite(normal).all(axis=(1, 2))
    normal[~enough], gradient[~enough] = np.eye(UNKNOWNS), 0
    np.einsum("mii->mi", normal)[:] *= 1 + _DAMPING  # a view of the diagonals
    return np.linalg.solve(normal, gradient[..., None])[..., 0], enough


def _normal(jacobian: Array, kept: Mask, part: slice) -> Array:
    """Normal matrix (10, 10) of one dot, with a 1 on the diagonal for what no pixel tells of."""
    used = jacobian[:, part] * kept[part]
    normal = used @ used.T
    silent = np.flatnonzero(np.diagonal(normal) == 0)
    normal[silent, silent] = 1
    return normal


def _bounded(state: Array) -> Array:
    """The state (m, 10) with blur, spread and slope within what can be."""
    blur = state[:, BLUR][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(blur)
    blur = vectors * np.clip(values, _LEAST_BLUR**2, _MOST_BLUR**2)[:, None] @ vectors.swapaxes(-1, -2)
    state[:, BLUR] = blur.reshape(-1, 4)[:, [0, 1, 3]]
    state[:, SPREAD] = np.clip(state[:, SPREAD], -_MOST_SPREAD, _MOST_SPREAD)
    state[:, SLOPE] = np.clip(state[:, SLOPE], -_MOST_SLOPE, _MOST_SLOPE)
    return state


def _credible(state: Array, residual: Array, edge: Array, kept: Mask, parts: list[slice]) -> Mask:
    """Tell (m,) whether the image shows the dots as the model has them."""
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
    """Variance of the grey noise at the edges of the dots, from residuals where the model is flat.

    The variance of shot noise grows linearly with the level: in the middle of an edge it is the mean of that in the
    light and that in the dark.
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
