"""Targets: an error that a marker is to reach at a distance."""

import re
from dataclasses import dataclass

from markergen.errors import InputError, brief
from markergen.units import format_length, parse_length

_NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


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
        size = float(number) if angle and _NUMBER.fullmatch(number) else 0.0 if angle else parse_length(error)
    except InputError:
        distance = size = 0.0
    if not (0 < size < 1e6 and 0 < distance < 1e6):
        raise InputError("an error above 0 at a distance", brief(text), "write for example 0.1deg@1.5m or 1mm@1.5m")
    return Target(size, angle, distance)
