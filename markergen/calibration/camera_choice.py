"""Choice of the parameters of an unknown camera by left-out photographs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from markergen.arrays import Array, Indices
from markergen.calibration.adjustment import Adjustment, UndeterminedError
from markergen.calibration.judging import CHANCE, LeftOut, NotJudged, Paired, Photographs, parameters_of, squared_length
from markergen.calibration.network import CameraFreedom, Network, Views
from markergen.calibration.projection_uncertainty import pixel_grid
from markergen.model.camera import Camera, Distortion
from markergen.model.rescale import POOR_FIT

WEAKLY = 0.1
"""Standard deviation, within wide limits, of f as a share, of the principal point as a share of a third of the image's
width, and of the share by which each coefficient moves the image's corners."""

_POWER = {"p1": 1, "p2": 1, "k2": 4, "k3": 6, "k5": 4, "k6": 6}
"""Powers of the radius that coefficients go with, if not 2."""

MOST_DOTS = 120
"""Number of dots above which every second, third... is taken: they are enough for a choice, and many take long."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A set of camera parameters that was tried, and whether it took the place of the one that stood then.

    The left-out residuals are None if the photographs do not determine it; `gain` is how many times smaller they are
    than with the set that stood, None for the first.
    """

    names: tuple[str, ...]
    left_out: LeftOut | None
    gain: Paired | None
    taken: bool


@dataclass(frozen=True, eq=False)
class CameraChoice:
    """Camera parameters that left-out photographs justify, and a start for the adjustment whose lens has all of them.

    `notes` are parameters that are held although they usually are estimated, as sentences.
    """

    names: tuple[str, ...]
    camera: Camera
    freedom: CameraFreedom
    tried: tuple[Trial, ...]
    notes: tuple[str, ...]


def choose_camera(
    network: Network, views: Views, photo: Indices, weights: Array | None = None
) -> CameraChoice | NotJudged:
    """Choose the parameters of an unknown camera that left-out photographs justify.

    The search starts with f (fx alone stands for fx and fy in proportion), c, k1 and k2. Then p1 and p2, k3, and fy on
    its own join, the best one first, where left-out photographs are predicted better by more than chance; where the fit
    is poor and none does by itself, two or three at once. At last k2, k1 and c are held where they are known so poorly
    that left-out photographs are predicted better with them held, and their start is within the claimed errors.

    Parameters
    ----------
    network : Network
        Its camera is the start; the freedom of the camera is ignored.
    photo : array (v,) of int
        Photograph of each view.
    weights : array (v, n), optional
        As of `adjust`.
    """
    weights = np.ones(views.seen.shape) if weights is None else weights
    # Dots that take no part, as if they were never seen: a network of fewer.
    weights = weights * (np.arange(weights.shape[1]) % -(-weights.shape[1] // MOST_DOTS) == 0)
    camera = with_lens(network.camera)
    start, tried = Photographs(replace(network, cameras=(camera,)), views, weights, photo), list[Trial]()

    def attempted(names: tuple[str, ...], before: _Fit | None, photographs: Photographs = start) -> _Fit | None:
        """Return the fit with some parameters, if it predicts left-out photographs better than the one before."""
        fit = _Fit.of(photographs, names)
        gain = None if fit is None or before is None else Paired.of(before.left_out, fit.left_out)
        is_better = before is None or (gain is not None and gain.chance < CHANCE)
        tried.append(Trial(names, None if fit is None else fit.left_out, gain, before is None and fit is not None))
        return fit if is_better else None

    def take(fit: _Fit) -> _Fit:
        """Mark a fit as taken."""
        number = next(k for k, trial in enumerate(tried) if trial.left_out is fit.left_out)
        tried[number] = replace(tried[number], taken=True)
        return fit

    fits = (attempted(names, None) for names in dict.fromkeys(_possible(names, camera) for names in _STARTS))
    current = next((fit for fit in fits if fit is not None), None)
    if current is None:
        return NotJudged(f"{len(np.unique(photo))} photographs are too few for an unknown camera")
    missing = [name for name in _possible(_STARTS[0], camera) if name not in current.names]
    notes = [f"{' '.join(missing)} held: the photographs do not determine more"] if missing else []
    groups = [group for group in _EXTRA if _possible(group, camera) == group]
    while True:
        absent = [group for group in groups if not set(group) <= set(current.names)]
        better: list[_Fit] = []
        # What one of them leaves over can hide what it gains: a lens off center and pixels off square need both.
        for count in range(1, len(absent) + 1 if current.whole.variance_factor > POOR_FIT else 2):
            more = [(*current.names, *chain.from_iterable(several)) for several in combinations(absent, count)]
            better = [fit for names in more if (fit := attempted(names, current)) is not None]
            if better:
                break
        if not better:
            break
        current = take(min(better, key=lambda fit: fit.left_out.rms))
    if current.whole.variance_factor > POOR_FIT and camera.distortion.model == "radtan":
        bent = current.whole.camera
        lenses = [(rational(camera), (*current.names, *_LAST)), (_equidistant(bent), _FISHEYE)]
        better = []
        for lens, names in lenses:
            of_lens = replace(start, network=replace(network, cameras=(lens,)))
            fit = attempted(names, current, of_lens)
            better += [fit] if fit is not None and fit.whole.is_determined else []
        if better:
            current = take(min(better, key=lambda fit: fit.left_out.rms))
    for held in _HELD:
        before = current.photographs
        if set(held) <= set(current.names) and _within_sigma(current.whole, before.network.camera, held):
            fewer = tuple(name for name in current.names if name not in held)
            fit = attempted(fewer, current, before)
            if fit is not None and (gain := tried[-1].gain) is not None:
                notes.append(
                    f"{' '.join(held)} held: left-out photographs are predicted {gain.ratio:.3g} times better so"
                )
                current = take(fit)
    camera = current.photographs.network.camera
    return CameraChoice(
        current.names, camera, CameraFreedom.of_names(camera, current.names), tuple(tried), tuple(notes)
    )


_STARTS = (("fx", "cx", "cy", "k1", "k2"), ("fx", "cx", "cy", "k1"), ("fx", "cx", "cy"), ("fx",))
"""Sets that the search for camera parameters may start with: the first one that the photographs determine."""

_EXTRA = (("p1", "p2"), ("k3",), ("fy",))
_LAST, _FISHEYE = ("k4", "k5", "k6"), ("fx", "cx", "cy", "k1", "k2", "k3", "k4")
"""Tried where the fit is poor: the denominator of a quotient of polynomials, and a fisheye's lens, of which views of
100 degrees look like a radtan lens at first."""
_HELD = (("k2",), ("k1",), ("cx", "cy"))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Parameters of a camera, the adjustment of all photographs with them, and the residuals of left-out ones."""

    photographs: Photographs
    names: tuple[str, ...]
    whole: Adjustment
    left_out: LeftOut

    @classmethod
    def of(cls, photographs: Photographs, names: tuple[str, ...]) -> "_Fit | None":
        """Fit the parameters named; None if the photographs are too few for them."""
        freedom = CameraFreedom.of_names(photographs.network.camera, names)
        freed = replace(photographs, network=replace(photographs.network, freedom=freedom))
        adjusted = freed.adjusted(freed.network.design)
        if adjusted is None:
            return None
        whole, kept = adjusted
        freed = freed.continued(whole.cameras)
        if len(whole.views) == len(freed.views):
            moved = replace(freed.views, rotation=whole.views.rotation, translation=whole.views.translation)
            freed = replace(freed, views=moved)
        places = freed.network.design.copy()
        places[kept] = whole.places
        left_out = freed.left_out(places, compared=False)[0]
        return cls(photographs, names, whole, left_out) if left_out.suffices else None


def _possible(names: Sequence[str], camera: Camera) -> tuple[str, ...]:
    """Return those of the names that the camera's lens has."""
    return tuple(name for name in names if name in camera.parameter_names)


def wider_lenses(network: Network) -> list[tuple[str, Network]]:
    """Return networks whose cameras are free within wide limits, of larger lenses in turn, with their coefficients."""
    larger = tuple(map(with_lens, network.cameras))
    lenses = dict.fromkeys([larger, tuple(map(rational, larger))])
    networks = []
    for cameras in lenses:
        freedoms = []
        for camera in cameras:
            corner = min(1.0, float(np.hypot(camera.width, camera.height)) / (camera.fx + camera.fy))
            unit = {"fx": camera.fx, "fy": camera.fy, "cx": camera.width / 3, "cy": camera.width / 3}
            unit |= {name: corner ** -_POWER.get(name, 2) for name in camera.distortion.names}
            sigma = WEAKLY * np.array([unit[name] for name in camera.parameter_names])
            freedoms.append(CameraFreedom.of_covariance(np.diag(sigma**2)))
        names = dict.fromkeys(name for camera in cameras for name in camera.distortion.names)
        networks.append((" ".join(names), replace(network, cameras=cameras, freedom=CameraFreedom.joined(freedoms))))
    return networks


def _within_sigma(adjustment: Adjustment, start: Camera, names: Sequence[str]) -> bool:
    """Return whether parameters differ from their start by no more than their claimed errors (95 %)."""
    from scipy.special import chdtri

    chosen = [adjustment.camera.parameter_names.index(name) for name in names]
    try:
        spread = adjustment.camera_covariance[np.ix_(chosen, chosen)]
    except UndeterminedError:
        return True
    moved = (parameters_of(adjustment.camera) - parameters_of(start))[chosen]
    return squared_length(moved, spread)[0] < float(chdtri(len(names), 0.05))


def rational(camera: Camera) -> Camera:
    """Return a radtan camera with the quotient of polynomials instead of the polynomial of all five coefficients."""
    if camera.distortion.model != "radtan":
        return camera
    return replace(camera, distortion=Distortion("rational", (*camera.distortion.coefficients, 0.0, 0.0, 0.0)))


def with_lens(camera: Camera) -> Camera:
    """Return the camera with all five coefficients of radtan, if it has none or four of them."""
    coefficients = camera.distortion.coefficients
    if camera.distortion.model not in ("none", "radtan") or len(coefficients) == 5:
        return camera
    return replace(camera, distortion=Distortion("radtan", (*coefficients, *[0.0] * (5 - len(coefficients)))))


def _equidistant(camera: Camera) -> Camera:
    """Return the camera with the fisheye's lens that bends most like its own."""
    normalized = camera.from_pixels(pixel_grid(camera).reshape(-1, 2))
    normalized = normalized[np.isfinite(normalized).all(axis=1)]
    bent = np.linalg.norm((camera.to_pixels(normalized) - [camera.cx, camera.cy]) / camera.focal, axis=1)
    angle = np.arctan(np.linalg.norm(normalized, axis=1))
    powers = angle[:, None] ** np.array([3, 5, 7, 9])
    coefficients = np.linalg.lstsq(powers, bent - angle, rcond=None)[0]
    return replace(camera, distortion=Distortion("equidistant", tuple(coefficients.tolist())))
