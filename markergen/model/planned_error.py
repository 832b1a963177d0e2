"""The error to plan with: the one number that sheets, commands, reports and the studio give for a marker."""
# tests: tests/optimize/test_planned_error.py

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

KEY = "error_to_plan_with"
"""Its key in the provenance of a marker."""

LINEAR_DEG = 30.0
"""Angle in degrees from which on first order says that a rotation is not determined, but not how far off it is: the
tangent differs from the angle by 10 %, at 20 degrees by 4 %."""


LINEAR_SHARE = 0.5
"""Share of the distance from which on the same holds of a translation: the first order of z / (1 + x) is off by a third
of x there, at 0.3 by a fifth."""


@dataclass(frozen=True)
class PlannedError:
    """RMS errors of the pose over all poses of a design, to first order, with image noise and the print's error.

    Attributes
    ----------
    rotation_deg, translation_mm : float
    distance : float
        Distance of the farthest pose, m.
    measured_deg : float or None
        Rotation error once twenty photographs have measured the print; None if the print is no larger source.
    exact : str
        What was taken as exact, such as ``scale and calibration``; empty if nothing was.
    """

    rotation_deg: float
    translation_mm: float
    distance: float
    measured_deg: float | None = None
    exact: str = ""

    @property
    def amounts(self) -> str:
        """Both errors, such as ``0.33 deg and 0.64 mm``."""
        return f"{degrees(self.rotation_deg)} and {millimeters(self.translation_mm, self.distance)}"

    @property
    def reach(self) -> str:
        """Distances that they hold at, such as ``at up to 1.5 m``."""
        return f"at up to {plain(self.distance)} m"

    @property
    def assumed(self) -> str:
        """What they take as exact, such as ``scale and calibration exact``; empty if nothing."""
        return f"{self.exact} exact" if self.exact else ""

    @property
    def conditions(self) -> str:
        """Distances that they hold at, and what they take as exact."""
        return ", ".join(filter(None, (self.reach, self.assumed)))

    @property
    def prospect(self) -> str:
        """`conditions`, and what a measured print gains."""
        if self.measured_deg is None:
            return self.conditions
        gain = f"measure the marker with twenty photographs (markergen calibrate): {degrees(self.measured_deg)}"
        return f"{self.conditions}; {gain}"

    @property
    def sentence(self) -> str:
        """What to plan with, and what a measured print gains."""
        return f"Plan with {self.amounts} {self.prospect}."

    def as_dict(self) -> dict[str, float | str]:
        """Return plain JSON values of four digits."""
        values = {key: value for key, value in asdict(self).items() if value not in (None, "")}
        return {key: value if key == "exact" else float(f"{value:.4g}") for key, value in values.items()}


def planned_error_of(provenance: Mapping[str, Any]) -> PlannedError | None:
    """Return the error that a marker's provenance has; None if it has none, as that of bare points."""
    stored: Any = provenance.get(KEY)
    try:
        return PlannedError(
            exact=str(stored.get("exact", "")), **{k: float(v) for k, v in stored.items() if k != "exact"}
        )
    except (AttributeError, TypeError, ValueError):  # Absent, or written by hand.
        return None


def amount(value: float | None, digits: int = 2) -> str:
    """Format an error with that many significant digits; a missing or infinite one as a word.

    >>> amount(0.18504) == amount(0.185), amount(None)
    (True, 'unbounded')
    """
    if value is None or not isfinite(value):
        return "unbounded"
    # First to the four digits of files: else 0.18504 reads 0.19 where it is computed, and 0.18 where it was stored.
    return plain(float(f"{value:.4g}"), digits, "#")


def plain(value: float, digits: int = 2, zeros: str = "") -> str:
    """Format a number with that many significant digits, large ones without an exponent.

    >>> plain(500.3), plain(0.999), plain(0.999, zeros="#")
    ('500', '1', '1.0')
    """
    rounded = f"{value:{zeros}.{digits}g}".rstrip(".")
    return f"{float(rounded):.0f}" if "e+" in rounded else rounded


def degrees(value: float) -> str:
    """Format a first-order rotation error, unless it is beyond what first order holds for.

    >>> degrees(0.332), degrees(128.9)
    ('0.33 deg', 'an undetermined rotation')
    """
    return f"{amount(value)} deg" if value <= LINEAR_DEG else "an undetermined rotation"


def millimeters(value: float, distance: float) -> str:
    """Format a first-order translation error of poses up to a distance in m, as `degrees` does a rotation.

    >>> millimeters(0.64, 1.5), millimeters(3.8e6, 500.0)
    ('0.64 mm', 'an undetermined position')
    """
    return f"{amount(value)} mm" if value <= 1e3 * LINEAR_SHARE * distance else "an undetermined position"
