"""The solid that a file should have: its parts made again with the options of the export, as triangles."""

# tests: tests/verification/test_solids.py

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, OutputError
from markergen.exporters import EXPORTERS
from markergen.model.body import Body
from markergen.model.body_json import body_to_json, from_content
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.solid.primitives import COLORS
from markergen.verification.matching import DotSet
from markergen.verification.rays import Shell, normals_of
from markergen.verification.rims import Rims, dots_of

ALONE = {
    "dark": "the dark parts alone: verify the light ones, or the file of all parts, too",
    "light": "the light parts alone, with pockets for the dark ones: verify these, or the file of all parts, too",
}

MATERIALS = tuple(COLORS)

OPTIONS: tuple[dict[str, Any], ...] = ({}, {"through": True}, {"fit": "press"}, {"dome": "ball"})
"""Choices with which each process is tried for a file that records none."""

CLOSE = 5e-4
"""Relative difference of volume and area below which no other options are tried: of meshes within 10 um of each other.
"""

UNIT = 3.0
"""Ratio of the size of a file to that of its body beyond which it is in another unit."""

FAR = 30.0
"""Ratio of the distance of something far away to the mean distance of a solid's area from its middle."""

BESIDE = 0.05
"""Distance in mm from the box around a solid beyond which what is there does not count for its volume."""

CUT = 0.02
"""Maximum share of the surface that the box may cut, as a post on a plate; it cuts the faces of one that was moved."""

MOST_MADE = 5
"""Number of solids that are made with options that a file may have been exported with: those nearest in volume."""

RIM = 2.5
"""Maximum ratio of the radius of a dot to that of its rim, of a ball on a neck."""


@dataclass(frozen=True, eq=False)
class WantedSolid:
    """Parts of a body as triangles, mm, body frame.

    Attributes
    ----------
    names : tuple of str
    materials : tuple of str
        Those of the parts.
    """

    body: Body
    fabrication: Fabrication
    names: tuple[str, ...]
    shell: Shell
    materials: tuple[str, ...] = MATERIALS

    @property
    def note(self) -> str:
        """Which parts these are, if not all."""
        return "" if len(self.materials) > 1 else ALONE[self.materials[0]]


# All choices of one marker, of which several files are often compared.
@lru_cache(maxsize=16)
def wanted_solid(body: Body, fabrication: Fabrication, materials: tuple[str, ...] = MATERIALS) -> WantedSolid:
    """Make the parts of some materials; raises InputError if the body cannot be made with these options."""
    parts, meshed = _made(body, fabrication)
    pairs = [(part, mesh) for part, mesh in zip(parts, meshed(1e3 * fabrication.tolerance), strict=True)
             if part.material in materials]  # fmt: skip
    corners = [mesh.points[mesh.triangles] for _, mesh in pairs]
    owner = np.repeat(np.arange(len(pairs)), [len(mesh.triangles) for _, mesh in pairs])
    dark = [(part.material == "dark") != mesh.marked for part, mesh in pairs]
    shell = Shell(np.concatenate([np.zeros((0, 3, 3)), *corners]), owner, np.concatenate([np.zeros(0, bool), *dark]))
    return WantedSolid(body, fabrication, tuple(part.name for part, _ in pairs), shell, materials)


@lru_cache(maxsize=64)
def _made(body: Body, fabrication: Fabrication) -> tuple[Sequence[Any], Callable[[float], Sequence[Any]]]:
    """Parts, which are those of every format, and what meshes them."""
    return EXPORTERS[".glb"].parts_of(body, fabrication)


def best_wanted(body: Body, asked: Fabrication, recorded: bool, corners: Array, bare: bool) -> list[WantedSolid]:
    """Solids that a file may have: the one nearest in volume and area, and the one asked for.

    The file has triangles with `corners` (m, 3, 3) in mm. If it recorded the options, no others are tried. A `bare` one
    has neither names nor colors, and may hold the parts of one material.

    Raises InputError if the body cannot be made with the options.
    """
    ranked: list[tuple[float, WantedSolid]] = []
    problem: InputError | OutputError | None = None
    kinds = (MATERIALS, *((material,) for material in MATERIALS)) if bare else (MATERIALS,)
    asked_volumes: dict[tuple[str, ...], float] = {}
    choices = list[tuple[float, Fabrication, tuple[str, ...]]]()
    for fabrication in [asked] if recorded else _choices(body, asked):
        # What is engraved in the back takes most of the time, and is about as much for all processes.
        plain = replace(fabrication, engrave=False)
        try:
            parts = _made(body, plain)[0]
            made = parts if not fabrication.engrave or choices else _made(body, fabrication)[0]
        except (InputError, OutputError) as error:
            problem = problem or error
            continue
        for materials in kinds:
            whole, engraved = (
                sum(part.volume for part in solids if part.material in materials) for solids in (parts, made)
            )
            if not whole or (len(materials) == 1 and len({part.material for part in parts}) == 1):
                continue
            cut = asked_volumes.setdefault(materials, whole - engraved)
            for engrave in (fabrication.engrave, not fabrication.engrave)[: 1 if recorded else 2]:
                choices.append((whole - cut * engrave, replace(fabrication, engrave=engrave), materials))
    if not choices:
        assert problem is not None
        raise problem
    # In another unit, all is larger by the same.
    usual_corners = wanted_solid(body, *choices[0][1:]).shell.corners
    ratio = size_of(corners) / size_of(usual_corners)
    corners = corners if 1 / UNIT < ratio < UNIT else corners / ratio
    measures = [(max(abs(volume_of(mesh)), 1e-9), area_of(mesh)) for mesh in (corners, _around(corners, usual_corners))]

    def off(measured: tuple[float, float], volume: float, area: float | None = None) -> float:
        """Relative difference of volume and area from those measured in the file."""
        return abs(float(np.log(measured[0] / volume))) + (abs(float(np.log(measured[1] / area))) if area else 0.0)

    # What was asked for first, so that a damaged file is compared with it whatever its volume.
    order = sorted(choices, key=lambda choice: choice[1] != asked)
    # Inlays that fill their pockets leave the volume as it is, but for rounding. What is beside the usual box may be
    # extra, or balls on the plate.
    by_measure = [
        sorted(order[len(kinds) :], key=lambda choice: round(off(measured, choice[0]), 9)) for measured in measures
    ]
    rest = dict.fromkeys(chain.from_iterable(zip(*by_measure, strict=True)))
    for volume, fabrication, materials in [*order[: len(kinds)], *rest][:MOST_MADE]:
        wanted = wanted_solid(body, fabrication, materials)
        area = area_of(wanted.shell.corners)
        ranked.append((min(off(measured, volume, area) for measured in measures), wanted))
        if ranked[-1][0] < CLOSE:
            break
    best = min(ranked, key=lambda rank: rank[0])[1]
    # What is engraved in a large plate changes its volume less than a coarse mesh does.
    other = replace(best.fabrication, engrave=not best.fabrication.engrave)
    others = [] if recorded else [wanted_solid(body, other, best.materials)]
    return list(dict.fromkeys([best, *others, ranked[0][1]]))


def _around(corners: Array, wanted: Array) -> Array:
    """Triangles (m, 3, 3) in the box around others: what is beside is extra. All, if the box cuts through them."""
    points = wanted.reshape(-1, 3)
    inside = ((corners >= points.min(axis=0) - BESIDE) & (corners <= points.max(axis=0) + BESIDE)).all(axis=2)
    is_cut = inside.any(axis=1) & ~inside.all(axis=1)
    kept = corners[inside.all(axis=1)]
    return kept if len(kept) and area_of(corners[is_cut]) < CUT * area_of(kept) else corners


def on_plate(body: Body, plate: object, name: str) -> Body:
    """Return the body with another substrate, as marker.json has it; raises InputError if it is none."""

    def marker_on(marker: Marker) -> Marker:
        if marker.substrate.as_dict() == plate:
            return marker
        return from_content({**json.loads(body_to_json(marker)), "substrate": plate}, name)

    return body.with_markers(marker_on)


def _choices(body: Body, asked: Fabrication) -> Iterator[Fabrication]:
    """The options that were given, and those of every process; pillars also without fillets."""
    heights = [point.z for plate in body.plates for point in plate.marker.control_points]
    for foot in dict.fromkeys((asked.foot, *([0.0] if any(heights) else []))):
        yield replace(asked, foot=foot)
        for process in dict.fromkeys((asked.process, *PROCESSES)):
            for options in OPTIONS:
                if set(options) <= set(PROCESSES[process].choices) and (options or process != asked.process):
                    yield replace(Fabrication(process, **options), tolerance=asked.tolerance, foot=foot,
                                  draft=asked.draft, engrave=asked.engrave)  # fmt: skip


def wanted_dots(marker: Marker, rims: Rims) -> tuple[DotSet, Array]:
    """Rims of a marker's dots, with their ids, and their different radii, among rims in the marker's frame, mm."""
    places = 1e3 * marker.xyz[:, :2]
    up = rims.take(np.abs(rims.normals[:, 2]) > 1 - 1e-5)
    radii = []
    for (x, y), point in zip(places, marker.control_points, strict=True):
        candidates = np.flatnonzero(np.hypot(up.centers[:, 0] - x, up.centers[:, 1] - y) < 1e-2)
        ratio = np.abs(np.log(up.radii[candidates] / (500 * point.feature.diameter)))
        if len(candidates) and ratio.min() < np.log(RIM):
            radii.append(up.radii[candidates[np.argmin(ratio)]])
    sizes = np.unique(np.round(radii, 6))
    if not len(sizes):
        return dots_of(up, np.array([np.inf])).take(np.zeros(0, np.intp)), sizes
    dots = dots_of(up, sizes)
    away = np.linalg.norm(dots.centers[:, None] - places, axis=2)
    index, ids = [], []
    for k, point in enumerate(marker.control_points):
        if len(dots) and away[:, k].min() < 1e-2:
            index.append(int(np.argmin(away[:, k])))
            ids.append(point.id)
    return replace(dots.take(np.array(index, np.intp)), names=tuple(ids), ordered=True), sizes


def volume_of(corners: Array) -> float:
    """Volume in mm^3 that triangles (m, 3, 3) enclose."""
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def size_of(corners: Array) -> float:
    """Largest side in mm of some triangles (m, 3, 3), without what is far away from most of their area."""
    areas = _areas(corners) + 1e-300
    middle = np.average(corners.mean(axis=1), axis=0, weights=areas)
    away = np.linalg.norm(corners - middle, axis=2).max(axis=1)
    kept = corners[away <= FAR * np.average(away, weights=areas)]
    return max(float(np.ptp(kept.reshape(-1, 3), axis=0).max()), 1e-12)


def area_of(corners: Array) -> float:
    """Area in mm^2 of triangles (m, 3, 3)."""
    return float(_areas(corners).sum())


def _areas(corners: Array) -> Array:
    return np.asarray(np.linalg.norm(normals_of(corners), axis=1) / 2)
