"""What photographs leave open, told by the claimed errors: findings, of which some refuse the calibration.

The yardstick is the design. A pose from working views errs by trace(M C) with the covariance C of dots and camera (see
`working_error`); a print that nothing measures has the standard deviation of a printed dot. A calibration whose dots
would give worse poses is refused, unless they show that the print is worse still. A direction that alone is worse than
the design is named, from the eigenvector of the covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment
from markergen.calibration.coverage import posed
from markergen.calibration.network import Network, Views
from markergen.calibration.working_error import sensitivity
from markergen.defaults import PRINT_SIGMA
from markergen.errors import InputError

FREE_M, FREE_PX = 0.1, 1000.0
"""What is taken to be known of a dot, and of the image of a dot by the camera: next to nothing."""

LOST_FOCAL, LOST_M = 0.5, 0.02
"""Relative sigma of the focal length that a guess has, and sigma of a dot in m, beyond which a figure says nothing."""

SINGLES = 3
"""Maximum number of dots that are named one by one."""

MOSTLY = 0.7
"""Share of an eigenvector's square that names it."""

_ALIKE, _FRONTAL = np.deg2rad([10, 20])
"""Angles that photographs are within if all are taken from the same direction; if that is from the front."""

_CAMERA = ("focal length against distance", "fx against fy", "principal point against tilt", "lens distortion")
_TILT = "tilt the marker or the camera by 30 to 50 deg, to all sides"
_ROLL = "turn the camera by a quarter about its axis in half of the photographs"
_REMEDIES = {
    "heights of the dots": _TILT,
    "depths of the dots": f"take photographs from other directions: {_TILT}",
    "places of the dots": f"take more photographs: {_TILT}",
    "scale of the print": "measure a longer length with --measured, or measure it better",
    "focal length against distance": _TILT,
    "principal point against tilt": f"{_TILT}, and {_ROLL}",
    "fx against fy": _ROLL,
    "lens distortion": "bring the marker to the edges and corners of the image, and fill the image with it",
}


@dataclass(frozen=True)
class Weakness:
    """Something that the photographs leave open, such as "heights of the dots" or "dot 3".

    In sentences how far it is open and what helps; `refuses` if the calibration would be worse than the design.
    """

    what: str
    sentence: str
    remedy: str
    refuses: bool

    def __str__(self) -> str:
        return f"{self.sentence}: {self.remedy}"


def findings(
    adjustment: Adjustment,
    print_sigma: float = PRINT_SIGMA,
    poses: tuple[Array, Array] | None = None,
    names: Sequence[str] | None = None,
) -> tuple[Weakness, ...]:
    """Return what the photographs of a calibration leave open, the worst first; of cameras, the first one's.

    Parameters
    ----------
    print_sigma : float, m
        Standard deviation of a printed dot along x and y, with which the design is used; of 0, the usual one.
    poses : arrays (P, 3, 3) and (P, 3), m, optional
        Working views; all tilts up to 60 deg at the distance of the photographs, if not given.
    names : sequence of str, optional
        Names of the dots, "dot 0", "dot 1" and so on if not given.
    """
    network, print_sigma = adjustment.network, print_sigma or PRINT_SIGMA
    names = [f"dot {k}" for k in range(len(network.design))] if names is None else names
    if adjustment.degrees_of_freedom <= 0:
        return (_too_few(adjustment),)
    try:
        covariance = adjustment.scale * bounded_covariance(adjustment)
    except np.linalg.LinAlgError:
        return (Weakness("poses", "a photograph does not determine its pose", "leave it out, or show more dots", True),)
    size, n = adjustment.normal.dots, len(network.design)
    matrix, design = _worth(adjustment, print_sigma, poses)
    measured = float(np.trace(matrix[:size, :size] @ covariance[:size, :size]))
    # A design that the photographs themselves show to err more than the measured dots is no better.
    moved = (adjustment.places - network.design).ravel()[:size]
    worse = measured > design
    refused = worse and float(moved @ matrix[:size, :size] @ moved) < 2 * measured
    units = _units(adjustment)
    values, vectors = np.linalg.eigh(covariance / units / units[:, None])
    patterns = (vectors * np.sqrt(np.maximum(values, 0.0))).T[::-1] * units
    # What the direction costs: where the dots are refused, by the dots alone.
    size_that_counts = size if worse else len(units)
    costs = np.einsum(
        "kp,pq,kq->k",
        patterns[:, :size_that_counts],
        matrix[:size_that_counts, :size_that_counts],
        patterns[:, :size_that_counts],
        optimize=True,
    )
    squares = (patterns[:, :size].reshape(len(patterns), -1, 3) ** 2).sum(axis=2) if size else np.zeros((len(units), n))
    chosen = (costs > design) | (squares.max(axis=1) > print_sigma**2)
    if worse and not chosen.any():
        chosen[int(np.argmax(costs))] = True
    ratio = _ratio(adjustment)
    sigma_ratio = float(np.sqrt(max(float(ratio @ covariance[size:, size:] @ ratio), 0.0)))
    sigma_ratio *= sigma_ratio > 1e-9
    opened: dict[str, tuple[float, Array]] = {}
    square: Array
    for k in np.flatnonzero(chosen).tolist():
        name = _name(adjustment, patterns[k], units, names, sigma_ratio)
        cost, square = opened.get(name, (0.0, np.zeros(n)))
        opened[name] = cost + float(costs[k]), square + squares[k]
    rest = np.sqrt(squares[~chosen].sum(axis=0))
    for k in np.flatnonzero(rest > np.sqrt(3) * print_sigma).tolist():
        opened.setdefault(names[k], (0.0, np.where(np.arange(n) == k, rest**2, 0.0)))
    single = [name for name in opened if name in names]
    if len(single) > SINGLES:
        cost = sum(opened[name][0] for name in single)
        square = np.asarray([opened.pop(name)[1] for name in single]).sum(axis=0)
        opened[f"{', '.join(single[:SINGLES])} and {len(single) - SINGLES} more"] = (cost, square)
    weaknesses = []
    for name, (cost, square) in sorted(opened.items(), key=lambda opening: -opening[1][0]):
        sentence, guessed = _extent(adjustment, name, covariance, float(np.sqrt(square.max())), np.sqrt(cost / design))
        remedy = _REMEDIES.get(name, f"take photographs that show {name}, from several sides")
        weaknesses.append(Weakness(name, sentence, remedy, refused or guessed))
    if worse:
        times = f"{_short(np.sqrt(measured / design))} times as much as by a print with errors of"
        lost = f"poses by the measured dots would err {times} {_short(1e3 * print_sigma)} mm"
        weaknesses[0] = replace(weaknesses[0], sentence=f"{weaknesses[0].sentence}, and {lost}")
    return tuple(weaknesses)


def explain(network: Network, views: Views, names: Sequence[str] | None = None) -> tuple[Weakness, ...]:
    """Return what photographs leave open that do not determine a network, judged at the start of its adjustment.

    At least one finding, and all of them refuse.
    """
    names = [f"dot {k}" for k in range(len(network.design))] if names is None else names
    often = views.seen.sum(axis=0) >= (2 if network.free else 0)
    rare = rarely_seen(views.seen.sum(axis=0), names) if network.free else ()
    names = [name for name, kept in zip(names, often, strict=True) if kept]
    network, views = network.of_dots(often), views.of_dots(often)
    views = views.take(views.seen.sum(axis=1) >= 3)
    if not len(views):
        sentence = "no photograph shows three dots or more" + " that another one shows, too" * network.free
        return (Weakness("poses", sentence, "show the whole marker", True),)
    seen = views.seen.astype(float)
    unknown = len(network.freedom) + (3 * len(network.design) - network.gauge(network.design).shape[1]) * network.free
    freedom = (
        2 * int(views.seen.sum()) - 6 * len(views) - unknown + int(np.linalg.matrix_rank(network.freedom.precision))
    )
    residual = np.zeros(views.pixels.shape)
    start = Adjustment(network, views, network.design, network.cameras, seen, residual, float(max(freedom, 0)), freedom)
    weaknesses = (*rare, *findings(start, names=names))
    if not weaknesses:
        sentence = "no geometry of the marker explains all photographs"
        weaknesses = (
            Weakness("agreement", sentence, "check that all show the same marker, taken with the same camera", True),
        )
    return tuple(replace(weakness, refuses=True) for weakness in weaknesses)


def refusal(weaknesses: Sequence[Weakness], cause: str = "") -> InputError | None:
    """Return the error for findings of which one or more refuse the calibration, with its cause; None if none does."""
    bad = [weakness for weakness in weaknesses if weakness.refuses]
    if not bad:
        return None
    what = bad[0].what if bad[0].what.startswith("dot ") else f"the {bad[0].what}"
    return InputError(
        f"photographs that determine {what}",
        f"that {bad[0].sentence}{cause and f', most likely because {cause}'}",
        bad[0].remedy,
    )


def rarely_seen(views: NDArray[np.intp], names: Sequence[str]) -> tuple[Weakness, ...]:
    """Return a finding for dots seen in fewer than two views (n,), which stay where they were designed."""
    rare = [name for name, count in zip(names, views, strict=True) if count < 2]
    if not rare:
        return ()
    listed = ", ".join(rare[:5]) + (f" and {len(rare) - 5} more" if len(rare) > 5 else "")
    sentence = f"{listed} {'is' if len(rare) == 1 else 'are'} in fewer than two photographs, and not measured"
    return (Weakness(listed, sentence, "take photographs that show the whole marker", False),)


def _too_few(adjustment: Adjustment) -> Weakness:
    """Finding about a set with no more measurements than unknowns."""
    network, views = adjustment.network, adjustment.views
    measured_per_view = 2 * adjustment.weights.astype(bool).sum() / len(views) - 6
    missing = 1 - adjustment.degrees_of_freedom
    dots, camera = len(network.design), " with an unknown camera" if len(network.freedom) else ""
    count = f"{len(views)} photograph{'s' * (len(views) != 1)}"
    sentence = (
        f"{count} of {dots} dots{camera} {'have' if len(views) != 1 else 'has'} no more measurements than unknowns"
    )
    remedy = (
        f"take {int(np.ceil(missing / measured_per_view))} more at least"
        if measured_per_view > 0
        else "use a marker with more dots"
    )
    return Weakness("dots and the camera" if camera else "dots", sentence, remedy, True)


def bounded_covariance(adjustment: Adjustment, dot: float = FREE_M, pixels: float = FREE_PX) -> Array:
    """Covariance (3 n + r, 3 n + r) of dots and u, unscaled, finite even where nothing is known.

    Before the photographs, a dot is taken to be known to `dot` in m, and the camera to `pixels` in a dot's image.
    """
    reduced, size, network = adjustment.normal.reduced(), adjustment.normal.dots, adjustment.network
    loose = np.concatenate([np.full(size, dot), pixels * _units(adjustment)[size:]])
    scaled = reduced * loose * loose[:, None] + np.eye(len(loose))
    if not size:
        return np.asarray(np.linalg.inv(scaled) * loose * loose[:, None], dtype=float)
    gauge, moved = network.gauge(network.design), network.gauge(adjustment.places)
    weight = float(np.trace(scaled[:size, :size])) / size
    scaled[:size, :size] += weight * gauge @ gauge.T
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    inverse = np.asarray((vectors / np.maximum(values, 1.0)) @ vectors.T)
    projected = moved @ np.linalg.inv(gauge.T @ moved)
    inverse[:size, :size] -= projected @ projected.T / weight
    return inverse * loose * loose[:, None]


def _units(adjustment: Adjustment) -> Array:
    """Changes (3 n + r,) of dots, m, and of u that move the images of the dots by 1 px RMS."""
    parts, views = adjustment.normal, adjustment.views
    meters_per_px = float(np.median(views.translation[:, 2])) / adjustment.camera.fx
    taken = adjustment.weights > 0
    moved = np.sqrt((parts.rows_camera[taken] ** 2).sum(axis=1).mean(axis=0))
    return np.concatenate([np.full(parts.dots, meters_per_px), 1 / np.maximum(moved, 1e-12)])


def _worth(adjustment: Adjustment, print_sigma: float, poses: tuple[Array, Array] | None) -> tuple[Array, float]:
    """M (3 n + r, 3 n + r) of the mean square rotation error of working views in rad^2, and that of the design."""
    network, views = adjustment.network, adjustment.views
    size, r = adjustment.normal.dots, len(network.freedom)
    matrix, design = np.zeros((size + r,) * 2), 0.0
    noise = float(np.sqrt(adjustment.image_variance))
    markers = np.unique(network.marker)
    for marker in markers:
        dots = np.flatnonzero(network.marker == marker)
        points = network.design[dots]
        rotation, translation = _working(views, points) if poses is None else poses
        flat = np.broadcast_to(np.diag([print_sigma**2, print_sigma**2, 0.0]), (len(dots), 3, 3))
        # The camera in the middle of its own estimate: its derivatives are all that counts.
        working = sensitivity(points, adjustment.camera, rotation, translation, noise, flat)
        turns = working.matrices[0] / len(markers)
        design += float(np.diag(turns)[: working.dots] @ np.tile([print_sigma**2, print_sigma**2, 0.0], len(dots)))
        columns = (3 * dots[:, None] + np.arange(3)).ravel()[: working.dots if size else 0]
        lift = np.zeros((turns.shape[0], size + r))
        lift[np.arange(len(columns)), columns] = 1
        lift[working.dots :, size:] = network.freedom.directions[network.parameters(0)]
        matrix += lift.T @ turns @ lift
    return matrix, design


def _working(views: Views, points: Array) -> tuple[Array, Array]:
    """Views from all sides, tilted by 0 to 60 deg, at the median distance of the photographs."""
    tilt, toward = (grid.ravel() for grid in np.meshgrid([10.0, 35.0, 60.0], 45.0 * np.arange(8)))
    rotation = posed(tilt, toward, np.zeros_like(tilt))
    distance = np.array([0, 0, float(np.median(views.translation[:, 2]))])
    return rotation, distance - rotation @ points.mean(axis=0)


def _ratio(adjustment: Adjustment) -> Array:
    """Relative change (r,) of fy/fx with u."""
    camera = adjustment.camera
    rows = adjustment.network.freedom.directions[:2] / np.array([[camera.fx], [camera.fy]])
    return np.asarray(rows[1] - rows[0])


def _name(adjustment: Adjustment, pattern: Array, units: Array, names: Sequence[str], sigma_ratio: float) -> str:
    """Name what moves in an eigenvector; the dots' stretch goes by the ratio fy/fx if that moves with it."""
    size = adjustment.normal.dots
    ratio = _ratio(adjustment)
    if abs(ratio @ pattern[size:]) > MOSTLY * sigma_ratio > 0:
        return "fx against fy"
    parts = (pattern / units) ** 2
    total = max(float(parts.sum()), 1e-300)
    if parts[size:].sum() > (1 - MOSTLY) * total:
        return _camera_name(adjustment, pattern[size:])
    dots = pattern[:size].reshape(-1, 3)
    share = (dots**2).sum(axis=1)
    if share.max() > MOSTLY * share.sum():
        return names[int(np.argmax(share))]
    grown, network = 0.0, adjustment.network
    for marker in np.unique(network.marker):
        is_on_marker = network.marker == marker
        centered = adjustment.places[is_on_marker] - adjustment.places[is_on_marker].mean(axis=0)
        grown += float((dots[is_on_marker] * centered).sum()) ** 2 / max(float((centered**2).sum()), 1e-300)
    if grown > MOSTLY * share.sum():
        return "scale of the print"
    if (dots[:, 2] ** 2).sum() > MOSTLY * share.sum():
        return "heights of the dots"
    views = adjustment.views
    sight = np.einsum("vij,vi->vj", views.rotation, views.translation)
    mean = (sight / np.linalg.norm(sight, axis=1, keepdims=True)).mean(axis=0)
    if np.linalg.norm(mean) < np.cos(_ALIKE):
        return "places of the dots"
    return "heights of the dots" if abs(mean[2]) > np.cos(_FRONTAL) else "depths of the dots"


def _camera_name(adjustment: Adjustment, moved: Array) -> str:
    """Name the parameters of the camera that move, each group weighed by its motion of the image."""
    camera = adjustment.camera
    network = adjustment.network
    step = network.freedom.directions[network.parameters(0)] @ moved
    seen = adjustment.views.pixels[(adjustment.weights > 0) & (adjustment.views.camera == 0)[:, None]]
    jacobian = camera.parameter_jacobian(camera.from_pixels(seen))
    fx, fy = step[:2]
    whole = (fx / camera.fx + fy / camera.fy) / 2 * np.array([camera.fx, camera.fy])
    steps = np.zeros((4, len(step)))
    steps[0, :2], steps[1, :2], steps[2, 2:4], steps[3, 4:] = whole, step[:2] - whole, step[2:4], step[4:]
    motion = np.nansum((jacobian @ steps.T) ** 2, axis=(0, 1))
    return _CAMERA[int(np.argmax(motion))]


def _extent(adjustment: Adjustment, name: str, covariance: Array, length: float, times: float) -> tuple[str, bool]:
    """Say how far something is open, and whether a guess is as good."""
    size, camera = adjustment.normal.dots, adjustment.camera
    network = adjustment.network
    directions = network.freedom.directions[network.parameters(0)]
    sigma = np.sqrt(np.maximum(np.diag(directions @ covariance[size:, size:] @ directions.T), 0))
    if name not in _CAMERA:
        several = name.endswith(("dots", "more"))
        extent = f"known to {_short(1e3 * length)} mm only" if length < LOST_M else "open"
        return f"{'the ' * name.endswith('dots')}{name} {'are' if several else 'is'} {extent}", False
    worse = f"which alone turns poses by {_short(times)} times as much as the errors of a print"
    if name == "lens distortion":
        return f"{name} is open, {worse}", False
    if name == "principal point against tilt":
        return f"{name} is known to {_short(float(np.hypot(*sigma[2:4])))} px only, {worse}", False
    share = float(sigma[0]) / camera.fx
    if name == "fx against fy":
        ratio = _ratio(adjustment)
        share = float(np.sqrt(ratio @ covariance[size:, size:] @ ratio))
    extent = f"known to {_short(100 * share)} % only" if share < LOST_FOCAL else "open"
    return f"{name} is {extent}, {worse}", share >= LOST_FOCAL


def _short(number: float) -> str:
    """Two digits."""
    return f"{number:.2g}" if number < 99 else f"{number:.0f}"
