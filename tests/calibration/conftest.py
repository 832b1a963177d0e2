"""Calibrations of simulated photographs, with false dots, unused photographs, and names from nobody we trust."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import CAMERA, hand_held, printed
from markergen.calibration import calibration, camera_choice
from markergen.calibration.calibration import Calibration
from markergen.calibration.network import Views
from markergen.calibration.photos import PhotographedDots
from markergen.maths.conics import outlines
from markergen.model.camera import Distortion
from markergen.model.marker import Marker

HOSTILE = "<script>alert(1)</script>.jpg"
SIGMA = 0.03


def photographed(markers: list[Marker], photos: int, seed: int = 0, false: int = 3) -> PhotographedDots:
    """Return what photographs of printed markers show: in the first `false` a dot is 3 px off; the last is unused."""
    rng = np.random.default_rng(seed)
    counts = [len(marker) for marker in markers]
    total, parts, rows = sum(counts), [], []
    for k, marker in enumerate(markers):
        rotation, translation = hand_held(photos, rng, marker.xyz)
        place, before = printed(marker.xyz, rng), sum(counts[:k])
        radii = np.array([point.feature.diameter / 2 for point in marker.control_points])
        ours = slice(before, before + len(marker))
        pixels, seen = np.ones((photos, total, 2)), np.zeros((photos, total), dtype=bool)
        drawn = outlines(place, radii, rotation, translation)
        pixels[:, ours] = CAMERA.dot_centers(drawn.center, drawn.shape)
        pixels[:, ours] += rng.normal(0, SIGMA, pixels[:, ours].shape)
        seen[:, ours] = True
        pixels[range(false), before + 1] += [3.0, -1.0]
        spread = np.broadcast_to(SIGMA**2 * np.eye(2), (photos, total, 2, 2))
        parts.append(Views(pixels, spread, seen, rotation, translation))
        rows += [k] * photos
    views = Views(*(np.concatenate([getattr(part, name) for part in parts]) for name in Views.__dataclass_fields__))
    names = (HOSTILE, *(f"photos/{k}.jpg" for k in range(1, photos)), "photos/" + 60 * "x" + "-dark.jpg")
    photo = np.tile(np.arange(photos), len(markers))
    return PhotographedDots(
        names, (CAMERA.width, CAMERA.height), views, photo, np.array(rows), {photos: "no marker found"}
    )


@pytest.fixture(scope="module")
def calibrated() -> Callable[..., Calibration]:
    """Calibrate from simulated photographs instead of real ones, of prints of the markers or of others `made`."""

    def calibrated(
        markers: list[Marker], photos: int, reference: calibration.Known, made: list[Marker] | None = None, **drawn: int
    ) -> Calibration:
        start = replace(CAMERA, fx=780.0, fy=780.0, distortion=Distortion("radtan", (0.0,) * 5))
        sightings = photographed(made or markers, photos, **drawn)
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(calibration, "find_dots", lambda *_, **__: (sightings, reference.camera or start))
            return calibration.calibrate_bodies(markers, None, reference)

    return calibrated


@pytest.fixture(scope="module")
def both(calibrated, make_ngon) -> Calibration:
    """Print and camera unknown."""
    return calibrated([make_ngon(9, 0.11, 0.02)], 12, calibration.Known())


@pytest.fixture(scope="module")
def two_markers(calibrated, make_ngon) -> Calibration:
    """Two markers, a camera taken as exact, too few photographs for halves, and every dot where it was seen."""
    return calibrated([make_ngon(5, 0.1, 0.02), make_ngon(6, 0.11, 0.02)], 4, calibration.Known(CAMERA), false=0)


@pytest.fixture(scope="module")
def nominal(calibrated, make_ngon) -> Calibration:
    """Camera alone, the print taken as designed."""
    with pytest.MonkeyPatch.context() as patched:
        # The print is not as designed, for which all parameters of the camera would be tried together.
        patched.setattr(camera_choice, "POOR_FIT", np.inf)
        return calibrated([make_ngon(9, 0.11, 0.02)], 6, calibration.Known(free=False), false=0)
