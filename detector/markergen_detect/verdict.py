"""Whether an image agrees with the camera, the print and the body as described, and what may be wrong."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from markergen_detect.core import words

CAUSES = words("FOCAL_LENGTH", "BENT")
"""Names of causes, in the core's order."""

_FIELDS = "consistent", "chi2", "freedom", "limit", "likely"


class Cause(NamedTuple):
    """Something that may make image, print, camera and body disagree.

    Attributes
    ----------
    name : str
        See `CAUSES`.
    plate : str
        The plate that is misplaced; empty for the other causes.
    value, sigma : float
        By how much, with its standard deviation from the residuals. ``focal length`` and ``aspect``, which is fy/fx:
        the logarithm of the camera's ratio to its file. ``distortion``: k1 beyond the file's. ``stretch``: the share by
        which the print is longer along an axis of its plate; of a single one, relative to the other axis. ``bend``: the
        rise of its ends toward the viewer, m. ``shutter``: px along x from one row to the next. ``misplaced``: m.
        If none alone explains it: ``camera file``, the first three together, with the first one's value, and ``bent``,
        the rise in any direction, m.
    chi2 : float
        What is left with it.
    """

    name: str
    plate: str
    value: float
    sigma: float
    chi2: float

    def __str__(self) -> str:
        value, sigma, axis = self.value, self.sigma, self.name[-1]
        ratio, percent = (
            f"{100 * math.exp(value):.1f} +- {100 * sigma:.1f} %",
            f"{100 + 100 * value:.1f} +- {100 * sigma:.1f} %",
        )
        length, plain = f"{1e3 * value:.1f} +- {1e3 * sigma:.1f} mm", f"{value:.3f} +- {sigma:.3f}"
        return {
            "focal length": f"camera file: the focal length is {ratio} of the file's",
            "aspect": f"camera file: fy/fx is {ratio} of the file's",
            "distortion": f"camera file: k1 differs by {plain}",
            "stretch": f"print stretched: {percent} along {axis}",
            "bend": f"bent by {length} along {axis}",
            "shutter": f"rolling shutter: {plain} px from row to row",
            "misplaced": f"{self.plate} is {length} from its place",
            "camera file": "camera file: focal length, fy/fx and k1 together",
            "bent": f"bent by {length}",
        }[self.name.removesuffix(f" {axis}")]


class Verdict(NamedTuple):
    """Whether residuals are as small as the errors of image, print, camera and body say.

    Attributes
    ----------
    consistent : bool
    chi2, degrees_of_freedom, limit : float, int, float
        Weighted sum of squared residuals, its expected value, and the most that is usual.
    causes : tuple of Cause
        Those that explain most of it, the best one first; empty if consistent, or if none does.
    """

    consistent: bool
    chi2: float
    degrees_of_freedom: int
    limit: float
    causes: "tuple[Cause, ...]"

    def __str__(self) -> str:
        if self.consistent:
            return "consistent"
        times = math.sqrt(self.chi2 / max(self.degrees_of_freedom, 1))
        causes = "; or ".join(map(str, self.causes)) or "no single cause explains it"
        return f"inconsistent: residuals are {times:.1f} times as large as expected; {causes}"


def read_verdict(row: Any, plate_names: Sequence[str]) -> Verdict:
    """Return the verdict of the core's structure (1,)."""
    names = [*plate_names, ""]
    consistent, chi2, freedom, limit, likely = (row[name].item() for name in _FIELDS)
    causes = tuple(
        Cause(CAUSES[kind], names[plate], value, sigma, left)
        for kind, plate, left, value, sigma in row["causes"][0, :likely].tolist()
    )
    return Verdict(bool(consistent), chi2, freedom, limit, causes)
