"""ISO 286 limits of discs, their pockets, and holes: F8/h7 for a slip fit and P7/h6 for a press fit.

The fits are shaft-based: the disc has the nominal diameter of its dot, and the hole's deviations determine the fit. The
core of a ring is the reverse, since the ring's inner edge is what is seen: H8/f7 and H7/p6, which fit alike.
"""

from dataclasses import dataclass

from markergen.errors import InputError

STEPS = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
"""Upper limits in mm of the ranges of nominal sizes, inclusive (ISO 286-1, table 1)."""

H6 = (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40)
"""Width in um of the tolerance grade 6, for each range (ISO 286-1, table 1); a hole H begins at the nominal size."""
H7 = (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63)
"""Of grade 7."""
H8 = (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97)
"""Of grade 8."""
H13 = (140, 180, 220, 270, 330, 390, 460, 540, 630, 720, 810, 890, 970)
"""Of grade 13."""

F8 = tuple(zip((6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
               (20, 28, 35, 43, 53, 64, 76, 90, 106, 122, 137, 151, 165), strict=True))  # fmt: skip
P7 = tuple(zip((-16, -20, -24, -29, -35, -42, -51, -59, -68, -79, -88, -98, -108),
               (-6, -8, -9, -11, -14, -17, -21, -24, -28, -33, -36, -41, -45), strict=True))  # fmt: skip
"""Lower and upper deviation of a hole F8 and P7 in um (ISO 286-2), for each range."""

P6 = (6, 12, 15, 18, 22, 26, 32, 37, 43, 50, 56, 62, 68)
"""Lower deviation of a shaft p6 in um, for each range."""


@dataclass(frozen=True)
class SizeLimits:
    """Tolerance class of a diameter and its deviations; mm.

    Attributes
    ----------
    name : str
        Such as ``h7``.
    diameter : float
        Nominal diameter, which the deviations refer to.
    """

    name: str
    diameter: float
    upper: float
    lower: float

    @property
    def deviations(self) -> str:
        """Both deviations: ``+0.064 / +0.025``."""
        return f"{_signed(self.upper)} / {_signed(self.lower)}"

    @property
    def words(self) -> str:
        """Class and deviations: ``h7 (0 / -0.025)``."""
        return f"{self.name} ({self.deviations})"

    @property
    def least(self) -> float:
        """Smallest diameter."""
        return self.diameter + self.lower

    @property
    def most(self) -> float:
        """Largest diameter."""
        return self.diameter + self.upper


@dataclass(frozen=True)
class DiscFit:
    """Limits of a disc and of its pocket at one nominal diameter.

    Attributes
    ----------
    gap : float
        Minimum clearance on each side, mm; 0 for an interference fit.
    play : float
        Maximum distance between the centers of disc and pocket, mm.
    """

    disc: SizeLimits
    pocket: SizeLimits
    gap: float
    play: float


def disc_fit(kind: str, diameter: float) -> DiscFit:
    """Look up F8/h7 (``slip``) or P7/h6 (``press``) for a diameter in mm.

    Raises
    ------
    InputError
        If the diameter exceeds 500 mm, the end of these tables.
    """
    i = _range(diameter)
    if kind == "press":
        return DiscFit(_limits("h6", diameter, 0, -H6[i]), _limits("P7", diameter, P7[i][1], P7[i][0]), 0.0, 0.0)
    low, high = F8[i]
    return DiscFit(
        _limits("h7", diameter, 0, -H7[i]),
        _limits("F8", diameter, high, low),
        low / 2e3,
        (high + H7[i]) / 2e3,
    )


def core_fit(kind: str, diameter: float) -> DiscFit:
    """Limits of a ring's light core (`disc`) and of the ring's bore (`pocket`): H8/f7 or H7/p6, see `disc_fit`."""
    i, fit = _range(diameter), disc_fit(kind, diameter)
    if kind == "press":
        core, bore = _limits("p6", diameter, P6[i] + H6[i], P6[i]), _limits("H7", diameter, H7[i], 0)
    else:
        least = F8[i][0]
        core, bore = _limits("f7", diameter, -least, -least - H7[i]), _limits("H8", diameter, H8[i], 0)
    return DiscFit(core, bore, fit.gap, fit.play)


CLASSES = {"H6": H6, "H7": H7, "H8": H8, "H13": H13}
"""Tolerance classes of holes that can be asked for."""


def hole_class(name: str, diameter: float) -> SizeLimits:
    """Limits of a hole with one of `CLASSES`; raises as `disc_fit` does."""
    return _limits(name, diameter, CLASSES[name][_range(diameter)], 0)


def _range(diameter: float) -> int:
    if diameter > STEPS[-1]:
        raise InputError(
            f"discs of at most {STEPS[-1]} mm for a fit of ISO 286", f"{diameter:.6g} mm", "use --process laser"
        )
    return next(i for i, most in enumerate(STEPS) if diameter <= most)


def _limits(name: str, diameter: float, upper: int, lower: int) -> SizeLimits:
    return SizeLimits(name, diameter, upper / 1e3, lower / 1e3)


def _signed(millimeters: float) -> str:
    return f"{millimeters:+.3f}" if millimeters else "0"
