"""Lower bound on the value that any n dots in a room can reach, by convex duality.

**Concavity.** A dot at x adds M_p(x) to the information of pose p, so a layout, or any measure w on the room with
total weight n, has M_p = sum_x w_x M_p(x) and the values v_p = sqrt(tr(W_p M_p^-1)). h_p = v_p^-2 is concave in M_p and
homogeneous of degree 1: the harmonic mean of such functions 1/(c'M^-1 c), up to a factor. Every aggregate A is the
largest (sum_p q_p v_p^t)^(1/t) over some set of weights q: equal ones with t = 2 for rms, 1 for mean and 0 for logmean,
any with sum 1 for max (t = 2), those up to 1/k for the mean of the worst k (t = 1). For each q,
g = (sum_p q_p v_p^t)^(-2/t) is a mean of the h_p with exponent -t/2 <= 0, hence concave and homogeneous as well.
Therefore at any measure w, with the sensitivity s(x) = sum_p <dg/dM_p, M_p(x)>,

    A(v)^-2 <= g(v) <= sum_x v_x s(x)    for every measure v,

and averages of such s, taken at several w and q, do the same: w and q affect how tight a bound is, never its validity.

**Packing.** Let phi(r) fall from 1 to 0 within delta of r = pitch/2, phi(r) + phi(pitch - r) = 1, with
pitch/2 + delta = pitch/sqrt(3). Of dots a pitch apart, sum_i phi(|y - x_i|) <= 1 around every y: three of them do not
fit within pitch/sqrt(3) of y, and two are at distances whose sum is a pitch or more. With multipliers mu_k >= 0 of such
caps around y_k, any layout of n dots has

    A^-2 <= sum_k mu_k + n max_x u(x),    u(x) = s(x) - sum_k mu_k phi(|x - y_k|).

**Several rooms.** Dots of several sizes on one plate, or on the plates of a rig, are in rooms of their own: n_c in room
c. Their matrices add up once they are of the same body's pose, so they have the same weights of sensitivities, and with
caps in each room

    A^-2 <= sum_c (sum_k mu_ck + n_c max_x u_c(x)).

A dot that a pose does not see adds nothing, wherever it might be seen from: it is counted wherever it is, for all poses
that see a dot at any of a grid of places in its room, which only lowers the bound. That is *tested*. Caps between rooms
are left out. The value is over poses that the layout serves: bounded are layouts that serve these as well.

**The whole room.** The maximum is over the continuous room, by branch and bound: u is at most its value at the center
of a box plus gradient and curvature times the box's size, and boxes that cannot exceed the best point found are left
out, others are quartered. s is a polynomial, whose derivatives Markov's inequality bounds: the M_p(x) are
interpolated at Chebyshev nodes, and a bound of the error of that is added to the maximum.

**Interpolation.** Of a pinhole with equal noise, a row of the Jacobian is a polynomial of degree 2 divided by z^2, the
squared depth, so <S_p, M_p> = q/z^4 with q = sum_ij c_ij T_i(u) T_j(v) of degree 4 and z linear in the coordinates
(u, v) of the square [-1, 1]^2 around the room. Let E be the ellipse with foci -1 and 1 and semi-axes
a = (rho + 1/rho)/2 and (rho - 1/rho)/2. For u and v in E, |T_i| <= t_i = (rho^i + rho^-i)/2 and
|z| >= Re z >= m = z(0, 0) - a (|dz/du| + |dz/dv|). Where m > 0, <S_p, M_p> is thus analytic and at most
B = sum_ij |c_ij| t_i t_j / m^4, so that its Chebyshev coefficients are at most 4 B rho^(-i-j). At the nodes, terms with
i or j > d equal others with i, j <= d, up to the sign. So the interpolant of degree d is off by twice the sum of those,

    8 B sum_{max(i, j) > d} rho^(-i-j) <= 16 B rho^(1-d) / (rho - 1)^2,

for any rho > 1: the best for each pose is taken, and the sum over the poses. This *proves* the bound, up to rounding.
With a lens or a noise that depends on the image there is no such proof: ten times the largest error found at random
places is added, and the bound is called *tested*.

Measures and multipliers come from linear programs, whose candidate places include the edge of the room: each maximizes
the smallest of the known bounds sum_x w_x s(x) over w, and gives the next w and mu. Pukelsheim, Optimal Design of
Experiments (1993), has the theory without caps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.maths.information import covariance, moved_information
from markergen.maths.rotation import rotation_z
from markergen.model.camera import NO_DISTORTION
from markergen.objectives import Objective
from markergen.objectives.aggregates import DEFAULT_LEVEL
from markergen.objectives.base import TraceObjective
from markergen.objectives.composed import ComposedObjective
from markergen.optimize.ending import is_due
from markergen.optimize.problem import FeasibleRegion
from markergen.options import Progress
from markergen.units import format_length

Index = NDArray[np.int64]

EXPONENTS = {"rms": 2, "mean": 1, "logmean": 0, "max": 2, "cvar": 1}
"""Exponent t by aggregate."""

DEGREES = (12, 18, 27, 40)
"""Degrees of the interpolation, tried in turn."""

ACCURATE = 1e-6
"""Error of the interpolation, relative to the largest sensitivity, at which a higher degree is not tried."""

ELLIPSES = np.geomspace(1.1, 40.0, 40)
"""Values of rho, see the module, of which the best is taken."""

RATIONAL, SAME = 4, 1e-9
"""Degree of numerator and denominator of the information of a pinhole, and the relative error to which it has to agree:
objectives of plug-ins may be others."""

WEAK = 0.05
"""Gap from which on a bound is called weak: fractions of dots gain much in that room."""

ROUNDS, PATIENCE, TRIED, WORK = 60, 12, 6, 12_000_000
"""Maximum number of linear programs, of those in a row without a noticeable gain, where those judged in the whole room
count as six (three: two programs more for 20 or 40 dots, and a bound closer by 0.03 %), and of coefficients of all:
with half as many, the homography of 60 dots in a disk has a gap of 10.6 % in place of 6.7, a second earlier."""

NOTICEABLE = 0.98
"""Ratio of gaps that counts as a gain."""

CLOSE = 2e-4
"""Relative gap in A^-2 at which the bound is not improved any more."""

EDGE, INSIDE = 1000, 2000
"""Approximate number of candidate places on the edge of the room and inside."""

MORE = 200
"""Maximum number of candidate places, and of caps, that are added to a linear program at a time."""

STEPS = (0.5, 0.25, 0.1)
"""Fractions of the way to the solution of a linear program, at the best of which the next bound is taken."""

SLACKEST = 0.8
"""Weight in a cap below which it is left out of the next linear program."""

LEVELS, MOST_BOXES, BOXES_IN_ALL = 14, 400_000, 200_000
"""Limits of one branch and bound, and of all; where they end it, the bound is the best so far, still valid. Three times
as many take five times as long for 100 dots in a disk, for a bound closer by 0.25 %."""

AT_ONCE = 4000
"""Number of places whose caps are added at a time: all at once take 700 MB for 100 dots."""

TESTED = 100
"""Number of random places at which the interpolation is tested."""

SOFTNESS = 0.002
"""Final softness of aggregates with kinks."""

COARSE = 10
"""The first linear program has one candidate place, and one cap, in this many, unless places stand for orbits."""

ORBIT = 24
"""Number of angles by which a layout in a disk is turned for the first measure, and by which each place and cap is
turned where that changes no sensitivity: linear programs are smaller by the square of it, and bounds closer."""

BOXES = 24
"""Number of boxes along the longer side of the room that branch and bound starts from."""

_SLACK = 1e-9
"""Violation in m of inset and spacing that a layout may have."""


@dataclass(frozen=True)
class Certificate:
    """Lower bound on an objective for n dots in a room, or why there is none.

    Attributes
    ----------
    value : float
        Value of the layout that was found, in the objective's unit.
    lower_bound : float
        No layout of n dots in the room has a smaller value; 0 if none is known.
    reason : str
        Why none is known, otherwise empty.
    apart : float
        Smallest gap in m that the dots were to keep; 0 if only their clearance.
    proven : bool
        Whether all of the bound is proven, or a part of it tested at random places.
    rooms : int
        Number of rooms: plates of a rig, or sizes of dots.
    """

    n: int
    value: float
    lower_bound: float = 0.0
    reason: str = ""
    apart: float = 0.0
    proven: bool = True
    rooms: int = 1

    @property
    def gap(self) -> float:
        """Fraction of the value by which another layout can be better, at most."""
        return max(0.0, 1 - self.lower_bound / self.value)

    @property
    def sentence(self) -> str:
        """The certificate in words."""
        if self.reason:
            return f"no lower bound: {self.reason}"
        # Rounded up.
        percent = np.ceil(1000 * self.gap) / 10
        apart = f", {format_length(self.apart)} or more apart," if self.apart else ""
        doubts = [word for word, holds in (("weak", self.gap > WEAK), ("tested, not proven", not self.proven)) if holds]
        doubt = f" (the bound is {' and '.join(doubts)})" if doubts else ""
        room = "this room" if self.rooms == 1 else "these rooms"
        return f"no {self.n} dots in {room}{apart} can be more than {percent:.1f} % better{doubt}"


def certify(
    objective: Objective, region: FeasibleRegion, points: Array, progress: Progress | None = None
) -> Certificate:
    """Certificate of a layout (n, 2) in m for an objective of all poses; see the module for the method and its proof.

    There is none for a relief, for objectives without information matrices and their own aggregates, or where the
    matrices cannot be interpolated, very close to the camera or at the edge of a lens model.
    """
    n, value = len(points), float(objective(points[None])[0])
    if points.shape[-1] > 2:
        return Certificate(n, value, reason="the dots of a relief may hide each other")
    if isinstance(objective, ComposedObjective):
        if len(objective.terms) > 1:
            return Certificate(n, value, reason="the objective is a weighted sum")
        # Bounds only raise the least value.
        return certify(objective.terms[0][1], region, points, progress)
    if not isinstance(objective, TraceObjective):
        return Certificate(n, value, reason="the objective is not a convex function of the layout")
    return certify_rooms(objective, [Room(objective, region, points)], value, progress)


@dataclass(frozen=True, eq=False)
class Room:
    """Room of dots of one size on one plate, which add to the information on the pose of a body.

    Attributes
    ----------
    objective : TraceObjective
        Gives their information, in the plate's frame, for the poses that may see a dot of the room.
    points : array (n, 2), m
    seen : array (P,) of bool or None
        These poses among all of the body; None for all.
    offset : array (p, 3) or None
        Vectors in m from the body's origin to the plate's, camera frame; None if they are the same.
    """

    objective: TraceObjective
    region: FeasibleRegion
    points: Array
    seen: Mask | None = None
    offset: Array | None = None

    def information(self, places: Array) -> Array:
        """Information (C, p, k, k) on the body's pose of dots at places (C, 2)."""
        matrices = self.objective.information(places[:, None])[0]
        return matrices if self.offset is None else moved_information(matrices, -self.offset)


def certify_rooms(
    objective: TraceObjective, rooms: Sequence[Room], value: float, progress: Progress | None = None
) -> Certificate:
    """Certificate of a layout with a value in an objective of the body's pose, of dots in one or several rooms."""
    n = sum(len(room.points) for room in rooms)
    if objective.aggregate.partition(":")[0] not in EXPONENTS:
        return Certificate(n, value, reason=f"the aggregate {objective.aggregate} is not known to be convex")
    for degree in DEGREES:
        program = _Program(objective, rooms, degree, value)
        if program.accurate:
            regions = [room.region for room in rooms]
            apart = max(region.gap if region.gap > region.clearance else 0.0 for region in regions)
            lower_bound = value / np.sqrt(program.solve(progress))
            proven = all(part.fields.proven for part in program.parts)
            return Certificate(n, value, lower_bound, apart=apart, proven=proven, rooms=len(rooms))
    return Certificate(n, value, reason="some pose is too close to the marker, or its lens model ends there")


class _Fields:
    """Chebyshev interpolation of the information matrices of a dot as functions of its place.

    A sensitivity is a vector (P T,): its product with the packed matrices of a place, T = k (k + 1) / 2 entries each,
    is s at that place. Computed are only the entries of the p poses that see the room; the others are 0.
    """

    def __init__(self, room: Room, degree: int) -> None:
        self.room, region = room, room.region
        # A layout turned by all rotations (T, 2, 2) of a disk is a measure that keeps the caps, and often the best.
        turns = ORBIT if len(region.walls) == 1 else 1
        self.turns = rotation_z(np.linspace(0.0, 2 * np.pi, turns, endpoint=False))[:, :2, :2]
        self.objective = objective = room.objective
        corners = np.concatenate(region.boundary.outlines())
        self.middle = (corners.max(axis=0) + corners.min(axis=0)) / 2
        self.half = np.maximum(np.ptp(corners, axis=0) / 2 - region.inset, 0.0) + 1e-6 * region.boundary.radius
        self._upper = np.triu_indices(objective.weight.shape[-1])
        seen = np.ones(len(objective.setting.poses), dtype=bool) if room.seen is None else room.seen
        self._seen = np.repeat(seen, len(self._upper[0]))
        self._shape = degree + 1, degree + 1
        self._coefficients = self._interpolated(degree, self._packed)
        self._places = region.boundary.sample(TESTED, region.inset, np.random.default_rng(0))
        self._exact = self._packed(self._places)
        self._numerators = self._interpolated(RATIONAL, lambda places: self._packed(places) * self._depths(places))
        x, y = (values[:, : RATIONAL + 1] for values in self.basis(self._places))
        products = (x[:, :, None] * y[:, None]).reshape(len(x), -1) @ self._numerators / self._depths(self._places)
        plain = objective.setting.noise is None and objective.setting.camera.distortion == NO_DISTORTION
        self.proven = plain and bool(np.abs(products - self._exact).max() <= SAME * np.abs(self._exact).max())

    def _interpolated(self, degree: int, function: Callable[[Array], Array]) -> Array:
        """Chebyshev coefficients ((d + 1)^2, m) of a function of places (C, 2) with values (C, m)."""
        nodes = chebyshev.chebpts1(degree + 1)
        inverse = np.linalg.inv(chebyshev.chebvander(nodes, degree))
        grid = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 2)
        values = function(self.middle + self.half * grid).reshape(degree + 1, degree + 1, -1)
        once = np.tensordot(inverse, values, (1, 0))
        return np.asarray(np.tensordot(once, inverse, (1, 1)).transpose(0, 2, 1).reshape(len(grid), -1))

    def _depths(self, places: Array) -> Array:
        """z^4 (C, p T) of places (C, 2) in m, for each entry of the packed matrices."""
        poses = self.objective.setting.poses
        depth = places @ poses.rotation[:, 2, :2].T + poses.translation[:, 2]
        return np.repeat(depth**RATIONAL, len(self._upper[0]), axis=1)

    def _packed(self, places: Array) -> Array:
        """Information matrices (C, p T) of dots at places (C, 2), their entries on and above the diagonal."""
        parts = [self.room.information(part) for part in np.array_split(places, len(places) // 16 + 1)]
        i, j = self._upper
        return np.concatenate(parts)[..., i, j].reshape(len(places), -1)

    def basis(self, places: Array) -> tuple[Array, Array]:
        """Values (..., C, d + 1) of the Chebyshev polynomials of both coordinates at places (..., C, 2)."""
        x, y = np.moveaxis((places - self.middle) / self.half, -1, 0)
        return chebyshev.chebvander(x, self._shape[0] - 1), chebyshev.chebvander(y, self._shape[1] - 1)

    def layout_information(self) -> Array:
        """Packed matrices (P T,) of the room's layout turned by all rotations that its shape allows."""
        x, y = self.basis(self.room.points @ self.turns)
        return self.information(np.einsum("tcx,tcy->xy", x, y) / len(self.turns))

    def information(self, moments: Array) -> Array:
        """Packed matrices (P T,) of a measure with moments (d + 1, d + 1), sums of products of the basis."""
        packed = np.zeros(len(self._seen))
        packed[self._seen] = moments.ravel() @ self._coefficients
        return packed

    def polynomial(self, sensitivity: Array) -> Array:
        """Chebyshev coefficients (d + 1, d + 1) of a sensitivity as a function of the place."""
        return (self._coefficients @ sensitivity[self._seen]).reshape(self._shape)

    def error(self, sensitivity: Array) -> float:
        """Bound of the error of `polynomial`: proven, or ten times the largest error at random places of the room."""
        if not self.proven:
            x, y = self.basis(self._places)
            interpolated = np.sum(x @ self.polynomial(sensitivity) * y, axis=1)
            return 10 * float(np.abs(interpolated - self._exact @ sensitivity[self._seen]).max())
        poses, rho = self.objective.setting.poses, ELLIPSES[:, None]
        entries = len(self._upper[0])
        numerators = self._numerators * sensitivity[self._seen]
        c = np.abs(numerators.reshape(len(numerators), -1, entries).sum(axis=-1))
        powers = rho ** np.arange(RATIONAL + 1)
        t = (powers + 1 / powers) / 2
        center = poses.rotation[:, 2, :2] @ self.middle + poses.translation[:, 2]
        least = center - (rho + 1 / rho) / 2 * (np.abs(poses.rotation[:, 2, :2]) @ self.half)
        largest = np.full(least.shape, np.inf)
        numerator = (t[:, :, None] * t[:, None]).reshape(len(rho), -1) @ c
        # A pose may count nothing: 0 / 0.
        np.divide(numerator, np.maximum(least, 0.0) ** RATIONAL, out=largest, where=least > 0)
        errors = 16 * largest * rho ** (2.0 - self._shape[0]) / (rho - 1) ** 2
        return float(errors.min(axis=0).sum())


class _Worth:
    """The objective as a function of packed information matrices (P T,)."""

    def __init__(self, objective: TraceObjective) -> None:
        self.objective = objective
        self._upper = np.triu_indices(objective.weight.shape[-1])

    def _values(self, packed: Array) -> tuple[Array, Array]:
        """C (P, k, k) and values (P,)."""
        i, j = self._upper
        matrix = np.empty_like(self.objective.weight)
        matrix[:, i, j] = matrix[:, j, i] = packed.reshape(len(matrix), -1)
        inverse = covariance(matrix)
        return inverse, np.sqrt(np.einsum("pij,pji->p", self.objective.weight, inverse))

    def sensitivity(self, packed: Array, softness: float) -> Array:
        """Sensitivity (P T,); aggregates with kinks take weights q of the softened aggregate."""
        inverse, values = self._values(packed)
        weighed = inverse @ self.objective.weight @ inverse
        exponent, share = EXPONENTS[self.objective.aggregate.partition(":")[0]], self._shares(values, softness)
        if exponent:
            whole = np.sum(share * values**exponent) ** (-2 / exponent - 1)
        else:
            whole = np.exp(-2 * np.sum(share * np.log(values)))
        weights = share * values ** (exponent - 2) * whole
        i, j = self._upper
        flat = weighed[:, i, j] * np.where(i == j, 1.0, 2.0) * weights[:, None]
        return flat.ravel()

    def worth(self, packed: Array) -> float:
        """A^-2."""
        return float(self.objective.aggregated(self._values(packed)[1], 0.0)[0]) ** -2

    def _shares(self, values: Array, softness: float) -> Array:
        """Weights q (P,) for which (sum q v^t)^(1/t) is at most the aggregate, for all values v."""
        name, _, level = self.objective.aggregate.partition(":")
        count, weight = len(values), self.objective.setting.poses.weight
        mass = np.ones(count) if weight is None else weight / weight.mean()
        if name == "max":
            share = self.objective.aggregated(values, softness)[1] * values
            return share / share.sum()
        if name == "cvar":
            worst = max((1 - float(level or DEFAULT_LEVEL)) * count, 1.0)
            share = self.objective.aggregated(values, softness)[1]
            return share / max(share.sum(), worst * (share / mass).max())
        return mass / count


class _RoomBound:
    """A room's candidate places, caps and branch and bound; values are in units of A^-2 of the layout."""

    def __init__(self, fields: _Fields, cut: Array, thinning: int) -> None:
        self.fields, room, region = fields, fields.room, fields.room.region
        self.region, self.n = region, len(room.points)
        self.pitch = max(region.spacing - _SLACK, 0.0)
        self.boxes = 0
        candidates = candidates_of(region, thinning)
        x, y = fields.basis(candidates @ fields.turns)
        seen = np.sum(x @ fields.polynomial(cut) * y, axis=-1)
        self.turns = fields.turns if self.n * np.ptp(seen, axis=0).max() < CLOSE / 2 else fields.turns[:1]
        self.places = np.concatenate([room.points, candidates[_in_wedge(candidates, len(self.turns))]])
        self.basis = self.fields.basis(self.places @ self.turns)
        coarse = max(COARSE // len(self.turns), 1)
        self.caps = self.places[::coarse] if self.pitch else np.zeros((0, 2))
        self.column = np.arange(len(self.places)) % coarse == 0
        self.column[: self.n] = True

    def information(self, weights: Array) -> Array:
        """Packed matrices (P T,) of a measure with weights (C,) of the places."""
        x, y = (values[:, weights > 0] for values in self.basis)
        moments = np.einsum("tcx,c,tcy->xy", x, weights[weights > 0], y, optimize=True) / len(self.turns)
        return self.fields.information(moments)

    def rotated(self, places: Array, weights: Array) -> tuple[Array, Array]:
        """Places (T C, 2) to which places (C, 2) are turned, and their shares of weights (C,)."""
        return (places @ self.turns).reshape(-1, 2), np.tile(weights / len(self.turns), len(self.turns))

    def at_places(self, cut: Array) -> Array:
        """A sensitivity at the places (C,)."""
        x, y = self.basis
        return np.asarray(np.sum(x @ self.fields.polynomial(cut) * y, axis=-1).mean(axis=0))

    def cover(self) -> Array:
        """Values of the caps (K, C) at the places in columns."""
        rotated = self.places[self.column] @ self.turns
        return np.asarray(sum(_overlap(self.caps, places, self.pitch) for places in rotated) / len(rotated))

    def extend(self, weights: Array, excess: Array, least: float, crowded: Array, more: Array) -> None:
        """Take the caps and places into the next linear program that the last one and its bound were short of."""
        used = weights > 0
        load = _cap(self.caps, *self.rotated(self.places[used], weights[used]), self.pitch, 0.0)[0]
        self.caps = np.concatenate([self.caps[load > SLACKEST], crowded])
        outside = np.where(self.column, -np.inf, excess)
        self.column[_apart(self.places, outside, least + CLOSE / (10 * self.n), self.pitch / 20)] = True
        self.column = np.append(self.column, np.ones(len(more), dtype=bool))
        self.places = np.concatenate([self.places, more])
        self.basis = self.fields.basis(self.places @ self.turns)

    def crowded(self, weights: Array) -> Array:
        """Centers (c, 2) of caps that a measure violates."""
        if not self.pitch:
            return np.zeros((0, 2))
        from scipy.spatial import cKDTree

        used = weights > 1e-9
        held, weights = self.rotated(self.places[used], weights[used])
        i, j = cKDTree(held).query_pairs(self.pitch, output_type="ndarray").T
        centers = np.concatenate([(held[i] + held[j]) / 2, held, self.places])
        centers = centers[_in_wedge(centers, len(self.turns))]
        load = _cap(centers, held, weights, self.pitch, 0.0)[0]
        return centers[_apart(centers, load, 1 + 1e-3, self.pitch / 20)]

    def highest(self, cut: Array, caps: Array, prices: Array, least: float, tolerance: float) -> tuple[float, Array]:
        """Upper bound of u over the room, at most the tolerance too large, and places (c, 2) where u exceeds `least`.

        See the module. Where the limits of branch and bound end it, the bound is larger than need be, still valid.
        """
        fields, region = self.fields, self.region
        value, inset = fields.polynomial(cut), region.inset - _SLACK
        slopes = [_derivative(value, axis) for axis in (0, 1)]
        # No Chebyshev polynomial exceeds 1.
        xx, xy, yy = (np.abs(_derivative(slopes[i], j)).sum() for i, j in ((0, 0), (0, 1), (1, 1)))

        def at(places: Array, reach: Array, outward: Array) -> tuple[Array, Array]:
            """Values of u (C,), and their upper bounds within a distance of `reach`, in units of the room, by axis.

            For places on the circle around the room, with a normal that is `outward` (C, 2), within the circle alone.
            """
            x, y = ((places - fields.middle) / fields.half).T
            covered, slope, bend = _cap(places, caps, prices, self.pitch, float(np.hypot(*(reach * fields.half))))
            # Faster than chebval2d, fivefold.
            by_x, by_y = (chebyshev.chebvander(axis, len(value) - 1) for axis in (x, y))
            seen = np.stack(
                [np.einsum("cd,cd->c", by_x @ coefficients, by_y) for coefficients in (value, *slopes)], axis=-1
            )
            here, gradient = seen[:, 0] - covered, seen[:, 1:] / fields.half - slope
            gradient = gradient - outward * np.maximum(np.sum(gradient * outward, axis=1, keepdims=True), 0.0)
            curved = reach @ np.array([[xx, xy], [xy, yy]]) @ reach + bend * np.sum((reach * fields.half) ** 2)
            return here, here + np.abs(gradient) @ (reach * fields.half) + curved / 2

        count = np.maximum(np.ceil(BOXES * fields.half / fields.half.max()), 1).astype(int)
        axes = [(2 * np.arange(k) + 1) / k - 1 for k in count]
        centers, half = fields.middle + fields.half * np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2), 1 / count
        best, more, score, limit = least, [np.zeros((0, 2))], [np.zeros(0)], region.boundary.radius - inset
        for level in range(LEVELS):
            radius = float(np.hypot(*(half * fields.half)))
            centers = centers[region.boundary.depth(centers) >= inset - radius]
            if not len(centers):
                return best + tolerance, more[0]
            self.boxes += len(centers)
            (here, upper), inner = at(centers, half, 0 * centers), region.boundary.project(centers, region.inset)
            moved = np.any(inner != centers, axis=1)
            here[moved] = at(inner[moved], 0 * half, 0 * inner[moved])[0]
            # At the edge, u may be largest where it still grows outward.
            offset = centers - region.boundary.center
            distance = np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-12)
            rim = region.boundary.center + offset / distance * limit
            crossing = (distance[:, 0] + radius > limit) & np.all(np.abs(rim - fields.middle) <= fields.half, axis=1)
            from_edge = at(rim[crossing], half + radius / fields.half, (offset / distance)[crossing])[1]
            upper[crossing] = np.minimum(upper[crossing], from_edge)
            inside = region.boundary.depth(inner) >= inset
            inner, here = inner[inside], here[inside]
            best = max(best, float(here.max(initial=-np.inf)))
            more.append(inner[here > least + tolerance])
            score.append(here[here > least + tolerance])
            left = upper > best + tolerance
            if not left.any() or level == LEVELS - 1 or 4 * left.sum() > MOST_BOXES:
                break
            half = half / 2
            offsets = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * half * fields.half
            centers = (centers[left, None] + offsets).reshape(-1, 2)
        peaks, scores = np.concatenate(more), np.concatenate(score)
        peaks, scores = (values[_in_wedge(peaks, len(self.turns))] for values in (peaks, scores))
        chosen = _apart(peaks, scores, least, self.pitch / 20)
        return max(best + tolerance, float(upper.max()), 0.0), peaks[chosen]


class _Program:
    """Linear programs whose multipliers give a bound; values are in units of that of the layout, A^-2 in its own."""

    def __init__(self, objective: TraceObjective, rooms: Sequence[Room], degree: int, value: float) -> None:
        self.worth, self.square = _Worth(objective), value**2
        fields = [_Fields(room, degree) for room in rooms]
        self.start = sum((part.layout_information() for part in fields), np.zeros(()))
        self.first = self.worth.sensitivity(self.start, 0.1) * self.square
        self.parts = [_RoomBound(part, self.first, len(rooms)) for part in fields]
        self.n = sum(part.n for part in self.parts)

    @property
    def accurate(self) -> bool:
        """True if the error of the interpolation is far below the gaps that matter."""
        return sum(part.n * part.fields.error(self.first) for part in self.parts) < ACCURATE

    def solve(self, progress: Progress | None) -> float:
        """Upper bound of A^-2 for the dots of all rooms, in units of the layout's."""
        parts, measure, cuts, work = self.parts, self.start, list[Array](), 0
        best, since = np.inf, 0
        for done in range(ROUNDS):
            if progress:
                progress("lower bound", done, ROUNDS)
            cuts.append(self.worth.sensitivity(measure, max(0.1 * 0.8**done, SOFTNESS)) * self.square)
            seen = [np.array([part.at_places(cut) for cut in cuts]) for part in parts]
            weights, shares, prices = self._linear_program(seen)
            work += (len(cuts) + sum(len(part.caps) for part in parts)) * sum(int(part.column.sum()) for part in parts)
            cut = shares @ cuts
            around = [part.rotated(part.caps[mu > 0], mu[mu > 0]) for part, mu in zip(parts, prices, strict=True)]
            excess = [
                shares @ at - _cap(part.places, *near, part.pitch, 0.0)[0]
                for part, at, near in zip(parts, seen, around, strict=True)
            ]
            least = [float(u[part.column].max()) for part, u in zip(parts, excess, strict=True)]
            paid = sum(float(mu.sum()) for mu in prices)
            bound = paid + sum(part.n * max(float(u.max()), 0.0) for part, u in zip(parts, excess, strict=True))
            before, more, since = best, [np.zeros((0, 2)) for _ in parts], since + 1
            if bound - 1 < (best - 1) * NOTICEABLE:
                tolerance, judged = max(CLOSE / 2, (bound - 1) / 20) / self.n, paid
                for k, part in enumerate(parts):
                    highest, more[k] = part.highest(cut, *around[k], least[k], tolerance)
                    judged += part.n * (highest + part.fields.error(cut))
                best = min(best, float(judged))
                since = 0 if best - 1 < (before - 1) * NOTICEABLE else since + TRIED - 1
            crowded = [part.crowded(w) for part, w in zip(parts, weights, strict=True)]
            reached = 1.0 if any(map(len, crowded)) else self.worth.worth(measure) * self.square
            boxes = sum(part.boxes for part in parts)
            if is_due() or best < reached + CLOSE or since >= PATIENCE or work > WORK or boxes > BOXES_IN_ALL:
                break
            target = sum((part.information(w) for part, w in zip(parts, weights, strict=True)), np.zeros(()))
            measure = max((measure + step * (target - measure) for step in STEPS), key=self.worth.worth)
            for part, *shortfall in zip(parts, weights, excess, least, crowded, more, strict=True):
                part.extend(*shortfall)
        if progress:
            progress("lower bound", ROUNDS, ROUNDS)
        return best

    def _linear_program(self, seen: Sequence[Array]) -> tuple[list[Array], Array, list[Array]]:
        """Weights (C,) of the places of each room, shares of the bounds with sum 1, and multipliers of the caps.

        They maximize the smallest bound over the weights of the places in columns.
        """
        from scipy.linalg import block_diag
        from scipy.optimize import linprog
        from scipy.sparse import csc_array

        parts, count = self.parts, len(seen[0])
        columns = [np.flatnonzero(part.column) for part in parts]
        # At most n in total: where dots are jammed, places for exactly n would make the multipliers huge.
        rows = np.concatenate(
            [
                -np.concatenate([at[:, column] for at, column in zip(seen, columns, strict=True)], axis=1),
                block_diag(*(part.cover() for part in parts)),
                block_diag(*(np.ones((1, len(column))) for column in columns)),
            ]
        )
        rest = np.zeros(len(rows) - count)
        most = np.concatenate([np.zeros(count), np.ones(len(rest) - len(parts)), [part.n for part in parts]])
        result = linprog(
            np.append(np.zeros(rows.shape[1]), -1.0),
            csc_array(np.column_stack([rows, np.append(np.ones(count), rest)])),
            most,
            bounds=[(0, None)] * rows.shape[1] + [(None, None)],
            # In round rooms the programs are degenerate, and the simplex method takes seven times as long.
            method="highs-ipm",
        )
        weights = [np.where(np.arange(len(part.places)) < part.n, 1.0, 0.0) for part in parts]
        if result.x is None:
            # The solver stopped early, on a degenerate program: any multipliers are valid, such as those without caps.
            return weights, np.eye(count)[0], [np.zeros(len(part.caps)) for part in parts]
        ends = np.cumsum([len(column) for column in columns])
        for w, column, values in zip(weights, columns, np.split(result.x[:-1], ends[:-1]), strict=True):
            w[:] = 0.0
            w[column] = np.maximum(values, 0.0)
        prices = np.maximum(-result.ineqlin.marginals, 0.0)
        shares, ends = prices[:count], count + np.cumsum([len(part.caps) for part in parts])
        return weights, shares / shares.sum(), np.split(prices[: ends[-1]], [count, *ends[:-1]])[1:]


def _in_wedge(places: Array, count: int) -> Mask:
    """Mask (C,) of places (C, 2) that represent all when turned by multiples of a full turn / `count`."""
    angle = np.arctan2(places[:, 1], places[:, 0]) % (2 * np.pi)
    return np.asarray((angle < 2 * np.pi / count) | (count == 1))


def _derivative(coefficients: Array, axis: int) -> Array:
    """Chebyshev coefficients (d + 1, d + 1) of the derivative of a polynomial with these, by one coordinate."""
    return np.pad(chebyshev.chebder(coefficients, axis=axis), ((0, axis == 0), (0, axis == 1)))


def _cap(places: Array, caps: Array, prices: Array, pitch: float, radius: float) -> tuple[Array, Array, Array]:
    """Sum of caps at places, its gradient, and the largest curvature of its negative within a radius."""
    if not len(caps):
        return np.zeros(len(places)), np.zeros((len(places), 2)), np.zeros(len(places))
    if len(places) > AT_ONCE:
        halves = [_cap(half, caps, prices, pitch, radius) for half in np.array_split(places, 2)]
        value, slope, bend = (np.concatenate(parts) for parts in zip(*halves, strict=True))
        return value, slope, bend
    from scipy.spatial import cKDTree

    delta = _ramp(pitch)
    pairs = cKDTree(places).sparse_distance_matrix(cKDTree(caps), pitch / 2 + delta + radius, output_type="ndarray")
    i, j, distance = pairs["i"], pairs["j"], pairs["v"]
    along = np.clip((distance - pitch / 2) / delta, -1.0, 1.0)
    steep = prices[j] * (np.abs(along) - 1) / (delta * np.maximum(distance, 1e-12))
    # Beyond half the pitch, the negative of a cap bends upward only around its center, by at most 2 / (pitch delta).
    bends = np.where(distance - pitch / 2 < radius, 1.0, 2 * _ramp(1.0))
    ramp = bends * (np.abs(distance - pitch / 2) < delta + radius)

    def total(parts: Array) -> Array:
        return np.bincount(i, parts, len(places)).astype(float)

    return (
        total(prices[j] * (0.5 - along + along * np.abs(along) / 2)),
        np.stack([total(steep * component) for component in (places[i] - caps[j]).T], axis=-1),
        total(prices[j] * ramp) / delta**2,
    )


def _overlap(caps: Array, places: Array, pitch: float) -> Array:
    """Values phi (K, C) of places (C, 2) in caps around (K, 2)."""
    if not len(caps):
        return np.zeros((0, len(places)))
    distance = np.hypot(caps[:, None, 0] - places[:, 0], caps[:, None, 1] - places[:, 1])
    along = np.clip((distance - pitch / 2) / _ramp(pitch), -1.0, 1.0)
    return 0.5 - along + along * np.abs(along) / 2


def _ramp(pitch: float) -> float:
    """delta, see the module."""
    return pitch * (1 / np.sqrt(3) - 0.5)


def _apart(places: Array, score: Array, least: float, apart: float) -> Index:
    """Indices of places with a score above the least, the highest first, none closer than `apart` to another."""
    order = np.flatnonzero(score > least)
    order = order[np.argsort(-score[order], kind="stable")]
    chosen: list[int] = []
    while len(order) and len(chosen) < MORE:
        chosen.append(int(order[0]))
        order = order[np.linalg.norm(places[order] - places[order[0]], axis=-1) > apart]
    return np.array(chosen, dtype=np.int64)


def candidates_of(region: FeasibleRegion, thinning: int) -> Array:
    """Places (C, 2) in m on the edge of a region and inside, one for `thinning` of `EDGE` and of `INSIDE`."""
    boundary = region.boundary
    rings = boundary.outlines()
    around = sum(float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=-1).sum()) for ring in rings)
    edge = []
    for ring in rings:
        step = np.roll(ring, -1, axis=0) - ring
        parts = np.ceil(np.linalg.norm(step, axis=-1) * EDGE / thinning / around).astype(int)
        edge += [a + np.arange(k)[:, None] / k * d for a, d, k in zip(ring, step, np.maximum(parts, 1), strict=True)]
    low, high = np.concatenate(rings).min(axis=0), np.concatenate(rings).max(axis=0)
    pitch = np.sqrt(boundary.area * thinning / INSIDE)
    x, y = (np.arange(a + pitch / 2, b, pitch) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = grid[boundary.depth(grid) >= region.inset]
    candidates = np.concatenate([boundary.project(np.concatenate(edge), region.inset), grid])
    return candidates[boundary.depth(candidates) >= region.inset - _SLACK]
