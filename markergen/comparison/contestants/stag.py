"""STag: a square with a circle inside, detected by stag-python.

B. Benligiray, C. Topal, C. Akinlar, "STag: A stable fiducial marker system", Image and Vision Computing 89, 2019.
"""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey, Lattice, Squares
from markergen.errors import InputError
from markergen.geometry.region import Region
from markergen.model.camera import Camera
from markergen.model.tag import UNITS

FORM, LIBRARY = "stag:HD21[:ID]", 21
WORDS = (
    0x338CB75E16F1,
    0x0A4CF2F96D5B,
    0xB7AA3C04A1A3,
    0x5940FEBC08E4,
    0x50A699CEF484,
    0xE524172F884E,
    0xE8C62C6414D7,
    0xC3A066307C3E,
    0x47A7CB050C71,
    0x85C0A85FCCD8,
    0xACC3B3516425,
    0x6EE1700994EA,
)
"""Words of the library whose minimum Hamming distance is 21: 48 bits, the most significant first; 1 is black."""

QUIET, CIRCLE, CODE, BIT, FILLER, SMOOTHING = 0.125, 0.4, 0.7, 0.062482177287080, 0.7, 0.012
"""White around the black square, radius of the white circle in it, and diameter of the code, in sides of the square;
radius of a bit in diameters of the code; radius of what fills the space between two black bits in those of a bit;
radius to which the code's outline is rounded, in sides."""
_QUADRANT = (
    (0.088363142525988, 0.785398163397448), (0.206935928182607, 0.459275804122858),
    (0.206935928182607, pi / 2 - 0.459275804122858), (0.313672146827381, 0.200579720495241),
    (0.327493143484516, 0.591687617505840), (0.327493143484516, pi / 2 - 0.591687617505840),
    (0.313672146827381, pi / 2 - 0.200579720495241), (0.437421957035861, 0.145724938287167),
    (0.437226762361658, 0.433363129825345), (0.430628029742607, 0.785398163397448),
    (0.437226762361658, pi / 2 - 0.433363129825345), (0.437421957035861, pi / 2 - 0.145724938287167),
)  # fmt: skip
"""Radius, in diameters of the code, and angle of the 12 bits in a quadrant."""
_SEGMENTS = 128
"""Number of sides of a polygon that stands for a circle: they are 3e-4 of its radius off."""


@dataclass(frozen=True, eq=False)
class STag(Squares):
    """An STag with its white border."""

    name: str
    number: int
    side: float
    radius: float
    detector = "stag-python"

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the corners of the black square."""
        return self.side * UNITS

    @property
    def lattice(self) -> Lattice:
        """See `Squares.lattice`: one."""
        return Lattice(1, 1, self.side)

    @property
    def spacing(self) -> float:
        """See `Squares.spacing`: the white around the square."""
        return QUIET * self.side

    @property
    def exact_outlines(self) -> tuple[Array, ...]:
        """See `Squares.exact_outlines`."""
        return tuple(self.side * outline for outline in unit_outlines(self.number))

    def find(self, image: Grey, camera: Camera, options: None) -> Sighting:
        """See `Printed.find`."""
        import stag

        del camera, options
        corners, ids, _ = stag.detectMarkers(image, LIBRARY)
        quads = [np.reshape(quad, (4, 2)) for quad, i in zip(corners, np.ravel(ids), strict=True) if i == self.number]
        if not quads:
            return Sighting(reason=f"no tag with id {self.number}")
        return Sighting(np.arange(4), quads[0].astype(float))


@lru_cache(maxsize=16)
def unit_outlines(number: int) -> tuple[Array, ...]:
    """Outlines (m, 2) of the ink of an STag of side 1, to be filled even-odd."""
    polar = np.array([(radius, angle + quadrant * pi / 2) for quadrant in range(4) for radius, angle in _QUADRANT])
    places = CODE * polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=-1)
    black = np.array([bit == "1" for bit in f"{WORDS[number]:048b}"])
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    pairs = np.argwhere(np.triu(apart < 4 * CODE * BIT, 1) & black[:, None] & black)
    bits, gaps = (_disks(places[bit_mask], CODE * BIT) for bit_mask in (black, ~black))
    ink = (bits | _disks(places[pairs].mean(axis=1), FILLER * CODE * BIT)) - gaps
    for by in (SMOOTHING, -2 * SMOOTHING, SMOOTHING):
        ink = ink.offset(by)
    ink = ((ink | bits) - gaps) & Region.disk(0, 0, CODE / 2, _SEGMENTS)
    square = Region.rectangle(-0.5, -0.5, 0.5, 0.5) - Region.disk(0, 0, CIRCLE)
    return (square | ink).rings


def _disks(centers: Array, radius: float) -> Region:
    return Region.union([Region.disk(x, y, radius, _SEGMENTS) for x, y in centers.tolist()])


def _stag(text: str, arena: Arena) -> STag:
    library, _, number = text.partition(":")[2].partition(":")
    number = number or "0"
    if library != f"HD{LIBRARY}" or not (number.isdecimal() and int(number) < len(WORDS)):
        raise InputError(f"{FORM}, an id of 0 to {len(WORDS) - 1}", repr(text), "write for example stag:HD21:0")
    import stag  # noqa: F401  # without it the contestant is absent

    return STag(text, int(number), sqrt(2) * arena.square / (1 + 2 * QUIET), arena.square)


KINDS.register("stag")(ContestantKind(_stag, FORM, "STag", "its own library", requires="stag-python"))
