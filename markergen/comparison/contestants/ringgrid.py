"""Coded rings on a hexagonal lattice, drawn and detected by ringgrid."""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey, Printed, grid_size, share_of
from markergen.errors import InputError
from markergen.geometry.region import Region, enclosing_circle
from markergen.model.camera import Camera

FORM, SHARE = "ringgrid:COLUMNSxROWS[:SHARE]", 0.8
"""How to write it, and the default diameter of a ring over the distance to the nearest one."""
INNER, BAND = 2 / 3, 0.12
"""Radius of the inner ring and width of both, over the radius of the outer one, as in ringgrid's own targets."""
_SECTORS = 16
"""Number of sectors of a ring's code, as in ringgrid's own targets."""
_SEGMENTS = 256
"""Number of sides of a polygon that stands for a circle: they are 8e-5 of its radius off."""
TIERS = {"wide": ((8.0, 24.0), (20.0, 60.0), (50.0, 150.0)), "narrow": ((8.0, 20.0), (14.0, 40.0), (30.0, 90.0))}
"""Ranges of the diameters of rings in px, each searched in turn."""


SCALES = {f"scales {scales}": scales for scales in ("adaptive", "two_tier_standard", "four_tier_wide", *TIERS)}
"""Diameters of rings to look for: ``adaptive``, those of ringgrid's presets, or a key of `TIERS`. Centers are corrected
for perspective, its default."""


@dataclass(frozen=True, eq=False)
class RingGrid(Printed):
    """A lattice of coded rings."""

    name: str
    columns: int
    rows: int
    share: float
    scale: float
    radius: float
    detectors = SCALES
    detector = "ringgrid"

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the rings' centers."""
        return self.scale * _drawn(self.columns, self.rows, self.share)[1]

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        outer = 2 * self.scale * self.share * np.sqrt(3) / 2 / (1 + BAND)
        return f"{len(self.points)} rings of {1e3 * outer:.4g} mm"

    def outlines(self, moved: Array, scale_px: float) -> tuple[Array, ...]:
        """See `Printed.outlines`."""
        del scale_px
        rings = _drawn(self.columns, self.rows, self.share)[2]
        return tuple(
            self.scale * outline + offset for offset, ring in zip(moved, rings, strict=True) for outline in ring
        )

    def find(self, image: Grey, camera: Camera, options: str) -> Sighting:
        """See `Printed.find`."""
        del camera
        detector = _detector(self.columns, self.rows, self.share)
        tiers = _tiers(options)
        result = detector.detect_adaptive(image) if tiers is None else detector.detect_multiscale(image, tiers)
        row = {number: k for k, number in enumerate(_drawn(self.columns, self.rows, self.share)[0])}
        seen = [ring for ring in result.detected_markers if ring.id in row]
        if len(seen) < 4:
            return Sighting(reason=f"{len(seen)} rings")
        ids = np.array([row[ring.id] for ring in seen], dtype=np.intp)
        return Sighting(ids, np.array([ring.center for ring in seen], dtype=float))


def _target(columns: int, rows: int, share: float) -> Any:
    """Target whose lattice has a pitch of 1 mm: neighbors are sqrt(3) mm apart."""
    import ringgrid

    outer = share * np.sqrt(3) / 2 / (1 + BAND / 2)
    return ringgrid.TargetLayout.coded_hex(1.0, rows, columns, outer, INNER * outer, BAND * outer)


@lru_cache(maxsize=16)
def _drawn(columns: int, rows: int, share: float) -> tuple[tuple[int, ...], Array, tuple[tuple[Array, ...], ...]]:
    """Ids, centers (n, 2) and outlines of the rings, of a lattice with a pitch of 1, y up, in its smallest circle.

    The package draws a target as SVG: for each ring two circles, and a path for each dark sector of its code.
    """
    import xml.etree.ElementTree as ElementTree

    svg = "{http://www.w3.org/2000/svg}"
    ids, centers, codes = [], [], []
    for group in ElementTree.fromstring(_target(columns, rows, share).render_artifacts().svg_text).iter(f"{svg}g"):
        circles = group.findall(f"{svg}circle")
        if not (circles and "data-id" in group.attrib):
            continue
        center = np.array([float(circles[0].attrib[key]) for key in ("cx", "cy")])
        dark = [path.attrib["d"].split() for path in group.findall(f"{svg}path") if path.attrib["fill"] == "black"]
        starts = [np.array([float(path[1]), float(path[2])]) - center for path in dark]
        ids.append(int(group.attrib["data-id"]))
        centers.append(center)
        codes.append([float(np.arctan2(start[1], start[0])) for start in starts])
    places = np.array(centers) * [1, -1]
    places = places - enclosing_circle(places)[0]
    outer = share * np.sqrt(3) / 2 / (1 + BAND / 2)
    rings = tuple(
        tuple(center + outline * [1, -1] for outline in _ring(tuple(code), outer))
        for center, code in zip(places, codes, strict=True)
    )
    return tuple(ids), places, rings


def _ring(starts: tuple[float, ...], outer: float) -> tuple[Array, ...]:
    """Outlines (m, 2) of a ring about the origin, whose dark sectors start at these angles; y down."""
    band = BAND * outer / 2

    def annulus(radius: float) -> Region:
        return Region.disk(0, 0, radius + band, _SEGMENTS) - Region.disk(0, 0, radius - band, _SEGMENTS)

    wedges = []
    for start in starts:
        angle = start + np.linspace(0, 2 * np.pi / _SECTORS, 9)
        rim = 2 * outer * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        wedges.append(Region.polygon(np.concatenate([[[0.0, 0.0]], rim])))
    between = Region.disk(0, 0, outer, _SEGMENTS) - Region.disk(0, 0, INNER * outer, _SEGMENTS)
    return (annulus(outer) | annulus(INNER * outer) | (Region.union(wedges) & between)).rings


@lru_cache(maxsize=16)
def _detector(columns: int, rows: int, share: float) -> Any:
    import ringgrid

    return ringgrid.Detector.from_target(_target(columns, rows, share))


def _tiers(scales: str) -> Any:
    import ringgrid

    if scales == "adaptive":
        return None
    if scales in TIERS:
        return ringgrid.ScaleTiers([ringgrid.ScaleTier(*ends) for ends in TIERS[scales]])
    return getattr(ringgrid.ScaleTiers, scales)()


def _grid(text: str, arena: Arena) -> RingGrid:
    columns, rows, rest = grid_size(text, FORM, "ringgrid:4x5")
    share = share_of(rest, "a ring's diameter over the distance to the nearest", SHARE, 0.3, 0.95)
    if min(columns, rows) < 3 or columns * rows > 800:
        raise InputError(f"{FORM}, of 3x3 to 20x40 rings", repr(text), "write for example ringgrid:4x5")
    _, places, _ = _drawn(columns, rows, share)
    reach = float(np.linalg.norm(places, axis=-1).max()) + share * np.sqrt(3) / 2
    width, height = (np.ptp(places, axis=0) + share * np.sqrt(3)).tolist()
    pitch = arena.scale(width, height, reach)
    return RingGrid(text, columns, rows, share, pitch, pitch * reach)


KINDS.register("ringgrid")(
    ContestantKind(_grid, "ringgrid:CxR[:SHARE]", "coded rings", "its own library", requires="ringgrid")
)
