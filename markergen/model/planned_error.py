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
        return f"{degrees(self.rotation_deg)} and {amount(self.translation_mm)} mm"

    @property
    def reach(self) -> str:
        """Distances that they hold at, such as ``at up to 1.5 m``."""
        return f"at up to {self.distance:.2g} m"

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
    return f"{float(f'{value:.4g}'):#.{digits}g}".rstrip(".")


def degrees(value: float) -> str:
    """Format a first-order rotation error, unless it is beyond what first order holds for.

    >>> degrees(0.332), degrees(128.9)
    ('0.33 deg', 'an undetermined rotation')
    """
    return f"{amount(value)} deg" if value <= LINEAR_DEG else "an undetermined rotation"
