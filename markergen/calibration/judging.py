"""Worth of a calibration by photographs that took no part in it: left-out photographs, and two halves compared.

Residuals always fall when more is estimated. What counts is whether a photograph that was left out is predicted better,
by dots and camera from the others and a pose of its own. Two ways to predict are compared photograph by photograph, by
the logarithm of the ratio of their RMS residuals, since some photographs are harder than others.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.calibration.adjustment import Adjustment, UndeterminedError, adjust
from markergen.calibration.network import LEAST_DOTS, CameraFreedom, Network, Views
from markergen.errors import InputError
from markergen.model.camera import Camera

FOLDS, ALONE = 5, 10
"""Number of parts that are left out in turn; maximum number of photographs of which each is left out alone."""

CHANCE = 0.01
"""Probability by chance alone at which two halves disagree."""

LEAST_JUDGED = 3
"""Minimum number of left-out photographs: fewer have no interval worth telling."""

LEAST_IN_HALF = 3
"""Minimum number of photographs in each of two halves."""

_FLOOR_PX, _SINGULAR = 1e-6, 1e-6
"""Least RMS residual in px of a photograph in a ratio; eigenvalue of a covariance, as correlations and as a share of
the largest, below which an error cannot vary."""


@dataclass(frozen=True)
class NotJudged:
    """Why a judgment was not possible, as a sentence."""

    reason: str


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Residuals of p photographs that were left out.

    Attributes
    ----------
    squares, chi2 : arrays (p,)
        Sum of the squared residuals in px^2, and of those weighted by the image's covariance; nan where a photograph
        could not be predicted.
    dots, degrees_of_freedom : arrays (p,) of int
        Dots that were seen, and twice their number less 6 for each fitted pose.
    """

    squares: Array
    chi2: Array
    dots: Indices
    degrees_of_freedom: Indices

    @property
    def rms_each(self) -> Array:
        """RMS (p,) over the dots of each photograph of the length of the residual, px."""
        return np.asarray(np.sqrt(self.squares / np.maximum(self.dots, 1)))

    @property
    def rms(self) -> float:
        """RMS over all dots of the length of the residual, px."""
        is_predicted = np.isfinite(self.squares)
        return float(np.sqrt(self.squares[is_predicted].sum() / max(self.dots[is_predicted].sum(), 1)))

    @property
    def suffices(self) -> bool:
        """Whether so many photographs were predicted that they have an interval worth telling."""
        return bool(np.isfinite(self.squares).sum() >= LEAST_JUDGED)

    @property
    def variance_factor(self) -> float:
        """chi2 per degree of freedom, over all photographs: 1 if dots and camera were exact."""
        is_predicted = np.isfinite(self.chi2)
        return float(self.chi2[is_predicted].sum() / max(self.degrees_of_freedom[is_predicted].sum(), 1))


@dataclass(frozen=True)
class Paired:
    """Geometric mean over photographs of the ratio of two RMS residuals.

    Attributes
    ----------
    ratio, low, high : float
        Mean, and its 95 % interval (Student's t of the logarithms).
    chance : float
        Probability of a ratio as large as this one if the true one is 1.
    """

    ratio: float
    low: float
    high: float
    chance: float
    photos: int

    @classmethod
    def of(cls, worse: LeftOut, better: LeftOut) -> "Paired":
        """Compare two predictions of the same photographs; a ratio above 1 is in favor of the second."""
        from scipy.stats import t as student

        first, second = (np.maximum(left_out.rms_each, _FLOOR_PX) for left_out in (worse, better))
        logarithm = np.log(first / second)
        logarithm = logarithm[np.isfinite(logarithm)]
        count = len(logarithm)
        if count < 2:
            return cls(float("nan"), 0.0, float("inf"), 1.0, count)
        mean, error = float(logarithm.mean()), float(logarithm.std(ddof=1) / np.sqrt(count))
        half = error * float(student.ppf(0.975, count - 1))
        chance = float(student.sf(mean / max(error, 1e-12), count - 1))
        return cls(float(np.exp(mean)), float(np.exp(mean - half)), float(np.exp(mean + half)), chance, count)


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Left-out photographs, predicted with the measured print and with the designed one.

    Attributes
    ----------
    photos : array (p,) of int
        Photographs that were left out, as numbered by the caller.
    measured : LeftOut
        Dots and camera from the other photographs.
    nominal : LeftOut
        Designed dots, the same camera.
    refitted : LeftOut or None
        Designed dots, and the camera that suits them best in the other photographs; None if the camera was held.
    gain : Paired or None
        How many times smaller the residuals are with the measured print than with the design at its best; None if the
        dots were held at the design.
    """

    photos: Indices
    measured: LeftOut
    nominal: LeftOut
    refitted: LeftOut | None
    gain: Paired | None

    @property
    def best_nominal(self) -> LeftOut:
        """Prediction by the design, with the camera that suits it if the camera was estimated."""
        return self.nominal if self.refitted is None else self.refitted

    @property
    def better(self) -> bool:
        """Whether the measured print predicts better, by more than chance (95 %)."""
        return self.gain is not None and self.gain.low > 1

    @property
    def verdict(self) -> str:
        """The comparison as a sentence."""
        gain, rms, nominal = self.gain, self.measured.rms, self.best_nominal.rms
        if gain is None:
            return f"left-out photographs are predicted to {rms:.3g} px RMS"
        numbers = f"{rms:.3g} px RMS against {nominal:.3g} px"
        interval = f"95 % interval {gain.low:.3g} to {gain.high:.3g}, {gain.photos} photographs"
        if self.better:
            factor = f"{gain.ratio:.3g} times"
            return f"the measured print predicts left-out photographs {factor} better: {numbers} ({interval})"
        if gain.high < 1:
            return f"the measured print predicts left-out photographs worse than the design: {numbers} ({interval})"
        return (
            "the measured print does not predict left-out photographs significantly better than the design: "
            f"{numbers}, but from photograph to photograph the 95 % interval of their ratio, {gain.low:.3g} to "
            f"{gain.high:.3g}, includes 1 ({gain.photos} photographs)"
        )


@dataclass(frozen=True, eq=False)
class Halves:
    """The same print measured by two halves of the photographs.

    Attributes
    ----------
    photos : (array, array) of int
        Photographs of each half.
    dots : array (m,) of int
        Dots that both halves measured.
    difference : array (m, 3), m
        Of their places, second half less first.
    chi2, degrees_of_freedom : float, int
        Of all differences together, by the claimed covariances; their expected ratio is 1.
    chance : float
        Probability of a chi2 as large if the claimed covariances are right.
    cameras : (Camera, Camera)
    camera_chi2 : float or None
        Of the difference of the estimated camera parameters, per degree of freedom; None if the camera was held.
    """

    photos: tuple[Indices, Indices]
    dots: Indices
    difference: Array
    chi2: float
    degrees_of_freedom: int
    chance: float
    cameras: tuple[Camera, Camera]
    camera_chi2: float | None

    @property
    def rms_um(self) -> float:
        """RMS over the dots of the length of the difference, um."""
        return float(1e6 * np.sqrt((self.difference**2).sum(axis=1).mean())) if len(self.dots) else 0.0

    @property
    def variance_factor(self) -> float:
        """chi2 per degree of freedom: 1 if the claimed covariances are right."""
        return self.chi2 / self.degrees_of_freedom if self.degrees_of_freedom else float("nan")

    @property
    def verdict(self) -> str:
        """The comparison as a sentence."""
        if not self.degrees_of_freedom:
            return "the dots were held, so two halves of the photographs can differ in the camera alone"
        numbers = f"they differ by {self.rms_um:.3g} um RMS, chi2 per degree of freedom {self.variance_factor:.3g}"
        if self.chance < CHANCE:
            return f"two halves of the photographs disagree by more than their claimed errors: {numbers}"
        return f"two halves of the photographs agree within their claimed errors: {numbers}"


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs of which some are left out, and the network that they determine.

    Attributes
    ----------
    network, views, weights
        As of `adjust`; weights (v, n).
    photo : array (v,) of int
        Photograph of each view.
    """

    network: Network
    views: Views
    weights: Array
    photo: Indices

    @classmethod
    def of(cls, adjustment: Adjustment, photo: Indices) -> "Photographs":
        """All photographs of an adjustment, from its camera unless the network says what is known of that."""
        return cls(adjustment.network, adjustment.views, adjustment.weights, photo).continued(adjustment.camera)

    def continued(self, camera: Camera) -> "Photographs":
        """Start from the camera as adjusted, unless the network says what is known of it."""
        is_known = self.network.freedom.precision.any()
        return self if is_known else replace(self, network=replace(self.network, camera=camera))

    def take(self, chosen: Mask) -> "Photographs":
        """Return some of the views."""
        return replace(self, views=self.views.take(chosen), weights=self.weights[chosen], photo=self.photo[chosen])

    def determined(self) -> Mask:
        """Mask (n,) of the dots that can be measured: seen in two views or more of their marker, with two others.

        All of them if the dots are held.
        """
        network, taken = self.network, self.views.seen & (self.weights > 0)
        kept = np.ones(len(network.design), dtype=bool)
        while network.free:
            usable = (taken & kept).sum(axis=1) >= LEAST_DOTS
            now = kept & ((taken & usable[:, None]).sum(axis=0) >= 2)
            for marker in np.unique(network.marker[now]):
                is_on_marker = now & (network.marker == marker)
                if is_on_marker.sum() < LEAST_DOTS:
                    now &= ~is_on_marker
            if np.array_equal(now, kept):
                break
            kept = now
        return kept

    def adjusted(self, places: Array, kept: Mask | None = None) -> tuple[Adjustment, Mask] | None:
        """Adjust the network, and tell the dots that the photographs determine; None if they do not."""
        if kept is None:
            kept = self.determined()
        if kept.sum() < LEAST_DOTS:
            return None
        reduced, views, weights = self.network.of_dots(kept), self.views.of_dots(kept), self.weights[:, kept]
        usable = ((weights > 0) & views.seen).sum(axis=1) >= LEAST_DOTS
        adjusted = _adjusted(reduced, views.take(usable), weights[usable], places[kept])
        return None if adjusted is None else (adjusted, kept)

    def left_out(self, places: Array, compared: bool = True) -> tuple[LeftOut, LeftOut, LeftOut]:
        """Predict each photograph from others: with dots and camera of these; with designed dots; and their camera.

        Parameters
        ----------
        places : array (n, 3), m
            Start for the dots.
        compared : bool
            False leaves out the second and the third.
        """
        photos, index_of_photo = np.unique(self.photo, return_inverse=True)
        sums = [_Sums(len(photos)) for _ in range(3)]
        for left in _folds(len(photos)):
            out = np.isin(index_of_photo, left)
            fitted = self.take(~out).adjusted(places)
            if fitted is None:
                continue
            part, kept = fitted
            taken = self.views.seen & (self.weights > 0) & kept
            index = np.flatnonzero(out & (taken.sum(axis=1) >= LEAST_DOTS))
            if not len(index):
                continue
            tested = self.views.take(index).of_dots(kept), self.weights[index][:, kept]
            sums[0].add(index_of_photo[index], _predicted(part, part.places, part.camera, *tested))
            if compared:
                design = part.network.design
                sums[1].add(index_of_photo[index], _predicted(part, design, part.camera, *tested))
                if len(self.network.freedom):
                    held = _adjusted(replace(part.network, free=False), part.views, part.weights)
                    if held is not None:
                        sums[2].add(index_of_photo[index], _predicted(part, design, held.camera, *tested))
        return sums[0].left_out(), sums[1].left_out(), sums[2].left_out()


def cross_validate(adjustment: Adjustment, photo: Indices) -> CrossValidation | NotJudged:
    """Predict left-out photographs, with the measured print and with the design.

    Every photograph is left out once, alone or with a fifth of all. Dots that fewer than two others show do not count.

    `photo` (v,) is the photograph of each view of the adjustment.
    """
    photographs, photos = Photographs.of(adjustment, photo), np.unique(photo)
    network = photographs.network
    measured, nominal, refitted = photographs.left_out(adjustment.places)
    if not measured.suffices:
        return NotJudged(f"{len(photos)} photographs are too few for leaving some out")
    best = refitted if len(network.freedom) else nominal
    gain = Paired.of(best, measured) if network.free else None
    return CrossValidation(photos, measured, nominal, refitted if len(network.freedom) else None, gain)


def compare_halves(adjustment: Adjustment, photo: Indices) -> Halves | NotJudged:
    """Measure the print twice, by two halves of the photographs, and compare.

    Photographs that are alike in tilt, roll and distance are paired, and one of each pair goes to each half. With the
    information N1, N2 of the halves, and P about the unknowns before the photographs, which both halves share,

        cov(x2 - x1) = C1 N1 C1 + C2 N2 C2 + (C2 - C1) P (C2 - C1),    C = (N + P)^-1 the claimed covariance.

    `photo` (v,) is the photograph of each view of the adjustment.
    """
    from scipy.stats import chi2 as chi2_distribution

    photographs, views = Photographs.of(adjustment, photo), adjustment.views
    network = photographs.network
    photos, first_view, index_of_photo = np.unique(photo, return_index=True, return_inverse=True)
    if len(photos) < 2 * LEAST_IN_HALF:
        return NotJudged(f"two halves need {2 * LEAST_IN_HALF} photographs or more, found {len(photos)}")
    second = _second_half(views.take(first_view), np.random.default_rng(0))
    sides = [photographs.take(~second[index_of_photo]), photographs.take(second[index_of_photo])]
    kept = np.logical_and.reduce([side.determined() for side in sides])
    parts = [side.adjusted(adjustment.places, kept) for side in sides]
    if parts[0] is None or parts[1] is None:
        return NotJudged("half of the photographs are too few to determine the dots")
    halves = [part[0] for part in parts if part is not None]
    size = halves[0].normal.dots
    try:
        covariances = [half.unscaled for half in halves]
    except UndeterminedError:
        return NotJudged("half of the photographs are too few to determine the dots")
    information_before = [
        replace(half, views=half.views.take(slice(0)), weights=half.weights[:0]).normal.rest for half in halves
    ]
    spread: Array = covariances[0] + covariances[1]
    if information_before[0].any():
        apart = covariances[1] - covariances[0]
        spread = apart @ information_before[0] @ apart
        for half, before, covariance in zip(halves, information_before, covariances, strict=True):
            spread += covariance @ (half.normal.reduced() - before) @ covariance
    spread = adjustment.scale * spread
    difference = halves[1].places - halves[0].places
    difference = difference[: size // 3]
    chi2, freedom = squared_length(difference.ravel(), spread[:size, :size])
    moved = parameters_of(halves[1].camera) - parameters_of(halves[0].camera)
    step: Array = np.linalg.pinv(network.freedom.directions) @ moved
    camera_chi2, free = squared_length(step, spread[size:, size:])
    return Halves(
        (photos[~second], photos[second]),
        np.flatnonzero(kept) if size else np.zeros(0, dtype=np.intp),
        difference,
        chi2,
        freedom,
        float(chi2_distribution.sf(chi2, freedom)) if freedom else 1.0,
        (halves[0].camera, halves[1].camera),
        camera_chi2 / free if free else None,
    )


class _Sums:
    """Sums of left-out residuals by photograph."""

    def __init__(self, photos: int) -> None:
        self.squares, self.chi2 = np.full(photos, np.nan), np.full(photos, np.nan)
        self.dots, self.freedom = np.zeros(photos, dtype=np.intp), np.zeros(photos, dtype=np.intp)

    def add(self, photo: Indices, adjusted: Adjustment | None) -> None:
        """Add the views of some photographs, adjusted with dots and camera held."""
        if adjusted is None:
            return
        taken, residual = adjusted.weights > 0, adjusted.residual
        squares = ((residual**2).sum(axis=-1) * taken).sum(axis=1)
        inverse = np.linalg.inv(adjusted.views.covariance)
        chi2 = np.einsum("vni,vnij,vnj,vn->v", residual, inverse, residual, adjusted.weights, optimize=True)
        for sums, values in ((self.squares, squares), (self.chi2, chi2)):
            sums[photo] = 0.0
            np.add.at(sums, photo, values)
        np.add.at(self.dots, photo, taken.sum(axis=1))
        np.add.at(self.freedom, photo, 2 * taken.sum(axis=1) - 6)

    def left_out(self) -> LeftOut:
        """Return the sums."""
        return LeftOut(self.squares, self.chi2, self.dots, self.freedom)


def _folds(photos: int) -> Iterator[Indices]:
    """Numbers of the photographs that are left out together."""
    count = photos if photos <= ALONE else FOLDS
    order = np.random.default_rng(0).permutation(photos)
    for fold in range(count):
        yield np.sort(order[fold::count])


def _adjusted(network: Network, views: Views, weights: Array, places: Array | None = None) -> Adjustment | None:
    """Adjust; None if the views do not determine the network."""
    try:
        adjusted = adjust(network, views, weights, places)
    except (UndeterminedError, InputError, np.linalg.LinAlgError):
        return None
    return adjusted if adjusted.degrees_of_freedom > 0 and np.isfinite(adjusted.chi2) else None


def _predicted(part: Adjustment, places: Array, camera: Camera, views: Views, weights: Array) -> Adjustment | None:
    """Fit the poses of left-out views, with dots and camera held."""
    held = replace(
        part.network,
        design=places,
        camera=camera,
        freedom=CameraFreedom.held(camera),
        free=False,
        lengths=(),
        prior=None,
    )
    try:
        return adjust(held, views, weights)
    except (UndeterminedError, np.linalg.LinAlgError):
        return None


def _second_half(views: Views, rng: np.random.Generator) -> Mask:
    """Mask of the photographs of the second half: one of each pair that is alike in tilt, roll and distance."""
    tilt, roll = views.rotation[:, :2, 2], views.rotation[:, :2, 0]
    features = np.concatenate([2 * tilt, roll, np.log(views.translation[:, 2:])], axis=1)
    apart = np.linalg.norm(features[:, None] - features, axis=-1)
    first, second = np.triu_indices(len(views), 1)
    single = np.ones(len(views), dtype=bool)
    chosen = np.zeros(len(views), dtype=bool)
    for k in np.argsort(apart[first, second], kind="stable"):
        pair = [first[k], second[k]]
        if single[pair].all():
            single[pair] = False
            chosen[pair[rng.integers(2)]] = True
    return chosen


def squared_length(error: Array, covariance: Array) -> tuple[float, int]:
    """Squared length of an error by its covariance, and its degrees of freedom: the directions in which it can vary."""
    if not len(error):
        return 0.0, 0
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / scale / scale[:, None])
    kept = values > _SINGULAR * values[-1]
    along = vectors[:, kept].T @ (error / scale)
    return float((along**2 / values[kept]).sum()), int(kept.sum())


def parameters_of(camera: Camera) -> Array:
    """Return the values (k,) of `Camera.parameter_names`."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion.coefficients])
