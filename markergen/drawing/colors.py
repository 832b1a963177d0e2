"""Colors of a sheet as data: ink, paper and cut, each `#rrggbb` or a named spot color for a cutter."""

import re
from dataclasses import dataclass

from markergen.errors import InputError

HEX = re.compile(r"#[0-9a-f]{6}")
SPOT = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]*")
MAGENTA = "#ff00ff"
"""Default screen color of a spot color: the signal color shown by cutters' software."""
LEAST_CONTRAST = 64
"""Minimum difference of ink and paper, of 255 grey levels, at which a camera reliably tells a dot from its ground."""
FORMS = "black, inverted or #rrggbb,#rrggbb (ink,paper), optionally followed by ,cut:NAME or ,cut:#rrggbb"


def spot_name(color: str) -> str | None:
    """Name of a spot color; None for any other."""
    name, equals, _ = color.rpartition("=")
    return name if equals else None


def rgb(color: str) -> str:
    """Screen color ``#rrggbb`` of any color, including spot colors."""
    return color.rpartition("=")[2]


def channels(color: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255."""
    red, green, blue = bytes.fromhex(rgb(color).removeprefix("#"))
    return red, green, blue


def is_grey(color: str) -> bool:
    """True if red, green and blue are equal."""
    return len(set(channels(color))) == 1


def luma(color: str) -> float:
    """Grey level, 0 to 255, seen by a monochrome camera (Rec. 601)."""
    red, green, blue = channels(color)
    return 0.299 * red + 0.587 * green + 0.114 * blue


@dataclass(frozen=True)
class Colors:
    """Colors of a sheet.

    Attributes
    ----------
    ink, paper : str
        Color of dots, tag and marks, and of the ground under them: ``#rrggbb``.
    cut : str
        Color of the lines for a cutter: ``#rrggbb``, or a spot color in the format of `spot_color`.

    Raises
    ------
    InputError
        If a color is not ``#rrggbb``, or the contrast between ink and paper is too low.
    """

    ink: str = "#000000"
    paper: str = "#ffffff"
    cut: str = "#9a9a9a"

    def __post_init__(self) -> None:
        for color in (self.ink, self.paper, rgb(self.cut)):
            if not HEX.fullmatch(color):
                raise InputError("a color #rrggbb", repr(color), "write six hexadecimal digits, as in #1a2b3c")
        if abs(luma(self.ink) - luma(self.paper)) < LEAST_CONTRAST:
            raise InputError(
                f"ink and paper at least {LEAST_CONTRAST} of 255 grey levels apart",
                f"{self.ink} on {self.paper}, {abs(luma(self.ink) - luma(self.paper)):.0f} apart",
                "choose a darker ink or a lighter paper",
            )

    @property
    def inverted(self) -> bool:
        """True if dots are lighter than their ground."""
        return luma(self.ink) > luma(self.paper)

    @property
    def grounded(self) -> bool:
        """True if the ground must be printed because the paper is not white."""
        return self.paper != "#ffffff"

    def mix(self, share: float) -> str:
        """Color between paper (0) and ink (1), for marks that must be less prominent than the dots."""
        parts = zip(channels(self.ink), channels(self.paper), strict=True)
        return "#" + "".join(f"{round(share * ink + (1 - share) * paper):02x}" for ink, paper in parts)


BLACK_ON_WHITE = Colors()
INVERTED = Colors("#ffffff", "#000000")


def parse_colors(text: str) -> Colors:
    """Parse ``black``, ``inverted`` or ``#ink,#paper``, each optionally followed by ``,cut:NAME`` or ``,cut:#rrggbb``.

    Raises
    ------
    InputError
        If it is none of these, or the contrast between ink and paper is too low.

    Examples
    --------
    >>> parse_colors("#202020,#ffffff,cut:CutContour")
    Colors(ink='#202020', paper='#ffffff', cut='CutContour=#ff00ff')
    """
    first, *rest = (part.strip() for part in text.split(","))
    cut = rest.pop()[len("cut:") :].strip() if rest and rest[-1].lower().startswith("cut:") else None
    named = {"black": BLACK_ON_WHITE, "inverted": INVERTED}.get(first.lower())
    if named and not rest:
        ink, paper = named.ink, named.paper
    elif HEX.fullmatch(first.lower()) and len(rest) == 1 and HEX.fullmatch(rest[0].lower()):
        ink, paper = first.lower(), rest[0].lower()
    else:
        raise InputError("colors", repr(text), f"write {FORMS}")
    if cut is None:
        return Colors(ink, paper)
    if HEX.fullmatch(cut.lower()):
        return Colors(ink, paper, cut.lower())
    return Colors(ink, paper, spot_color(cut))


def spot_color(name: str, look: str = MAGENTA) -> str:
    """Encode a spot color as ``NAME=#rrggbb``: the name for the cutter, and the screen color elsewhere.

    Raises
    ------
    InputError
        If the name is empty, longer than 40 characters, or has characters other than letters, digits, blanks, ``_.-``.
    """
    if not SPOT.fullmatch(name) or len(name) > 40:
        raise InputError(
            "the name of a spot color, at most 40 letters, digits, blanks, _ . -", repr(name), "as in CutContour"
        )
    return f"{name}={look}"
