"""Directions of photographs as a photographer sees them, and what a set of them covers of image, tilt and turn.

All sides are those of the picture, as the sensor takes it: left, right, upper and lower. A marker that is upright has
its x axis to the right and its y axis up. A camera that is turned to the right, clockwise from behind, shows the marker
turned counterclockwise.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment
from markergen.maths.rotation import exponential, rotation_z

SIDES = (
    "right edge",
    "lower right corner",
    "lower edge",
    "lower left corner",
    "left edge",
    "upper left corner",
    "upper edge",
    "upper right corner",
)
"""Sides of the marker at 0, 45, ... deg from the picture's x axis toward its y axis, which points down."""

COLUMNS = 8
"""Number of columns of cells that the picture is divided into."""

TILTED_DEG = 10.0
"""Tilt in deg from which on a photograph counts as tilted to a side."""


@dataclass(frozen=True, eq=False)
class PhotoCoverage:
    """What photographs of a calibration cover: dots in each cell (rows, columns) of the image, and the views' angles.

    Angles (v,) are those of `view_angles`; `fill` (v,) is the share of the picture's width or height, the larger, that
    the dots of a view extend over.
    """

    cells: NDArray[np.intp]
    tilt_deg: Array
    toward_deg: Array
    roll_deg: Array
    fill: Array

    @property
    def image(self) -> float:
        """Share of the cells with a dot."""
        return float((self.cells > 0).mean())

    @property
    def sides(self) -> tuple[str, ...]:
        """Those of `SIDES` that were away from the camera in a photograph tilted by `TILTED_DEG` or more."""
        octants = np.round(self.toward_deg[self.tilt_deg >= TILTED_DEG] / 45).astype(int) % 8
        return tuple(SIDES[k] for k in np.unique(octants))

    @property
    def quarters(self) -> tuple[int, ...]:
        """Quarters 0 to 3 of a full turn that the camera was turned by, each to the nearest."""
        return tuple((np.unique(np.round(self.roll_deg / 90).astype(int) % 4)).tolist())

    @property
    def sentence(self) -> str:
        """The coverage in a sentence."""
        return (
            f"Dots in {100 * self.image:.0f} % of the picture, the marker filling {100 * self.fill.min():.0f} to "
            f"{100 * self.fill.max():.0f} % of it; tilts of {self.tilt_deg.min():.0f} to {self.tilt_deg.max():.0f} "
            f"deg to {len(self.sides)} of 8 sides; camera turned to {len(self.quarters)} of 4 quarters."
        )


def coverage_of(adjustment: Adjustment) -> PhotoCoverage:
    """Return what the views of a calibration cover, by the dots that took part."""
    views, camera, used = adjustment.views, adjustment.camera, adjustment.weights > 0
    size = camera.width, camera.height
    rows = max(round(COLUMNS * camera.height / camera.width), 1)
    x, y = ((views.pixels[used] + 0.5) / size * (COLUMNS, rows)).astype(int).T
    cells = np.zeros((rows, COLUMNS), dtype=np.intp)
    np.add.at(cells, (np.clip(y, 0, rows - 1), np.clip(x, 0, COLUMNS - 1)), 1)
    pixels = np.where(used[..., None], views.pixels, np.nan)
    extent = np.nanmax(pixels, axis=1) - np.nanmin(pixels, axis=1)
    return PhotoCoverage(cells, *view_angles(views.rotation), (extent / size).max(axis=1))


def posed(tilt_deg: Array, toward_deg: Array, roll_deg: Array) -> Array:
    """Rotations (k, 3, 3) of T_camera_marker, for the angles (k,) of `view_angles`."""
    lean, roll = _lean(np.deg2rad(tilt_deg), np.deg2rad(toward_deg)), rotation_z(np.deg2rad(roll_deg))
    return np.asarray(lean @ np.diag([1.0, -1.0, -1.0]) @ roll, dtype=float)


def view_angles(rotation: Array) -> tuple[Array, Array, Array]:
    """Angles in deg of views T_camera_marker with rotations (k, 3, 3).

    Returns
    -------
    tilt : array (k,), 0 to 180
        Between marker plane and image plane.
    toward : array (k,), 0 to 360
        Direction in the picture, from x toward y (down), in which the marker is farther away; 0 without tilt.
    turn : array (k,), 0 to 360
        Turn of the camera to the right, clockwise from behind, from where the marker is upright.
    """
    normal = rotation[:, :, 2]
    aside = np.linalg.norm(normal[:, :2], axis=1)
    tilt = np.arctan2(aside, -normal[:, 2])
    toward = np.where(aside > 1e-12, np.arctan2(normal[:, 1], normal[:, 0]), 0.0)
    flat = np.diag([1.0, -1.0, -1.0]) @ _lean(tilt, toward).swapaxes(-1, -2) @ rotation
    roll = np.arctan2(flat[:, 1, 0], flat[:, 0, 0])
    return np.rad2deg(tilt), np.rad2deg(toward) % 360, np.rad2deg(roll) % 360


def _lean(tilt: Array, toward: Array) -> Array:
    """Rotations (k, 3, 3) that move the parts of a plane before the camera away that lie in a direction."""
    axis = np.stack([np.sin(toward), -np.cos(toward), np.zeros_like(toward)], axis=-1)
    return exponential(tilt[:, None] * axis)
