"""Goals: the criterion that a design minimizes, or a weighted sum, bounds on others, or an error to reach."""
# tests: tests/optimize/test_goals.py tests/model/test_target.py

import re
from dataclasses import dataclass

from markergen.errors import InputError, brief
from markergen.units import format_length, parse_length

_NUMBER, _NAME = r"(\d+\.?\d*|\.\d+)", r"([A-Za-z][\w.-]*)"
_TERM = re.compile(rf"(?:{_NUMBER}\s+)?{_NAME}")
_DECIMAL = re.compile(r"(\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LIMIT = re.compile(rf"{_NAME}\s*<=\s*(?:{_NUMBER}\s*)?(\w+|%)?")

NGON = "ngon"
"""Unit of a limit that is a multiple of the regular polygon's value."""


@dataclass(frozen=True)
class Limit:
    """Largest value of a criterion.

    Attributes
    ----------
    name : str
        Criterion.
    most : float
        Limit in the unit, above 0.
    unit : str
        ``ngon`` for multiples of the regular polygon's value; else that of the printed table, or empty for the same.
    """

    name: str
    most: float
    unit: str

    def __str__(self) -> str:
        number = "" if (self.most, self.unit) == (1.0, NGON) else f"{self.most:.9g}"
        return " ".join(filter(None, [self.name, "<=", number, self.unit]))


@dataclass(frozen=True)
class Goal:
    """What a design minimizes.

    Attributes
    ----------
    terms : tuple of (float, str)
        Weights and criteria. Of several, each is relative to that of the regular polygon.
    limits : tuple of Limit
        Bounds on criteria.
    """

    terms: tuple[tuple[float, str], ...]
    limits: tuple[Limit, ...] = ()

    @property
    def lead(self) -> str:
        """The first criterion, which stands for the goal where a single one is needed."""
        return self.terms[0][1]

    @property
    def names(self) -> tuple[str, ...]:
        """All criteria, the first one first."""
        return tuple(dict.fromkeys([*(name for _, name in self.terms), *(limit.name for limit in self.limits)]))

    @property
    def plain(self) -> bool:
        """True if it is a single criterion without bounds."""
        return len(self.terms) == 1 and not self.limits

    @property
    def relative(self) -> bool:
        """True if it refers to the regular polygon."""
        return len(self.terms) > 1 or any(limit.unit == NGON for limit in self.limits)

    def __str__(self) -> str:
        terms = (name if weight == 1 else f"{weight:.9g} {name}" for weight, name in self.terms)
        return ", ".join([self.lead if len(self.terms) == 1 else " + ".join(terms), *map(str, self.limits)])


def parse_goal(text: str) -> Goal:
    """Parse ``pose``, ``pose + 0.5 rotation``, or either with bounds: ``pose, rotation <= 1.05 ngon``.

    A semicolon may stand for a comma, and < for <=. Whether the criteria exist is not checked.

    Raises
    ------
    InputError
        If the text has another form, or a number is not above 0.

    Examples
    --------
    >>> str(parse_goal("pose,rotation<=ngon, homography <= 2px"))
    'pose, rotation <= ngon, homography <= 2 px'
    >>> str(parse_goal("pose; blunder < 2 mm"))
    'pose, blunder <= 2 mm'
    >>> parse_goal("pose + 0.5 rotation").terms
    ((1.0, 'pose'), (0.5, 'rotation'))
    """
    if not re.search(r"[\s,;+<>=]", text):
        return Goal(((1.0, text),))
    first, *rest = (re.sub("<(?!=)", "<=", part.strip()) for part in re.split("[,;]", text))
    terms = [_TERM.fullmatch(part.strip()) for part in first.split("+")]
    limits = [_LIMIT.fullmatch(part) for part in rest]
    goal = Goal(
        tuple((float(term[1] or 1), term[2]) for term in terms if term),
        tuple(Limit(limit[1], float(limit[2] or 1), limit[3] or "") for limit in limits if limit),
    )
    # A limit without a number is the polygon itself.
    bare = any(limit and not limit[2] and limit[3] != NGON for limit in limits)
    numbers = [*(weight for weight, _ in goal.terms), *(limit.most for limit in goal.limits)]
    if None in terms or None in limits or bare or not all(0 < number < 1e9 for number in numbers):
        raise InputError(
            "a criterion, or a weighted sum, and bounds on others",
            f"objective={brief(text)}",
            "write for example pose, or 'pose + 0.5 rotation', or 'pose, rotation <= 1.05 ngon, homography <= 2 px'",
        )
    return goal


@dataclass(frozen=True)
class Target:
    """RMS error of the pose over the poses at one distance, flips included.

    Attributes
    ----------
    error : float
        In degrees for a rotation, in m for a translation.
    angle : bool
        True for the rotation.
    distance : float, m
    """

    error: float
    angle: bool
    distance: float

    def words(self, error: float) -> str:
        """Return an error of this kind with its unit."""
        return f"{error:.3g} deg" if self.angle else format_length(float(f"{error:.3g}"))

    def __str__(self) -> str:
        error = f"{self.error:.9g}deg" if self.angle else f"{1e3 * self.error:.9g}mm"
        return f"{error}@{self.distance:.9g}m"


def parse_target(text: str) -> Target:
    """Parse a target such as ``0.1deg@1.5m`` or ``1mm@1.5m``.

    Raises
    ------
    InputError
        If it is not an angle in degrees or a length, ``@``, and a length, all above 0.

    Examples
    --------
    >>> parse_target("0.1deg@1.5m"), str(parse_target("1 mm @ 150cm"))
    (Target(error=0.1, angle=True, distance=1.5), '1mm@1.5m')
    """
    error, at, place = text.partition("@")
    number = error.strip().removesuffix("deg").strip()
    angle = error.strip().endswith("deg")
    try:
        distance = parse_length(place) if at else 0.0
        size = float(number) if angle and _DECIMAL.fullmatch(number) else 0.0 if angle else parse_length(error)
    except InputError:
        distance = size = 0.0
    if not (0 < size < 1e6 and 0 < distance < 1e6):
        raise InputError("an error above 0 at a distance", brief(text), "write for example 0.1deg@1.5m or 1mm@1.5m")
    return Target(size, angle, distance)
