"""Views worth looking at, as pictures: what failed, the worst, and what it usually looks like."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markergen.detect.presentation import overlay
from markergen.validation.views import Shoot, take_view

FAILURES, WORST, TYPICAL = 6, 3, 3


@dataclass(frozen=True)
class Picture:
    """One picture with what to say about it.

    Attributes
    ----------
    name : str
        Fit for a file's name.
    title, caption : str
    png : bytes
    """

    name: str
    title: str
    caption: str
    png: bytes


def pictures(shoot: Shoot, views: Mapping[str, Any]) -> Iterator[Picture]:
    """Take some of the views of a summary again and draw into each what was found.

    Parameters
    ----------
    views : mapping
        Of `summarize`, for the same shoot.
    """
    failures = views["failures"]
    # Evenly among all that failed, since neighbors look alike.
    for each in _spread(failures, FAILURES):
        yield _picture(shoot, each, "failure", each["reason"])
    ranked = sorted(views["samples"], key=lambda each: -(each["rotation_deg"] or 0.0))
    for each in ranked[:WORST]:
        yield _picture(shoot, each, "worst", _errors(each))
    for each in _spread(ranked[WORST:], TYPICAL):
        yield _picture(shoot, each, "typical", _errors(each))


def remove_earlier(folder: Path, new: Container[str] = ()) -> None:
    """Remove pictures that an earlier run left in a folder, known by their names; other files and the new ones stay."""
    for path in folder.iterdir():
        if path.name not in new and re.fullmatch(r"(failure|worst|typical)-\d{4,}\.png", path.name):
            path.unlink()


def _spread(items: list[Any], count: int) -> list[Any]:
    return items if len(items) <= count else [items[(2 * i + 1) * len(items) // (2 * count)] for i in range(count)]


def _errors(each: Mapping[str, Any]) -> str:
    found = f"dots off by {each['point_px_rms']:.4f} px"
    if each["rotation_deg"] is None:
        return found
    return f"{found}, rotation by {each['rotation_deg']:.3f} deg, translation by {each['translation_pct']:.3f} %"


def _picture(shoot: Shoot, each: Mapping[str, Any], kind: str, said: str) -> Picture:
    view = take_view(shoot, each["view"])
    where = f"{each['polar_angle_deg']:g} deg at {each['distance']:.3g} m"
    marks = [view.detection] if view.detection.found else []
    return Picture(
        f"{kind}-{each['view']:04d}", f"{kind.capitalize()}: {where}", f"View {each['view']}, {where}: {said}.",
        overlay(view.image, shoot.marker, shoot.camera, marks),
    )  # fmt: skip
