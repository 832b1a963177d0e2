"""Markers whose fabrication drawings have something of everything."""

from dataclasses import replace

import numpy as np

from markergen.model.boundary import Circle, Polygon, polygon_from
from markergen.model.fabrication import Fabrication
from markergen.model.marker import build_marker
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.workshop.drafting.content import workpiece
from markergen.workshop.processes import parts_of


def ngon(n, radius, heights=0.0):
    angles = 2 * np.pi * np.arange(n) / n + np.pi / 2
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), heights * (np.arange(n) % 3) / 2], axis=-1)


def ring_of_holes(count, radius, diameter, sink=0.0):
    angles = np.pi / count + 2 * np.pi * np.arange(count) / count
    return tuple(Hole(radius * np.cos(a), radius * np.sin(a), diameter, sink, "mount", "M3") for a in angles.tolist())


def case(points, boundary, diameter, tag=None, **substrate):
    marker = build_marker(np.asarray(points), boundary, diameter, diameter / 10)
    return replace(
        marker, provenance={"spec_hash": "1a2b3c4d"}, tag=tag, substrate=Substrate(**{"thickness": 0.004, **substrate})
    )


GRID = np.stack(np.meshgrid(np.arange(10) * 0.03 - 0.135, np.arange(6) * 0.03 - 0.075), axis=-1).reshape(-1, 2)
CORNER = [[-0.08, -0.06], [0.08, -0.06], [0.08, -0.02], [-0.04, -0.02], [-0.04, 0.11], [-0.08, 0.11]]
MARKERS = {
    "disk": case(
        ngon(5, 0.13), Circle(0.15), 0.036, Tag("apriltag:36h11", 3, 0.06), holes=ring_of_holes(4, 0.06, 0.0034)
    ),
    "relief": case(
        ngon(12, 0.035, 0.02), Circle(0.045), 0.012, chamfer=0.0005, holes=ring_of_holes(4, 0.02, 0.0034, 0.0067)
    ),
    "many": case(GRID, Polygon((((-0.16, -0.1), (0.16, -0.1), (0.16, 0.1), (-0.16, 0.1)),)), 0.018, corner_radius=0.01),
    "corner": case(
        [[-0.06, -0.04], [0.06, -0.04], [-0.06, 0.09], [-0.02, -0.04]],
        polygon_from([np.array(CORNER)], "file"),
        0.02,
        holes=(Hole(0.03, -0.04, 0.0034, 0.0067, "mount", "M3"),),
    ),
    "small": case(ngon(4, 0.012), Circle(0.015), 0.004),
    "apart": case(
        [[-0.2, 0.0], [0.2, 0.03], [0.2, -0.03], [-0.2, 0.05]],
        Polygon(
            (
                ((-0.25, -0.1), (-0.15, -0.1), (-0.15, 0.1), (-0.25, 0.1)),
                ((0.15, -0.1), (0.25, -0.1), (0.25, 0.1), (0.15, 0.1)),
            )
        ),
        0.02,
    ),
}  # fmt: skip


def described(marker, **choices):
    fabrication = Fabrication(**choices)
    return workpiece(marker, fabrication, parts_of(marker, fabrication))
