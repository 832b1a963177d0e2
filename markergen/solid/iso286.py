"""ISO 286 tolerances of a disc and its hole: F8/h7 for a slip fit and P7/h6 for a press fit.

The fits are shaft-based: the disc has the nominal diameter of its dot, and the hole's deviations determine the fit.
"""

from dataclasses import dataclass

from markergen.errors import InputError

STEPS = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
"""Upper limits in mm of the ranges of nominal sizes, inclusive (ISO 286-1, table 1)."""

H6 = (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40)
H7 = (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63)
"""Tolerances of a shaft h6 and h7 in um, below the nominal size, for each range."""

F8 = tuple(zip((6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
               (20, 28, 35, 43, 53, 64, 76, 90, 106, 122, 137, 151, 165), strict=True))  # fmt: skip
P7 = tuple(zip((-16, -20, -24, -29, -35, -42, -51, -59, -68, -79, -88, -98, -108),
               (-6, -8, -9, -11, -14, -17, -21, -24, -28, -33, -36, -41, -45), strict=True))  # fmt: skip
"""Lower and upper deviation of a hole F8 and P7 in um (ISO 286-2), for each range."""


@dataclass(frozen=True)
class DiscFit:
    """Tolerances of a disc and of its pocket at one nominal diameter.

    Attributes
    ----------
    disc, pocket : str
        Tolerance class with its deviations, such as ``h7 (0 / -0.025 mm)``.
    gap : float
        Minimum clearance on each side, mm; 0 for an interference fit.
    play : float
        Maximum distance between the centers of disc and pocket, mm.
    """

    disc: str
    pocket: str
    gap: float
    play: float


def disc_fit(kind: str, diameter: float) -> DiscFit:
    """Look up F8/h7 (``slip``) or P7/h6 (``press``) for a diameter in mm.

    Raises
    ------
    InputError
        If the diameter exceeds 500 mm, the end of these tables.
    """
    if diameter > STEPS[-1]:
        raise InputError(
            f"discs of at most {STEPS[-1]} mm for a fit of ISO 286", f"{diameter:.6g} mm", "use --process laser"
        )
    i = next(i for i, most in enumerate(STEPS) if diameter <= most)
    if kind == "press":
        return DiscFit(f"h6 (0 / {_mm(-H6[i])} mm)", f"P7 ({_mm(P7[i][1])} / {_mm(P7[i][0])} mm)", 0.0, 0.0)
    low, high = F8[i]
    return DiscFit(f"h7 (0 / {_mm(-H7[i])} mm)", f"F8 ({_mm(high)} / {_mm(low)} mm)", low / 2e3, (high + H7[i]) / 2e3)


def _mm(micrometers: int) -> str:
    return f"{micrometers / 1e3:+.3f}"
