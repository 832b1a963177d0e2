"""Worth of a calibration by photographs that took no part in it: left-out photographs, and two halves compared.

Residuals always fall when more is estimated. What counts is whether a photograph that was left out is predicted better,
by dots and camera from the others and a pose of its own. Two ways to predict are compared photograph by photograph, by
the logarithm of the ratio of their RMS residuals, since some photographs are harder than others.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.calibration.adjustment import Adjustment, UndeterminedError, attempt
from markergen.calibration.network import LEAST_DOTS, Network, Views
from markergen.model.camera import Camera

FOLDS, ALONE = 5, 10
"""Number of parts that are left out in turn; maximum number of photographs of which each is left out alone."""

CHANCE = 0.01
"""Probability by chance alone below which two halves disagree, or a camera parameter joins or is held."""

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

    Sums (p,) of the squared residuals in px^2, and of those weighted by the image's covariance, nan where a photograph
    could not be predicted; dots that were seen, and twice their number less 6 for each fitted pose.
    """

    squares: Array
    chi2: Array
    dots: Indices
    degrees_of_freedom: Indices

    @classmethod
    def none(cls, photos: int) -> "LeftOut":
        """Return residuals of photographs that could not be predicted, to be filled in."""
        sums, counts = np.full((2, photos), np.nan), np.zeros((2, photos), dtype=np.intp)
        return cls(*sums, *counts)

    def add(self, photo: Indices, adjusted: Adjustment | None) -> None:
        """Fill in views of the photographs `photo` (v,), adjusted with dots and camera held."""
        if adjusted is None:
            return
        taken, residual = adjusted.weights > 0, adjusted.residual
        inverse = np.linalg.inv(adjusted.views.covariance)
        chi2 = np.einsum("vni,vnij,vnj,vn->v", residual, inverse, residual, adjusted.weights, optimize=True)
        self.squares[photo], self.chi2[photo] = 0.0, 0.0
        np.add.at(self.squares, photo, ((residual**2).sum(axis=-1) * taken).sum(axis=1))
        np.add.at(self.chi2, photo, chi2)
        np.add.at(self.dots, photo, taken.sum(axis=1))
        np.add.at(self.degrees_of_freedom, photo, 2 * taken.sum(axis=1) - 6)

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
    """Geometric mean over photographs of the ratio of two RMS residuals, with its 95 % interval.

    The interval is Student's of the logarithms; `chance` is the probability of a ratio as large if the true one is 1.
    """

    ratio: float
    low: float
    high: float
    chance: float
    photos: int

    @classmethod
    def of(cls, worse: LeftOut, better: LeftOut) -> "Paired":
        """Compare two predictions of the same photographs; a ratio above 1 is in favor of the second."""
        from scipy.special import stdtr, stdtrit

        first, second = (np.maximum(left_out.rms_each, _FLOOR_PX) for left_out in (worse, better))
        logarithm = np.log(first / second)
        logarithm = logarithm[np.isfinite(logarithm)]
        count = len(logarithm)
        if count < 2:
            return cls(float("nan"), 0.0, float("inf"), 1.0, count)
        mean, error = float(logarithm.mean()), float(logarithm.std(ddof=1) / np.sqrt(count))
        half = error * float(stdtrit(count - 1, 0.975))
        chance = float(stdtr(count - 1, -mean / max(error, 1e-12)))
        return cls(float(np.exp(mean)), float(np.exp(mean - half)), float(np.exp(mean + half)), chance, count)


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Left-out photographs (p,), predicted with the measured print and with the designed one.

    With dots and camera from the other photographs, with the designed dots and the same camera, and with these and the
    camera that suits them best, None if it was held. `gain` is how many times smaller the residuals are with the
    measured print than with the design at its best; None if the dots were held at the design.
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
    """The same print measured by two halves of the photographs: dots (m,) of both, and the difference (m, 3) in m.

    chi2 and degrees of freedom are those of all differences, second half less first, by the claimed covariances;
    `chance` is the probability of a chi2 as large if these are right. `cameras` are those of each half, `camera_chi2`
    is that of their estimated parameters per degree of freedom, None if they were held.
    """

    photos: tuple[Indices, Indices]
    dots: Indices
    difference: Array
    chi2: float
    degrees_of_freedom: int
    chance: float
    cameras: tuple[tuple[Camera, ...], tuple[Camera, ...]]
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
    """Photographs of which some are left out, the network that they determine, and the photograph (v,) of each view."""

    network: Network
    views: Views
    weights: Array
    photo: Indices

    @classmethod
    def of(cls, adjustment: Adjustment, photo: Indices) -> "Photographs":
        """All photographs of an adjustment, from its camera unless the network says what is known of that."""
        return cls(adjustment.network, adjustment.views, adjustment.weights, photo).continued(adjustment.cameras)

    def continued(self, cameras: tuple[Camera, ...]) -> "Photographs":
        """Start from the cameras as adjusted, unless the network says what is known of them."""
        is_known = self.network.freedom.precision.any()
        return self if is_known else replace(self, network=replace(self.network, cameras=cameras))

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
        adjusted = attempt(reduced, views.take(usable), weights[usable], places[kept])
        if adjusted is None or adjusted.degrees_of_freedom <= 0 or not np.isfinite(adjusted.chi2):
            return None
        return adjusted, kept

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
        sums = tuple(LeftOut.none(len(photos)) for _ in range(3))
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
            network, design = part.network, part.network.design
            predictions = [network.held(part.places, part.cameras)]
            if compared:
                predictions.append(network.held(design, part.cameras))
            if compared and len(network.freedom):
                held = attempt(replace(network, free=False), part.views, part.weights)
                predictions += [network.held(design, held.cameras)] if held and held.degrees_of_freedom > 0 else []
            for left_out, prediction in zip(sums, predictions, strict=False):
                tested = self.views.take(index).of_dots(kept), self.weights[index][:, kept]
                left_out.add(index_of_photo[index], attempt(prediction, *tested))
        return sums[0], sums[1], sums[2]


def cross_validate(adjustment: Adjustment, photo: Indices) -> CrossValidation | NotJudged:
    """Predict left-out photographs, with the measured print and with the design.

    Every photograph is left out once, alone or with a fifth of all. Dots that fewer than two others show do not count.

    `photo` (v,) is the photograph of each view of the adjustment.
    """
    photographs, photos = Photographs.of(adjustment, photo), np.unique(photo)
    network = photographs.network
    measured, nominal, refitted = photographs.left_out(adjustment.places)
    if not measured.suffices:
        counted = "one photograph is" if len(photos) == 1 else f"{len(photos)} photographs are"
        return NotJudged(f"{counted} too few for leaving some out")
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
    from scipy.special import chdtrc

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
    moved = np.subtract(*(np.concatenate([*map(parameters_of, half.cameras)]) for half in halves[::-1]))
    step: Array = np.linalg.pinv(network.freedom.directions) @ moved
    camera_chi2, free = squared_length(step, spread[size:, size:])
    return Halves(
        (photos[~second], photos[second]),
        np.flatnonzero(kept) if size else np.zeros(0, dtype=np.intp),
        difference,
        chi2,
        freedom,
        float(chdtrc(freedom, chi2)) if freedom else 1.0,
        (halves[0].cameras, halves[1].cameras),
        camera_chi2 / free if free else None,
    )


def _folds(photos: int) -> Iterator[Indices]:
    """Numbers of the photographs that are left out together."""
    count = photos if photos <= ALONE else FOLDS
    order = np.random.default_rng(0).permutation(photos)
    for fold in range(count):
        yield np.sort(order[fold::count])


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
