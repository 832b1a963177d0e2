"""Where control points in space may be: in the region, no higher than the relief, and in sight from every pose."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from markergen.model.occlusion import Passage, passage
from markergen.optimize.region import Region

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TOLERANCE = 1e-10
"""Breach in m that is put down to rounding, as that of a `Region`."""

AT_ONCE = 500_000
"""Lines of sight in one chunk: some 50 MB."""


@dataclass(frozen=True, eq=False)
class ReliefRoom:
    """The feasible layouts (n, 3) of dots of one diameter on pillars.

    Attributes
    ----------
    region : Region
        Where they may be in the plane.
    height : float
        How high they may stand, m.
    eyes : array (P, 3), m
        From where every dot must be seen whole; all higher than `height`.
    """

    region: Region
    height: float
    eyes: Array

    @cached_property
    def wall_radius(self) -> float:
        """How far in m lines of sight stay from the axis of a pillar; 0 for bare points, which hide nothing.

        They keep the clearance from the dot on it, as dots do in the plane: seen closer together, two would be one.
        """
        return self.region.inset if self.region.diameter else 0.0

    @cached_property
    def radii(self) -> tuple[Array, Array]:
        """Radius of the dots in m, and `wall_radius`, as arrays ()."""
        return np.array(self.region.diameter / 2), np.array(self.wall_radius)

    @cached_property
    def shadow(self) -> float:
        """How far in m from its wall a pillar may hide anything on the plate, at most."""
        # A pillar of height t hides what is lower up to (t - z)/(h - z) of the way to the eye, which is most for z = 0.
        way = np.linalg.norm(self.eyes[:, :2], axis=-1) + self.region.boundary.radius
        return float(np.max(self.height / self.eyes[:, 2] * way))

    def within(self, points: Array) -> Array:
        """Bring a layout (n, 3) into the room: in the plane as the region does, and down until nothing is hidden.

        From the lowest dot up, each keeps its height or takes the largest at which it hides nothing of those below it.
        What is brought down so stays above these, so no dot has to be looked at twice. A layout that is jammed in the
        plane stays so.
        """
        plane = self.region.project(points[None, :, :2])[0]
        heights = np.clip(points[:, 2], 0.0, self.height)
        waiting = np.arange(len(points))
        while self.wall_radius and len(waiting) > 1:
            low = waiting[np.argmin(heights[waiting])]
            waiting = waiting[waiting != low]
            ceiling = self._ceiling(np.append(plane[low], heights[low]), plane[waiting])
            heights[waiting] = np.minimum(heights[waiting], ceiling)
        return np.column_stack([plane, heights])

    def _ceiling(self, dot: Array, plane: Array) -> Array:
        """Largest heights (m,) in m of pillars at (m, 2) that hide nothing of a lower dot (3,).

        With c the radii of both, they come to touch at the smallest share s with |a - s d| = c - s r, see `passage`.
        """
        radius, wall = self.region.diameter / 2, self.wall_radius
        way, offset = self.eyes[:, :2] - dot[:2], (plane - dot[:2])[:, None]
        # A s^2 - 2 B s + C = 0, whose smaller root is C over B and the discriminant's root.
        a = np.sum(way**2, axis=-1) - radius**2
        b = np.sum(offset * way, axis=-1) - (radius + wall) * radius
        c = np.maximum(np.sum(offset**2, axis=-1) - (radius + wall) ** 2, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = c / (b + np.sqrt(b**2 - a * c))
            # Where there is no root, or it lies behind the dot, they never touch; where they do from the start, at 0.
            share = np.where(share >= 0, share, np.where((c == 0) & (b > 0), 0.0, np.inf))
            heights: Array = np.min(dot[2] + share * (self.eyes[:, 2] - dot[2]), axis=-1)
        return heights

    def holds(self, points: Array) -> bool:
        """Tell whether a layout (n, 3) is feasible, to a tenth of a nanometer."""
        z = points[:, 2]
        return bool(
            self.region.holds(points[None, :, :2])[0]
            and z.min() >= 0
            and z.max() <= self.height
            and self.hides(points) <= TOLERANCE
        )

    def hides(self, points: Array) -> float:
        """Largest depth in m to which a pillar stands in a line of sight; 0 or less if none does."""
        if not self.wall_radius:
            return 0.0
        dot, pillar = self._neighbors(points, higher=True)
        return max((-float(found.gap.min()) for _, found in self._passages(points, dot, pillar)), default=0.0)

    def tightest(self, points: Array, up_to: float, count: int) -> "Sights":
        """Lines of sight whose gap is at most `up_to` m: of each dot and pillar the `count` with the smallest."""
        dot, pillar = self._neighbors(points)
        kept: list[Index] = [np.zeros((0, 3), dtype=np.int64)]
        for chunk, found in self._passages(points, dot, pillar):
            poses = np.argsort(found.gap, axis=-1, kind="stable")[:, :count]
            rows = np.repeat(np.arange(len(chunk)), poses.shape[1])
            near = found.gap[rows, poses.ravel()] <= up_to
            taken = chunk[rows[near]]
            kept.append(np.stack([dot[taken], pillar[taken], poses.ravel()[near]], axis=-1))
        return Sights(self, np.concatenate(kept))

    def _neighbors(self, points: Array, higher: bool = False) -> tuple[Index, Index]:
        """Dots and pillars (m,) that are near enough for one to be hidden by the other."""
        if not self.wall_radius:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        gaps = np.linalg.norm(points[:, None, :2] - points[None, :, :2], axis=-1)
        near = gaps <= self.shadow + self.region.diameter / 2 + self.wall_radius
        near &= ~np.eye(len(points), dtype=bool)
        if higher:
            near &= points[None, :, 2] > points[:, None, 2]
        dot, pillar = np.nonzero(near)
        return dot, pillar

    def _passages(self, points: Array, dot: Index, pillar: Index) -> list[tuple[Index, Passage]]:
        size = max(1, AT_ONCE // len(self.eyes))
        chunks = [np.arange(start, min(start + size, len(dot))) for start in range(0, len(dot), size)]
        radius, wall = self.radii
        return [
            (chunk, passage(points[dot[chunk], None], radius, points[pillar[chunk], None], wall, self.eyes))
            for chunk in chunks
        ]


@dataclass(frozen=True, eq=False)
class Sights:
    """Some lines of sight past pillars, as constraints of a layout.

    Attributes
    ----------
    room : ReliefRoom
    triples : array (m, 3)
        Indices of dot, pillar and eye.
    """

    room: ReliefRoom
    triples: Index = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.triples)

    def joined(self, others: "Sights") -> "Sights":
        """These and others, each once."""
        return Sights(self.room, np.unique(np.concatenate([self.triples, others.triples]), axis=0))

    def of(self, dots: Index) -> "Sights":
        """Those that depend on where some dots stand."""
        return Sights(self.room, self.triples[np.isin(self.triples[:, :2], dots).any(axis=1)])

    def gap(self, points: Array) -> Array:
        """Gaps (m,) in m for a layout (n, 3), see `markergen.model.occlusion.Passage`."""
        return self._passage(points).gap

    def gap_jacobian(self, points: Array) -> Array:
        """Derivative (m, n, 3) of `gap`.

        By the way the share s is left out where the gap is least over it; at the pillar's top it counts.
        """
        dot, pillar, eye = self.triples.T
        found = self._passage(points)
        share = found.share[:, None]
        way = self.room.eyes[eye, :2] - points[dot, :2]
        away = points[pillar, :2] - points[dot, :2] - share * way
        away /= np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), np.finfo(float).tiny)
        climb = self.room.eyes[eye, 2] - points[dot, 2]
        by_share = np.where(found.topped, self.room.region.diameter / 2 - np.sum(away * way, axis=-1), 0.0)
        jacobian = np.zeros((len(self), *points.shape))
        rows = np.arange(len(self))
        jacobian[rows, pillar, :2] = away
        jacobian[rows, dot, :2] = -(1 - share) * away
        jacobian[rows, pillar, 2] = by_share / climb
        jacobian[rows, dot, 2] = by_share * (points[pillar, 2] - self.room.eyes[eye, 2]) / climb**2
        return jacobian

    def _passage(self, points: Array) -> Passage:
        dot, pillar, eye = self.triples.T
        radius, wall = self.room.radii
        return passage(points[dot], radius, points[pillar], wall, self.room.eyes[eye])
