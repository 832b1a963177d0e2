"""Files of markers and rigs at random pass as they were written, with whatever options."""

from dataclasses import replace

import numpy as np
import pytest

import markergen as mg
from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import build_marker
from markergen.model.substrate import Substrate, parse_dowel, parse_mount
from tests.support.rigs import corner, cube, rig_of, wall

SHAPES = [
    [[-1, -0.6], [1, -0.6], [1, 0.6], [-1, 0.6]],
    [[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]],
    [[0, 0], [1, 0], [1.2, 1], [0.5, 1.5], [-0.2, 0.8]],
]
SHEETS, SOLIDS = (".pdf", ".svg", ".png", ".dxf"), (".step", ".brep", ".stl", ".3mf", ".glb", ".urdf", ".sdf")


def marker_at_random(rng, is_raised):
    """Dots of one size that do not touch, on a plate of 50 mm to 0.6 m with holes, edges and chamfers."""
    size = 10 ** rng.uniform(-1.6, -0.5)
    kind = rng.integers(4)
    boundary = Circle(size) if kind == 3 else polygon_from([size * np.array(SHAPES[kind])])
    diameter = float(np.round(size * rng.uniform(0.08, 0.25), 4))
    points = []
    while len(points) < 4 + rng.integers(4):
        point = boundary.center + rng.uniform(-1, 1, 2) * boundary.radius
        apart = [np.hypot(*(point - other)) for other in points]
        if boundary.depth(point[None])[0] > 0.62 * diameter and min(apart, default=np.inf) > 1.15 * diameter:
            points.append(point)
    layout = np.column_stack([points, np.round(rng.uniform(0.1, 1, len(points)) * diameter * is_raised, 4)])
    marker = build_marker(layout, boundary, diameter, diameter / 20, keyed=bool(rng.integers(2)))
    lengths = {"thickness": 0.004, "edge": 0.007, "corner_radius": 0.001, "chamfer": 0.0005}
    plate = {name: length for name, length in lengths.items() if rng.random() < 0.3}
    if kind == 3 and rng.random() < 0.5:
        circle = f"{2e3 * size + 20:.3f}mm"
        plate |= {"edge": 0.02, "holes": (*parse_mount(f"4xM4c@{circle}"), *parse_dowel(f"2x4mm@{circle}"))}
    return replace(marker, substrate=Substrate(**plate))


def body_at_random(rng, is_sheet):
    rigs = [
        lambda: cube(0.08, int(rng.integers(1000)), n=5, diameter=0.008),
        lambda: wall(int(rng.integers(1, 4)), 1),
        lambda: corner(bool(rng.integers(2))),
        lambda: rig_of(f"prism:{rng.integers(3, 9)}", edge=0.05, height=0.05),
    ]
    # On a sheet, faces of one layout that is turned on them are taken for each other.
    return (
        rng.choice(rigs[: 3 if is_sheet else 4])() if rng.random() < 0.3 else marker_at_random(rng, rng.random() < 0.2)
    )


def options_at_random(rng, is_sheet):
    if is_sheet:
        choices = {"paper": ["A3", "A2"], "dpi": [200, 300], "colors": ["inverted", "#102030,#f0f0ff", "black,cut:Cut"]}
    else:
        choices = {"engrave": [False], "depth": ["0.5mm"], "tool": ["0.3mm", "2mm"], "tolerance": ["20um"]}
    options = {name: rng.choice(values).item() for name, values in choices.items() if rng.random() < 0.3}
    process = str(rng.choice(sorted(PROCESSES)))
    special = {"cnc": {"through": True}, "dome": {"dome": "ball"}}.get(process, {}) if rng.random() < 0.4 else {}
    return options if is_sheet else {**options, "process": process, **special}


@pytest.mark.long
@pytest.mark.parametrize("seed", range(40))
def test_what_is_exported_passes(seed, tmp_path):
    rng = np.random.default_rng(seed)
    is_sheet = rng.random() < 0.4
    body, options = body_at_random(rng, is_sheet), options_at_random(rng, is_sheet)
    suffixes = SHEETS[:3] if is_sheet and body.frame == "rig" else SHEETS if is_sheet else SOLIDS
    paths = [tmp_path / f"a{suffix}" for suffix in rng.choice(suffixes, 2, replace=False)]
    try:
        body.save(*paths, **options)
    except InputError:
        # Not every marker fits every paper and tool.
        assert not list(tmp_path.iterdir())
        return
    for check in mg.verify(body, *paths):
        # The header of an STL has 80 bytes, too few for many options.
        if not (check.kind == "STL" and len(options) > 3):
            assert check.passed, (options, check.kind, check.findings, check.error)


@pytest.mark.long
def test_fillets_of_a_large_plate_are_as_fine_as_those_of_a_small_one(tmp_path):
    layout = 0.2 * np.array([[-1, -0.8, 0.002], [1, -0.7, 0.06], [0.9, 0.8, 0.1], [-0.9, 0.85, 0.18]])
    marker = build_marker(layout, Circle(0.3), 0.037, 0.002)
    marker.save(tmp_path / "a.step", process="fdm")
    check = mg.verify(marker, tmp_path / "a.step")[0]
    assert check.passed, check.findings
