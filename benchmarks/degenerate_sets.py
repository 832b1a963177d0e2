"""Photographs that leave something open: refused, or carried with an error that is as large as claimed.

    python -m benchmarks.degenerate_sets [--sets 20] [--n 5 24]

Prints and image noise are those of `benchmarks.calibration`. Each row: sets that are refused, and what is open most
often; of the others, median over the sets of the RMS error of a dot that is claimed, the one that it has, and NEES
per degree of freedom of all dots (1 if the claimed covariance is right), mean and standard error.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.calibration import ROUGH, SIGMA, UNKNOWN, designed
from benchmarks.calibration_sets import CAMERA, SimulatedSet, hand_held, in_gauge, nees, photographed, printed
from markergen.arrays import Array
from markergen.calibration.adjustment import UndeterminedError, adjust
from markergen.calibration.network import CameraFreedom
from markergen.calibration.weaknesses import explain, findings, refusal
from markergen.maths.rotation import exponential, rotation_z

Poses = tuple[Array, Array]
Take = Callable[[np.random.Generator, Array], Poses]

FRONT = np.diag([1.0, -1.0, -1.0])
PHOTOS = 20
FREE_RATIO = (*UNKNOWN, "fy")


def good(rng: np.random.Generator, design: Array) -> Poses:
    """Photographs as they should be."""
    return hand_held(PHOTOS, rng, design)


def frontal(rng: np.random.Generator, _design: Array) -> Poses:
    """The camera looks straight at the marker, from several distances and rolls."""
    depth = rng.uniform(0.6, 1, (PHOTOS, 1))
    return FRONT @ rotation_z(rng.uniform(0, 2 * np.pi, PHOTOS)), depth * [0.0, 0.0, 1.0]


def same(rng: np.random.Generator, design: Array) -> Poses:
    """One pose."""
    rotation, translation = hand_held(1, rng, design, tilt=(30, 40))
    return np.repeat(rotation, PHOTOS, axis=0), np.repeat(translation, PHOTOS, axis=0)


def shifted(rng: np.random.Generator, design: Array) -> Poses:
    """One rotation and distance."""
    rotation, _ = hand_held(1, rng, design, tilt=(30, 40))
    aside = rng.uniform(-0.1, 0.1, (PHOTOS, 2))
    return np.repeat(rotation, PHOTOS, axis=0), np.column_stack([aside, np.full(PHOTOS, 0.8)])


def one_roll(rng: np.random.Generator, _design: Array) -> Poses:
    """All tilts, the camera always held the same way up."""
    angle, azimuth = rng.uniform(0.2, 1.0, (PHOTOS, 1)), rng.uniform(0, 2 * np.pi, PHOTOS)
    lean = exponential(angle * np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth]))
    aside = np.column_stack([rng.uniform(-0.05, 0.05, (PHOTOS, 2)), rng.uniform(0.6, 0.9, PHOTOS)])
    return lean @ FRONT, aside


def few(photos: int) -> Take:
    """Fewer photographs, as they should be."""
    return lambda rng, design: hand_held(photos, rng, design)


SETS: dict[str, tuple[Take, Sequence[tuple[str, ...]]]] = {
    "hand-held": (good, [(), UNKNOWN, FREE_RATIO]),
    "all frontal": (frontal, [(), UNKNOWN]),
    "all the same": (same, [(), UNKNOWN]),
    "only shifted": (shifted, [(), UNKNOWN]),
    "one roll": (one_roll, [(), UNKNOWN, FREE_RATIO]),
    "2 photographs": (few(2), [(), UNKNOWN]),
    "4 photographs": (few(4), [(), UNKNOWN]),
    "5 photographs": (few(5), [(), UNKNOWN]),
    "6 photographs": (few(6), [(), UNKNOWN]),
}
"""How photographs are taken, and the camera parameters that are free, by name."""

CAMERAS = {(): "camera known", UNKNOWN: "camera unknown", FREE_RATIO: "camera unknown, fx != fy"}


def judged(made: SimulatedSet, names: tuple[str, ...]) -> tuple[str, float, float, float]:
    """What is refused, or "", with the claimed and true RMS error of a dot in mm and NEES per degree of freedom."""
    freedom = CameraFreedom.of_names(ROUGH, names) if names else None
    network = made.network(freedom, ROUGH if names else CAMERA)
    try:
        adjustment = adjust(network, made.views)
        opened = findings(adjustment)
    except (UndeterminedError, np.linalg.LinAlgError):
        return explain(network, made.views)[0].what, np.nan, np.nan, np.nan
    if refusal(opened) is not None:
        return opened[0].what, np.nan, np.nan, np.nan
    true, _, _ = in_gauge(network, made.true, made.rotation, made.translation)
    error = (adjustment.places - true).ravel()
    rank = error.size - network.gauge(network.design).shape[1]
    claimed = float(np.sqrt(np.trace(adjustment.covariance) / error.size))
    return "", 1e3 * claimed, 1e3 * float(np.sqrt(np.mean(error**2))), nees(error, adjustment.covariance, rank)


def row(n: int, take: Take, names: tuple[str, ...], sets: int) -> str:
    """Outcome of some sets of one kind."""
    rng, design = np.random.default_rng(n), designed(n)
    refused: Counter[str] = Counter()
    carried = []
    for _ in range(sets):
        true = printed(design, rng)
        made = photographed(design, true, *take(rng, design), rng, SIGMA, CAMERA)
        what, *numbers = judged(made, names)
        if what:
            refused[what] += 1
        else:
            carried.append(numbers)
    text = f"{refused.total()} of {sets} refused"
    if refused:
        text += f" ({refused.most_common(1)[0][0]})"
    if carried:
        claimed, true_error, ratio = np.array(carried).T
        spread = np.std(ratio) / np.sqrt(len(ratio))
        text += f"; claimed {np.median(claimed):.3f} mm, true {np.median(true_error):.3f} mm"
        text += f", NEES {np.mean(ratio):.2f} +- {spread:.2f}"
    return text


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--n", type=int, nargs="+", default=[5, 24])
    options = parser.parse_args()
    print("dots photographs, camera: refused; error of a dot; NEES per degree of freedom")
    for n in options.n:
        for kind, (take, cameras) in SETS.items():
            for names in cameras:
                print(f"{n:3d} {kind}, {CAMERAS[names]}: {row(n, take, names, options.sets)}", flush=True)


if __name__ == "__main__":
    main()
