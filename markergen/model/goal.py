"""Goals: the criterion that a design minimizes, or a weighted sum of several, and bounds on others."""
# tests: tests/optimize/test_goals.py

import re
from dataclasses import dataclass

from markergen.errors import InputError, brief

_NUMBER, _NAME = r"(\d+\.?\d*|\.\d+)", r"([A-Za-z][\w.-]*)"
_TERM = re.compile(rf"(?:{_NUMBER}\s+)?{_NAME}")
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

    Whether the criteria exist is not checked.

    Raises
    ------
    InputError
        If the text has another form, or a number is not above 0.

    Examples
    --------
    >>> str(parse_goal("pose,rotation<=ngon, homography <= 2px"))
    'pose, rotation <= ngon, homography <= 2 px'
    >>> parse_goal("pose + 0.5 rotation").terms
    ((1.0, 'pose'), (0.5, 'rotation'))
    """
    if not re.search(r"[\s,+<>=]", text):
        return Goal(((1.0, text),))
    first, *rest = (part.strip() for part in text.split(","))
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
