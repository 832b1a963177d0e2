"""The spec: what a user asks a design for."""

import hashlib
import json
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

from markergen.errors import InputError
from markergen.model.boundary import Boundary, Circle
from markergen.model.camera import PAPER_CAMERA, Camera

MOST_POINTS = 60
"""The polish has a constraint for every pair of points, and takes half a minute for this many."""


@dataclass(frozen=True)
class Spec:
    """Everything that decides a design; equal specs give equal markers, byte for byte.

    Attributes
    ----------
    n : int
        Number of control points, 4 to 60.
    boundary : Boundary
    camera : Camera
    poses : str
        Name of a pose distribution.
    objective, aggregate, coordinates : str
        What is minimized; an empty aggregate is the objective's own default. Coordinates matter to ``condition`` alone.
    dot : float or None
        Dot diameter in m; None lets the camera and poses decide.
    clearance : float or None
        m; None is a tenth of the dot's diameter.
    seed : int
    restarts : int
        Random starts of the descent; 0 is the objective's own default.
    """

    n: int = 5
    boundary: Boundary = Circle(0.15)  # noqa: RUF009  (frozen, so it can be shared)
    camera: Camera = PAPER_CAMERA
    poses: str = "paper"
    objective: str = "pose"
    aggregate: str = ""
    coordinates: str = "unit"
    dot: float | None = None
    clearance: float | None = None
    seed: int = 0
    restarts: int = 0

    def __post_init__(self) -> None:
        if self.n < 4:
            raise InputError("at least 4 control points", f"n={self.n}", "a homography needs four: use --n 4 or more")
        if self.n > MOST_POINTS:
            raise InputError(f"at most {MOST_POINTS} control points", f"n={self.n}", "use a smaller --n")
        for name in ("dot", "clearance"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value >= 0):
                raise InputError(f"a {name} of 0 or more", f"{name}={value} m", f"give --{name} a length such as 5mm")
        if self.restarts < 0:
            raise InputError("restarts of 1 or more", f"restarts={self.restarts}", "give a positive number of restarts")
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")

    def as_dict(self) -> dict[str, Any]:
        """Return the spec as plain JSON values, lengths in m."""
        values = asdict(self)
        values["boundary"] = self.boundary.as_dict()
        return values

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits of the SHA-256 of the canonical JSON of the spec."""
        text = json.dumps(self.as_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:8]
