"""What many tests start from: the paper's setting, and the regular pentagon that `design` makes of it."""

import gc
import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from markergen.bounds.confusion import perspective
from markergen.model.boundary import Boundary, Circle, Polygon, area_without, polygon_from
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import paper
from markergen.model.substrate import Substrate
from markergen.objectives import Setting
from markergen.objectives.criteria import regular_polygon
from markergen.optimize import certificate
from markergen.validation import expectation

# What is to land is judged by the same examples every time; people at work get fresh ones.
# How long it takes to draw one says how busy the machine is.
settings.register_profile("ci", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("work", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("ci" if os.environ.get("CI") else "work")

# Shells start what runs in the background with Ctrl-C ignored, and programs that tests interrupt would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


# Modules and thousands of cases stay to the end: garbage is not looked for among them.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


QUICKLY = (
    "api/", "cli/", "contracts/", "model/", "read/", "studio/",
    "optimize/test_d", "optimize/test_e", "optimize/test_g", "optimize/test_p", "optimize/test_r", "optimize/test_t",
)  # fmt: skip
"""Tests of designs that are about other things than their labels, lower bounds and sampled errors."""


@pytest.fixture(scope="module", autouse=True)
def designed_quickly(request: pytest.FixtureRequest) -> Iterator[None]:
    """Rivals of labels are sought in few poses, bounds by few linear programs, and errors expected from few draws.

    That is most of the time of a small design and of its validation. Bounds are valid after each of the programs.
    """
    with pytest.MonkeyPatch.context() as patch:
        if f"{request.path.parent.name}/{request.path.stem}".startswith(QUICKLY):
            patch.setattr(perspective, "REPRESENTATIVE", 2)
            patch.setattr(perspective, "FITS", 1)
            patch.setattr(certificate, "ROUNDS", 2)
            patch.setattr(expectation, "MOST_DRAWS", expectation.LEAST_DRAWS)
        yield


@pytest.fixture(scope="session")
def setting() -> Setting:
    """The paper's disk, camera and 400 poses."""
    boundary = Circle(0.15)
    return Setting(boundary, PAPER_CAMERA, paper().seen_whole(boundary, PAPER_CAMERA))


def build_marker(points: np.ndarray, radius: float, diameter: float) -> Marker:
    """Marker with dots at points (n, 2) in m, the first one a ring; clearance a tenth of the diameter."""
    return Marker(
        tuple(
            ControlPoint(i, float(x), float(y), 0.0, key_ring(diameter) if i == 0 and diameter else Feature(diameter))
            for i, (x, y) in enumerate(points)
        ),
        Circle(radius),
        diameter / 10,
        provenance={"spec_hash": "1a2b3c4d"},
    )


def build_ngon(n: int, radius: float, diameter: float) -> Marker:
    """Regular n-gon, as far out as dots and clearance allow."""
    return build_marker(regular_polygon(n, radius - 0.6 * diameter), radius, diameter)


def build_in(
    boundary: Boundary, n: int, diameter: float, keep_outs: tuple[Boundary, ...] = (), seed: int = 0
) -> Marker:
    """Dots spread over a boundary: each as far from the others as one of 500 random places is."""
    places = area_without(boundary, keep_outs).sample(500, 0.6 * diameter, np.random.default_rng(seed))
    points = places[:1]
    while len(points) < n:
        gaps = np.linalg.norm(places[:, None] - points, axis=-1).min(axis=1)
        assert gaps.max() > 1.1 * diameter
        points = np.concatenate([points, places[[np.argmax(gaps)]]])
    return replace(build_marker(points, 1.0, diameter), boundary=boundary, keep_outs=keep_outs)


def _ring(count: int, radius: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    return regular_polygon(count, radius) + [x, y]


def _rectangle(width: float, height: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2] + [x, y]


def _star() -> np.ndarray:
    angle = np.pi / 2 + np.pi * np.arange(10) / 5
    radius = np.where(np.arange(10) % 2, 0.06, 0.15)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


SHAPES = {
    "rectangle": [_rectangle(0.2, 0.1)],
    "L": [np.array([[0, 0], [0.2, 0], [0.2, 0.08], [0.08, 0.08], [0.08, 0.2], [0, 0.2]])],
    # As fine as outlines from drawings are: 5 um off the circle.
    "annulus": [_ring(272, 0.15), _ring(192, 0.075)],
    "star": [_star()],
    "two squares": [_rectangle(0.1, 0.1, -0.08), _rectangle(0.1, 0.1, 0.08)],
    "plate": [_rectangle(0.2, 0.2), *(_ring(64, 0.008, x, y) for x in (-0.07, 0.07) for y in (-0.07, 0.07))],
}
"""Outlines in m of the shapes that everything about boundaries is tried on, in frames of their own."""


@pytest.fixture(scope="session")
def shapes() -> dict[str, Polygon]:
    """Boundaries by name: a rectangle 2:1, an L, an annulus, a star, two squares, a plate with four holes."""
    return {name: polygon_from(outlines) for name, outlines in SHAPES.items()}


@pytest.fixture(scope="session", params=SHAPES)
def shape(request: pytest.FixtureRequest, shapes: dict[str, Polygon]) -> Polygon:
    """Each of the six boundaries in turn."""
    return shapes[request.param]


@pytest.fixture(scope="session")
def on_wider_plate() -> Callable[[Marker], Marker]:
    """Give a plate that is 2 mm wider all around a marker that is as large as its plate, for a sheet to lie in it."""

    def on_wider_plate(marker: Marker) -> Marker:
        if marker.boundary.has_measures:
            return marker
        rings = marker.boundary.region.offset(0.002, "miter").oriented().rings
        return replace(marker, substrate=Substrate(outline=polygon_from(rings, "file")))

    return on_wider_plate


@pytest.fixture(scope="session")
def make_in() -> Callable[..., Marker]:
    return build_in


@pytest.fixture(scope="session")
def make_marker() -> Callable[..., Marker]:
    return build_marker


@pytest.fixture(scope="session")
def make_ngon() -> Callable[..., Marker]:
    return build_ngon


@pytest.fixture(scope="session")
def pentagon() -> Marker:
    """What `design` makes of its defaults."""
    return build_ngon(5, 0.15, 0.036)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the plots of a report of a validation out: they cost two seconds a page."""
    from markergen.presentation import plots
    from markergen.validation import report
    from markergen.validation.report import measured
    from markergen.validation.report import plots as report_plots

    def drawn(draw, name, alt, caption, size=plots.SIZE, kind="", **labels):
        return plots.Plot(f"<svg aria-label='{name}'></svg>", caption)

    for module in (report, measured, report_plots):
        monkeypatch.setattr(module, "plot", drawn)
    monkeypatch.setattr(measured, "svg_bytes", lambda draw, size: b"<svg></svg>")


@pytest.fixture
def only_our_objectives():
    """Forget objectives that a test has passed to `markergen.design`."""
    from markergen.objectives import OBJECTIVES

    before = set(OBJECTIVES._outside)
    yield
    for name in set(OBJECTIVES._outside) - before:
        del OBJECTIVES._entries[name], OBJECTIVES._outside[name]
