"""Level faces of parts: what remains of the caps of their bodies where these stand on or are cut from each other.

Bodies that are joined only touch, and what is cut lies inside of them or ends at their surface. The oriented surface of
a part is therefore the sum of the surfaces of its added bodies minus those of the others: walls stay as they are, and
the caps at one height become faces bounded by rims. No Boolean operation is needed to find them.
"""
# tests: tests/workshop/test_kernel.py tests/workshop/test_mesh.py

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from markergen.geometry.contour import Contour, area, circle, flattened, offset
from markergen.geometry.region import parents
from markergen.solid.primitives import OFF, SAME, Part, Primitive, Prism

DIGITS = 6
"""Decimals of a height in mm: one level."""


@dataclass(frozen=True)
class Rim:
    """Edge between a wall of a body and its cap.

    Attributes
    ----------
    z : float
        Height.
    side : int
        1 if the cap to the left of the contour has its outside above, -1 if below.
    like : Contour
        The contour itself or, above a chamfer, the outline below it, which has the same sides.
    added : bool
        True for a body that is added, False for one that is cut or marked.
    floor : bool
        True for the floor of a marked body.
    """

    z: float
    contour: Contour
    side: int
    like: Contour
    added: bool
    floor: bool = False

    @property
    def winding(self) -> int:
        """Value added to the inside of the contour: 1 for a face with its outside above, -1 for one below."""
        return self.side if area(self.contour) > 0 else -self.side


@dataclass(frozen=True)
class PlanarFace:
    """A level face of a part.

    Attributes
    ----------
    up : bool
        True if its outside is above.
    rims : tuple of Rim
        The outer one first, then those of its holes.
    marked : bool
        True for the floor of a marked body.
    """

    z: float
    up: bool
    rims: tuple[Rim, ...]
    marked: bool


def signed_bodies(part: Part) -> Iterator[tuple[Primitive, int, bool]]:
    """Yield each body of a part, 1 if it is added or -1 if not, and whether it is marked."""
    yield from ((body, 1, False) for body in part.add)
    yield from ((body, -1, False) for body in part.cut)
    yield from ((body, -1, True) for body in part.marked)


def level_faces(part: Part, face_only: bool = False) -> list[PlanarFace]:
    """Level faces of a part, the lowest first; with `face_only` without the bottom of its first body.

    Raises
    ------
    ValueError
        If bodies overlap, or one is cut where there is nothing.
    """
    rims = sorted(
        (rim for body, sign, marked in signed_bodies(part) for rim in _rims(body, sign, marked)),
        key=lambda rim: round(rim.z, DIGITS),
    )
    faces = [face for _, level in groupby(rims, lambda rim: round(rim.z, DIGITS)) for face in _faces(list(level))]
    return [face for face in faces if not face_only or face.up or face.z > part.add[0].span[0] + SAME]


def _rims(body: Primitive, sign: int, marked: bool) -> Iterator[Rim]:
    if isinstance(body, Prism):
        above = offset(body.outer, body.chamfer) if body.chamfer else body.outer
        for top, bottom in ((above, body.outer), *((hole, hole) for hole in body.holes)):
            yield Rim(body.top, top, sign, bottom, sign > 0)
            # A chamfer makes the upper cap smaller, not the lower one.
            yield Rim(body.bottom, bottom, -sign, bottom, sign > 0, marked)
        return
    for (r, z), (u, w), bulge in body.profile.sides:
        if not bulge and abs(z - w) < SAME:
            # The profile has its inside to the left: a side toward the axis is a cap with its outside above.
            # A ring is the disk of the larger radius less that of the smaller one; a radius of 0 has no rim.
            for radius, side in ((r, sign), (u, -sign)):
                if radius >= SAME:
                    rim = circle(radius, body.x, body.y)
                    yield Rim(z, rim, side, rim, sign > 0, marked and u > r)


def _faces(rims: Sequence[Rim]) -> Iterator[PlanarFace]:
    """Yield the faces of one level: regions between nested rims, in which the caps do not cancel each other."""
    around = parents([flattened(rim.contour, OFF) for rim in rims]) if len(rims) > 1 else [-1]
    if around is None:
        raise ValueError(f"edges that cross at z = {rims[0].z:.6g} mm")
    # Sum of the caps inside of each rim, of added bodies and of those that are cut.
    inside: dict[int, tuple[int, int]] = {-1: (0, 0)}

    def sums(k: int) -> tuple[int, int]:
        if k not in inside:
            added, cut = sums(around[k])
            winding = rims[k].winding
            inside[k] = (added + winding, cut) if rims[k].added else (added, cut + winding)
        return inside[k]

    for k, rim in enumerate(rims):
        added, cut = sums(k)
        if max(abs(added), abs(cut), abs(added + cut)) > 1:
            raise ValueError(f"bodies that overlap at z = {rim.z:.6g} mm")
        if added + cut:
            holes = [rims[j] for j, parent in enumerate(around) if parent == k]
            yield PlanarFace(rim.z, added + cut > 0, (rim, *holes), rim.floor)
