"""``cone``: poses from ranges of distance, tilt, azimuth and roll, whose camera looks at the marker's origin."""
# tests: tests/model/test_poses.py tests/read/test_poses.py

from dataclasses import dataclass, fields, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.maths.rotation import exponential, rotation_z
from markergen.model.poses import POSES, PoseDistribution, PoseSource, pose_arguments
from markergen.units import parse_length

Range = tuple[float, float]

FORM = "cone:distance=A..B,tilt=A..B,azimuth=A..B,roll=A..B,count=N,seed=S,sampling=even|random,weight=1/distance"
MOST_POSES = 10_000
"""Largest count; time and memory of a design grow with it."""

SAMPLINGS = ("even", "random")
WEIGHTS = {"1": 0, "1/distance": 1, "1/distance^2": 2}
"""Powers of the distance by whose inverse a pose counts."""

_LARGEST_DISTANCE = 1e6
"""Largest distance in m; beyond it, a unit or an exponent is wrong."""
_LIMITS = {"tilt": (0.0, 90.0), "azimuth": (-360.0, 720.0), "roll": (-360.0, 720.0)}


@dataclass(frozen=True)
class Cone:
    """Poses whose camera looks straight at the marker's origin, from a part of a spherical shell around it.

    The camera's center is d (cos a sin p, sin a sin p, cos p) in the marker frame, with distance d, tilt p (0 is
    frontal) and azimuth a (0 is the marker's x axis, 90 its y axis). Directions are uniform over the solid angle, that
    is cos p and a are uniform; d and the roll are uniform. At roll 0 the frontal upright camera, R = diag(1, -1, -1),
    is swung there along the great circle without turning about its line of sight; the roll then turns the image
    clockwise.

    Attributes
    ----------
    distance : (float, float)
        Least and greatest distance in m.
    tilt, azimuth, roll : (float, float)
        Least and greatest angle in degrees. What is not given is free: tilt up to 70 degrees as in the paper's poses,
        azimuth and roll all around.
    count : int
        Number of poses, 1 to 10000.
    seed : int
        Of the shift of the ``even`` sequence, or of the ``random`` numbers.
    sampling : str
        ``even``: the additive recurrence u_k = u_0 + k (1/g, 1/g^2, ...) mod 1, g the root of g^(D+1) = g + 1 for D
        ranges that have a width (Roberts' R sequence, of low discrepancy for any count). ``random``: independent.
    weight : str
        How much a pose counts in what is minimized: ``1``, ``1/distance``, as much as if the logarithm of the distance
        were uniform, or ``1/distance^2``.

    Raises
    ------
    InputError
        If a range is not in rising order or within its limits, or a value is not one of those above.
    """

    distance: Range = (0.6, 1.5)
    tilt: Range = (0.0, 70.0)
    azimuth: Range = (0.0, 360.0)
    roll: Range = (0.0, 360.0)
    count: int = 400
    seed: int = 0
    sampling: str = "even"
    weight: str = "1"

    def __post_init__(self) -> None:
        for name in ("distance", *_LIMITS):
            low, high = getattr(self, name)
            if not (isfinite(low) and isfinite(high) and low <= high):
                raise InputError(
                    f"a range of {name} in rising order",
                    f"{name}={_text(low)}..{_text(high)}",
                    "write the smaller end first; an arc across 0 is such as azimuth=-30..30",
                )
        if not (self.distance[0] > 0 and self.distance[1] <= _LARGEST_DISTANCE):
            raise InputError(
                "distances above 0, of at most 1000 km",
                f"distance={_range(self.distance)} m",
                "write such as distance=0.5..2 or 500mm..2m",
            )
        for name, (least, greatest) in _LIMITS.items():
            low, high = getattr(self, name)
            if not (least <= low and high <= greatest and high - low <= 360) or (name == "tilt" and high >= greatest):
                allowed = "from 0 to below 90" if name == "tilt" else "of at most a whole turn between -360 and 720"
                raise InputError(
                    f"values of {name} {allowed} degrees", f"{name}={_range((low, high))}", "correct the range"
                )
        if not 1 <= self.count <= MOST_POSES:
            raise InputError(f"a count of 1 to {MOST_POSES} poses", f"count={brief(self.count)}", "correct the count")
        if not 0 <= self.seed < 2**63:
            raise InputError("a seed from 0 to below 2^63", f"seed={brief(self.seed)}", "give such a whole number")
        for name, choices in (("sampling", SAMPLINGS), ("weight", WEIGHTS)):
            if getattr(self, name) not in choices:
                value = getattr(self, name)
                raise InputError(f"a known {name}", brief(value), among(value, choices))

    @staticmethod
    def parse(text: str) -> "Cone":
        """Cone of a text such as ``cone:distance=0.4..1m,tilt=40..70,azimuth=-15..15,count=200``.

        A single value stands for a range without a width. Lengths have units, a bare number is meters; the unit of
        the second end holds for both, unless the first could be meters. Angles are in degrees.

        Raises
        ------
        InputError
            If the text does not have this form, or as the class says.
        """
        arguments: dict[str, Any] = {
            key: _value(key, value)
            for key, value in pose_arguments(text, [field.name for field in fields(Cone)], FORM).items()
        }
        return Cone(**arguments)

    def __str__(self) -> str:
        """Text that `parse` reads back, the same for equal cones; all values stand there but a weight of 1."""
        ranges = (f"{name}={_range(getattr(self, name))}" for name in ("distance", *_LIMITS))
        weight = f",weight={self.weight}" if self.weight != "1" else ""
        return f"cone:{','.join(ranges)},count={self.count},seed={self.seed},sampling={self.sampling}{weight}"

    def sample(self) -> tuple[Array, Array]:
        """Rotation (count, 3, 3) and translation (count, 3) in m of the poses T_camera_marker."""
        cube = np.zeros((self.count, 4))
        wide = [low != high for low, high in (self.distance, self.tilt, self.azimuth, self.roll)]
        cube[:, wide] = self._unit_cube(sum(wide))
        return self.at(cube)

    def at(self, cube: Array) -> tuple[Array, Array]:
        """Rotation and translation of the poses at points (P, 4) of the unit cube: distance, tilt, azimuth, roll."""
        cosines = tuple(np.cos(np.deg2rad(self.tilt)))
        low, high = np.array([self.distance, cosines, self.azimuth, self.roll]).T
        distance, cosine, azimuth, roll = (low + cube * (high - low)).T
        azimuth, tilt = np.deg2rad(azimuth), np.arccos(np.clip(cosine, -1, 1))
        zero = np.zeros_like(azimuth)
        axis = np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=-1)
        # The camera's axes, as columns in the marker frame, are those of the frontal one turned by exp(tilt axis).
        swung = np.diag([1.0, -1.0, -1.0]) @ exponential(-tilt[:, None] * axis)
        return rotation_z(np.deg2rad(roll)) @ swung, np.stack([zero, zero, distance], axis=-1)

    def _unit_cube(self, dimension: int) -> Array:
        """Points (count, dimension) that fill the unit cube."""
        rng = np.random.default_rng(self.seed)
        if self.sampling == "random":
            return rng.random((self.count, dimension))
        return even_points(np.arange(float(self.count)), rng.random(dimension))


def even_points(index: Array, start: Array) -> Array:
    """Points (P, D) of Roberts' R sequence in the unit cube, of these indices (P,), from a start (D,)."""
    golden = 2.0
    for _ in range(60):  # Each time at least twice as near.
        golden = (1 + golden) ** (1 / (len(start) + 1))
    return np.mod(start + index[:, None] * golden ** -np.arange(1.0, len(start) + 1), 1.0)


def _value(key: str, text: str) -> Any:
    if key in ("sampling", "weight"):
        return text
    if key in ("count", "seed"):
        if not (text.isascii() and text.isdigit() and len(text) < 20):
            raise InputError(f"a whole number for {key}", f"{key}={brief(text)}", f"write such as {key}=400")
        return int(text)
    first, dots, second = text.partition("..")
    ends = [first, second] if dots else [first]
    if key != "distance":
        low, *rest = (_degrees(key, end) for end in ends)
        return low, *(rest or [low])
    units = [end.strip().lstrip("-+.0123456789eE").strip() for end in ends]
    low, *rest = (parse_length(end, "distance", inf) for end in ends)
    if len(units) == 2 and "" in units and set(units) - {"", "m"}:
        # 30..80cm is 30 cm; 0.4..800mm may be from 0.4 m, or from 0.4 mm; 6in..15 to 15 m, or to 15 in.
        if units[0] or low < rest[0]:
            raise InputError("a unit at both ends", f"distance={brief(text)}", "write such as distance=600mm..1500mm")
        low = parse_length(first.strip() + units[1], "distance", inf)
    return low, *(rest or [low])


def _degrees(key: str, text: str) -> float:
    try:
        value = float(text.removesuffix("deg")) if "_" not in text else float("nan")
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputError(f"degrees for {key}", f"{key}={brief(text)}", f"write such as {key}=10..60")
    return value


def _text(value: float) -> str:
    # Adding 0.0 takes the sign from a zero, so that equal cones have equal texts.
    return repr(float(value) + 0.0).removesuffix(".0")


def _range(ends: Range) -> str:
    low, high = (_text(end) for end in ends)
    return low if low == high else f"{low}..{high}"


_PLACES = {"cone": "looking straight at it", "sphere": "from all sides", "view": "anywhere in the view"}
_PHRASES = {
    "margin": "{} from its border",
    "distance": "{} m away",
    "tilt": "tilted by {} deg",
    "azimuth": "from {} deg around",
    "roll": "rolled by {} deg",
    "weight": "weighted by {}",
}
"""What texts of poses mean, by the name and by the keys."""


def poses_in_words(name: str) -> str:
    """Where poses are, for people, from their name; full turns, count and seed are left out.

    >>> poses_in_words("view:distance=0.5..1.5,tilt=0..60,azimuth=0..360,margin=5%,count=400")
    'anywhere in the view, 5% from its border, 0.5 to 1.5 m away, tilted by 0 to 60 deg'
    """
    kind, _, arguments = name.partition(":")
    values = dict(item.split("=", 1) for item in arguments.split(",") if "=" in item)
    keys = [key for key in _PHRASES if key in values and values[key] != "0..360"]
    phrases = [_PHRASES[key].format(values[key].replace("..", " to ")) for key in keys]
    return ", ".join([_PLACES[kind], *phrases]) if phrases and kind in _PLACES else name


def _poses(text: str) -> PoseDistribution:
    cone = Cone.parse(text)
    poses = PoseDistribution(str(cone), *cone.sample())
    power = WEIGHTS[cone.weight]
    return replace(poses, weight=poses.distance**-power) if power else poses


POSES.register("cone")(PoseSource(_poses, FORM))
