"""Frames and poses of hand-eye calibration, in both mountings: the figure of docs/handeye.md."""

from typing import TYPE_CHECKING

import numpy as np

from docs.figures import Save, pictures
from markergen.presentation.plots import FAINT, INK, SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARM = np.array([[0.0, 0.0], [0.1, 1.1], [1.3, 1.9], [2.3, 1.5]])
"""Joints of a drawn robot, from its base to its flange."""
ROBOT, SEEN, FOUND = SERIES[0]["color"], SERIES[2]["color"], SERIES[1]["color"]
LENGTH = 0.42


def make(save: Save) -> None:
    """Save the figure."""
    save("handeye-frames", pictures(_frames, (7.6, 3.4)))


def _frames(figure: "Figure") -> None:
    hand, beside = figure.subplots(1, 2)
    base, flange = (ARM[0], 90.0), (ARM[-1], -70.0)
    carried, fixed = (np.array([2.75, 1.05]), -70.0), (np.array([3.1, -0.35]), 90.0)
    _scene(hand, "eye-in-hand", base, flange, carried, fixed, ("camera", "marker"))
    _scene(beside, "eye-to-hand", base, flange, carried, fixed, ("marker", "camera"))


def _scene(
    ax: "Axes",
    title: str,
    base: tuple[np.ndarray, float],
    flange: tuple[np.ndarray, float],
    carried: tuple[np.ndarray, float],
    fixed: tuple[np.ndarray, float],
    names: tuple[str, str],
) -> None:
    """Draw the arm, four frames, and the poses between them: measured, seen, and sought."""
    ax.plot(*ARM.T, color=FAINT, linewidth=9, solid_capstyle="round", solid_joinstyle="round", zorder=1)
    for name, (place, angle), side in (
        ("base", base, (-0.1, -0.3)),
        ("flange", flange, (0.0, 0.3)),
        (names[0], carried, (0.42, 0.0)),
        (names[1], fixed, (0.5, -0.1)),
    ):
        _axes(ax, place, angle)
        ax.text(*(place + side), name, ha="center", va="center", fontsize=9, color=INK)
    marker, camera = (fixed, carried) if names[0] == "camera" else (carried, fixed)
    _pose(ax, base[0], flange[0], "T_base_flange", ROBOT, "-", 0.35, (-0.1, 0.22))
    _pose(ax, camera[0], marker[0], "T_camera_marker", SEEN, "-", 0.25, (0.98, 0.0))
    _pose(ax, flange[0], carried[0], f"T_flange_{names[0]}", FOUND, "--", -0.6, (1.0, 0.32))
    _pose(ax, base[0], fixed[0], f"T_base_{names[1]}", FOUND, "--", 0.15, (-0.1, -0.52))
    ax.set_title(title)
    ax.set(xlim=(-0.7, 4.3), ylim=(-0.85, 2.25), aspect="equal")
    ax.axis("off")


def _axes(ax: "Axes", place: np.ndarray, angle_deg: float) -> None:
    for rotation, style in ((0.0, "-"), (90.0, "-")):
        along = np.deg2rad(angle_deg - 90 + rotation)
        end = place + LENGTH * np.array([np.cos(along), np.sin(along)])
        ax.annotate("", end, place, arrowprops={"arrowstyle": "->", "color": INK, "linestyle": style, "linewidth": 1.2})
    ax.plot(*place, marker="o", color=INK, markersize=3, zorder=4)


def _pose(
    ax: "Axes",
    start: np.ndarray,
    end: np.ndarray,
    name: str,
    color: str,
    style: str,
    bow: float,
    off: tuple[float, float],
) -> None:
    look = {
        "arrowstyle": "-|>",
        "color": color,
        "linestyle": style,
        "connectionstyle": f"arc3,rad={bow}",
        "linewidth": 1.5,
    }
    ax.annotate("", end, start, arrowprops={**look, "shrinkA": 6, "shrinkB": 6})
    ax.text(*((start + end) / 2 + off), name, ha="center", va="center", fontsize=8.5, color=color)
