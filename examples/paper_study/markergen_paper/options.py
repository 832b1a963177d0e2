"""Extent of the study, and its setting."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import markergen as mg
from markergen.model.boundary import Circle, Polygon
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.optimize.problem import FeasibleRegion

Index = NDArray[np.intp]

BOUNDARY = Circle(0.15)
REGION = FeasibleRegion(BOUNDARY)
"""The paper's disk; control points are bare, and may lie on its rim."""

_HALF = np.sqrt(BOUNDARY.area / 12) * np.array([2.0, 1.5])
RECTANGLE = FeasibleRegion(Polygon((tuple(map(tuple, (_HALF * [[-1, -1], [1, -1], [1, 1], [-1, 1]]).tolist())),)))
"""A rectangle of the disk's area, with the sides of an image."""

REAL_CAMERA = mg.Camera(1288, 964, 1070.82, 1071.20, 647.98, 488.27)
"""Camera of the paper's experiment with a screen."""

CAMERAS = {"paper": PAPER_CAMERA, "real": REAL_CAMERA}

COORDINATES = ("metric", "unit", "pixel", "hartley")
"""Coordinates in which c(A) is written, first the paper's own, Eq. 4."""

OBJECTIVE_OF = {name: ("condition", name) for name in COORDINATES} | {
    "pose": ("pose", "unit"),
    "homography": ("homography", "unit"),
}
"""Objective and coordinates by the names of optimized layouts in this study."""

NUMBERS = (4, 5, 6, 7, 8)
"""Numbers of control points of the optimized layouts."""

RANDOM_ONLY = 9
"""Maximum number of control points of random layouts compared with four optimized ones."""

NOISE_PX, QUIET_PX, LEAST_PX = 4.0, 1.0, 0.2
"""The only noise stated in the paper, a quarter of it, at which estimates from afar do not break down, and that of dots
found in an image, `validate`'s default.
"""

STARTS, RUNS, STEP_RUNS, AZIMUTHS, GROUPS = 100, 20, 1000, 20, 20
"""Random starts per pose and n; noisy runs per layout; runs per step of the descent; azimuths for each pair of distance
and polar angle; number of these pairs.
"""

MOST_RUNS = 100_000


@dataclass(frozen=True)
class PaperOptions:
    """Extent of the study.

    Attributes
    ----------
    runs : int
        Noisy runs of each layout; 1000 in the paper.
    scale : float
        Share of the 400 poses x 100 starts, 1 for all of them.
    seed : int

    Raises
    ------
    InputError
        If a number is out of range.
    """

    runs: int = RUNS
    scale: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not 2 <= self.runs <= MOST_RUNS:
            raise mg.InputError(
                f"2 to {MOST_RUNS} runs of a layout", f"runs={self.runs}", "use --runs 20, or 1000 as the paper"
            )
        if not 0 < self.scale <= 1:
            raise mg.InputError("a scale above 0, up to 1", f"scale={self.scale}", "use --scale 0.01 for a quick look")
        if self.seed < 0:
            raise mg.InputError("a seed of 0 or more", f"seed={self.seed}", "give a whole number")

    @property
    def azimuths(self) -> int:
        """Azimuths of each distance and polar angle: the root of the scale, so that poses and starts shrink alike.

        One instead of two: what a pose costs, however few its starts are, would be most of it.
        """
        azimuths = round(AZIMUTHS * self.scale**0.5)
        return azimuths if azimuths > 2 else 1

    @property
    def poses(self) -> list[int]:
        """Indices into the paper's 400 poses, at every distance and polar angle."""
        turns = AZIMUTHS * np.arange(self.azimuths) // self.azimuths
        return (AZIMUTHS * np.arange(GROUPS)[:, None] + turns).ravel().tolist()

    @property
    def starts(self) -> int:
        """Random starts for each pose and n."""
        return max(4, round(STARTS * AZIMUTHS * self.scale / self.azimuths))

    @property
    def fewer_poses(self) -> list[int]:
        """Indices of three in twenty of the poses, for comparisons outside the paper's own setting.

        Where that is less than one at each distance and polar angle, one at each polar angle, farther with the angle.
        """
        kept = 3 * self.azimuths // AZIMUTHS
        blocks = np.reshape(self.poses, (GROUPS, -1))
        if not kept:
            return blocks[[0, 6, 12, 18, 4], 0].tolist()
        return blocks[:, :: self.azimuths // kept][:, :kept].ravel().tolist()

    @property
    def fewer(self) -> int:
        """Number of starts outside the paper's own setting, for other coordinates, objectives, and noise."""
        return max(2, self.starts // 10)

    @property
    def step_runs(self) -> int:
        """Noisy runs of each step of the descent."""
        return max(100, round(STEP_RUNS * self.scale**0.5))

    def reduced(self, number: int, least: int) -> int:
        """Number as it is from a quarter of the study on, then with the root of the scale, and at least `least`."""
        return max(least, round(number * min(1.0, 2 * self.scale**0.5)))

    def as_dict(self) -> dict[str, float]:
        """Return the options as plain JSON values."""
        return {"runs": self.runs, "scale": self.scale, "seed": self.seed}


def poses_of(indices: list[int]) -> PoseDistribution:
    """Subset of the paper's poses; all of them see the entire disk."""
    return paper().taken(np.array(indices), 0)


def objective_for(name: str, poses: PoseDistribution, camera: mg.Camera = PAPER_CAMERA) -> Objective:
    """Objective by its name in `OBJECTIVE_OF`, for the given poses."""
    kind, coordinates = OBJECTIVE_OF[name]
    return OBJECTIVES[kind](Setting(BOUNDARY, camera, poses), "", coordinates)
