"""What a user may choose about sheets: plain data, so that formats without paper load nothing that draws."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markergen.drawing.colors import BLACK_ON_WHITE, Colors
from markergen.drawing.paper import Orientation, Paper
from markergen.errors import InputError

if TYPE_CHECKING:
    from markergen.drawing.furniture import Frame


@dataclass(frozen=True)
class SheetOptions:
    """What a user may choose about sheets; lengths in m.

    Attributes
    ----------
    paper : str or None
        Name or size (`find_paper`); None takes the smallest ISO size from A5 to A0 that holds the marker, for several
        markers from A4 on.
    orientation : {"", "portrait", "landscape"}
        Empty: as the paper's name says; if that says nothing, upright unless only the other way holds the marker.
    margin : float or None
        Distance from the paper's edge that all ink keeps; None for 10 to 24 mm, by the size of the paper.
    tile : bool
        Whether a marker larger than the paper goes on several sheets; else it is refused.
    overlap : float
        Width of what two neighboring tiles both print.
    compensate : bool
        Whether a marker that was measured on a print (`print_scale`) is drawn so that the same printer makes it true.
    colors : Colors

    Raises
    ------
    InputError
        If the orientation is unknown, or margin or overlap is no length from 0.
    """

    paper: str | None = None
    orientation: Orientation = ""
    margin: float | None = None
    tile: bool = True
    overlap: float = 0.010
    compensate: bool = False
    colors: Colors = BLACK_ON_WHITE

    def __post_init__(self) -> None:
        if self.orientation not in ("", "portrait", "landscape"):
            raise InputError("portrait or landscape", repr(self.orientation), "choose one of these")
        for name, article, value in (("margin", "a", self.margin), ("overlap", "an", self.overlap)):
            if value is not None and not 0 <= value < float("inf"):
                raise InputError(f"{article} {name} from 0", f"{name}={value}", "give a length such as 10mm")

    def frame(self, paper: Paper) -> "Frame":
        """Measures of a page of that paper; raises as `Frame` does."""
        from markergen.drawing.furniture import Frame

        return Frame(paper, None if self.margin is None else round(self.margin * 1e3, 9))

    def frames(self, papers: Sequence[Paper]) -> "list[Frame]":
        """Measures of pages to choose from: without those that the margin leaves nothing of, unless that is all."""
        frames = []
        for paper in papers:
            try:
                frames.append(self.frame(paper))
            except InputError:
                if paper is papers[-1] and not frames:
                    raise
        return frames
