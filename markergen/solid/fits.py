"""Fits of round parts by ISO 286 on the basis of the shaft: the disc has its dot's size, and the pocket is fitted."""

from dataclasses import dataclass

from markergen.errors import InputError

STEPS = (3, 6, 10, 18, 30, 50, 80, 120, 180, 250, 315, 400, 500)
"""Ranges of nominal sizes, each up to and with this many mm (ISO 286-1, table 1)."""

H6 = (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40)
H7 = (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63)
"""Tolerances of a shaft h6 and h7 in um: from the nominal size down."""

F8 = tuple(zip((6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
               (20, 28, 35, 43, 53, 64, 76, 90, 106, 122, 137, 151, 165), strict=True))  # fmt: skip
P7 = tuple(zip((-16, -20, -24, -29, -35, -42, -51, -59, -68, -79, -88, -98, -108),
               (-6, -8, -9, -11, -14, -17, -21, -24, -28, -33, -36, -41, -45), strict=True))  # fmt: skip
"""Least and largest deviation of a hole F8 and P7 in um (ISO 286-2)."""


@dataclass(frozen=True)
class Fit:
    """A disc in a pocket of one nominal diameter.

    Attributes
    ----------
    disc, pocket : str
        Class with its deviations, such as ``h7 (0 / -0.025 mm)``.
    gap : float
        Between them all around where the clearance is least, mm; 0 where there is interference.
    play : float
        How far the disc may lie off the middle at most, mm.
    """

    disc: str
    pocket: str
    gap: float
    play: float


def fit(kind: str, diameter: float) -> Fit:
    """F8/h7 (slip) or P7/h6 (press) for a diameter in mm.

    Raises
    ------
    InputError
        If it is larger than 500 mm, where ISO 286-2 has other tables.
    """
    if diameter > STEPS[-1]:
        raise InputError(
            f"discs of at most {STEPS[-1]} mm for a fit of ISO 286", f"{diameter:.6g} mm", "use --process laser"
        )
    i = next(i for i, most in enumerate(STEPS) if diameter <= most)
    if kind == "press":
        return Fit(f"h6 (0 / {_mm(-H6[i])} mm)", f"P7 ({_mm(P7[i][1])} / {_mm(P7[i][0])} mm)", 0.0, 0.0)
    low, high = F8[i]
    return Fit(f"h7 (0 / {_mm(-H7[i])} mm)", f"F8 ({_mm(high)} / {_mm(low)} mm)", low / 2e3, (high + H7[i]) / 2e3)


def _mm(micrometers: int) -> str:
    return f"{micrometers / 1e3:+.3f}"
