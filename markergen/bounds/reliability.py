"""Reliability of a flat marker: how well its other dots control each one, and what a wrong one does unnoticed.

With the information F of a dot at a pose and C the covariance of the pose, the dot has the redundancy number
1 - tr(F C) / 2: the share of its error that its residual shows; all of a pose add up to n - 3. The smallest blunder in
its place that a test notices follows from `detectability`, and moves the estimated pose by C F T g, unnoticed.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from markergen.arrays import Array
from markergen.maths.information import covariance
from markergen.maths.reliability import POWER, RISK, detectability, noncentrality
from markergen.objectives import Setting
from markergen.objectives.pose import PoseObjective
from markergen.presentation.tables import Table, number

ROUNDING = 1e-9
"""Share of a dot's information that is rounding, not control by other dots."""


@dataclass(frozen=True)
class DotReliability:
    """Reliability of a dot, over the poses.

    Attributes
    ----------
    redundancy : float
        Mean redundancy number, from 0, not controlled, to 1.
    blunder_m : float
        RMS of the smallest displacement in m that a test notices, in the direction where that is largest.
    rotation_deg, translation_m : float
        RMS of the largest errors of the pose by displacements that are just not noticed.
    """

    id: int
    redundancy: float
    blunder_m: float
    rotation_deg: float
    translation_m: float


def reliability(points: Array, setting: Setting, ids: Sequence[int] = ()) -> list[DotReliability]:
    """Reliability of dots at points (n, 2) in m, for the noise of a setting; inf where nothing is noticed."""
    objective = PoseObjective(setting)
    shares = objective.information(points[:, None, :2])[0].swapaxes(0, 1)
    spread = covariance(shares.sum(axis=1))[:, None]
    plane = objective._plane()[:, None]
    matrix = detectability(shares, spread, plane)
    redundancy = 1 - np.trace(shares @ spread, axis1=-2, axis2=-1) / 2
    effect = spread @ shares @ plane
    with np.errstate(all="ignore"):
        least = np.linalg.eigvalsh(np.nan_to_num(matrix))[..., 0]
        noticed = least > ROUNDING * np.trace(plane.swapaxes(-1, -2) @ shares @ plane, axis1=-2, axis2=-1)
        inverse = np.linalg.inv(np.where(noticed[..., None, None], matrix, np.eye(2)))
        rows = [effect[..., :3, :], effect[..., 3:, :]]
        squares = [1 / least, *(np.linalg.eigvalsh(row @ inverse @ row.swapaxes(-1, -2))[..., -1] for row in rows)]
        blunder, rotation, translation = (
            np.sqrt(noncentrality() * np.mean(np.where(noticed, square, np.inf), axis=0)) for square in squares
        )
    return [
        DotReliability(*row)
        for row in zip(
            ids or range(len(points)), redundancy.mean(axis=0).tolist(), blunder.tolist(),
            np.rad2deg(rotation).tolist(), translation.tolist(), strict=True,
        )
    ]  # fmt: skip


def reliability_json(dots: Sequence[DotReliability], noise: str) -> dict[str, object]:
    """Return plain JSON values of a marker's reliability."""
    return {"noise": noise, "risk": RISK, "power": POWER, "dots": [asdict(dot) for dot in dots]}


def reliability_table(dots: Sequence[DotReliability], noise: str) -> Table:
    """Table of a marker's reliability."""
    rows = [
        [str(dot.id), f"{dot.redundancy:.2f}"]
        + [number(value, 3) for value in (1e3 * dot.blunder_m, dot.rotation_deg, 1e3 * dot.translation_m)]
        for dot in dots
    ]
    return Table(
        f"What a wrong dot does before a test notices it, for {noise}",
        ["dot", "redundancy", "noticed from mm", "rotation deg", "translation mm"],
        rows,
        f"A test that suspects a right dot with {100 * RISK:g} % notices that displacement with {100 * POWER:g} %; "
        "below it, the pose is off by as much. RMS over the poses, of the worst direction.",
    )
