"""The same views under worse conditions, one at a time: what still works, and what it costs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from markergen.validation.view_records import summarize, take_records
from markergen.validation.views import Shoot

CONDITIONS: dict[str, Callable[[Shoot], Shoot]] = {
    "blur 2 px": lambda shoot: replace(shoot, optics=replace(shoot.optics, blur_px=2.0)),
    "noise 8": lambda shoot: replace(shoot, optics=replace(shoot.optics, noise_grey=8.0)),
    "half the light": lambda shoot: replace(
        shoot, optics=replace(shoot.optics, dark=shoot.optics.dark / 2, light=shoot.optics.light / 2)
    ),
    "one dot hidden": lambda shoot: replace(shoot, hidden=1),
    "clutter": lambda shoot: replace(shoot, background="clutter"),
}
"""What each condition makes of a shoot."""


def stress(
    shoot: Shoot, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Return the summary of the views under each condition, in the form of `summarize` without its single views."""
    results = {}
    total = len(CONDITIONS) * shoot.count
    for number, (name, worsen) in enumerate(CONDITIONS.items()):
        told = _shifted(progress, number * shoot.count, total) if progress else None
        worse = worsen(shoot)
        found = summarize(worse, take_records(worse, workers, told))
        results[name] = {key: value for key, value in found.items() if key != "samples"}
    return results


def _shifted(progress: Callable[[int, int], None], start: int, total: int) -> Callable[[int, int], None]:
    return lambda done, _: progress(start + done, total)
