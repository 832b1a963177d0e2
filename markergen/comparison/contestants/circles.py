"""OpenCV's circle grids, symmetric and asymmetric, detected by cv2.findCirclesGrid."""
# tests: tests/contracts/test_contestants.py

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.comparison.contestants import KINDS, Arena, ContestantKind, Sighting
from markergen.comparison.contestants.printed import Grey, Printed, disk_outlines, grid_size, pose_of, share_of
from markergen.errors import InputError
from markergen.maths.projection import center_offset, plane_homography
from markergen.model.boards import unit_grid
from markergen.model.camera import Camera

SHARE = 0.5
"""Default diameter of a circle over the distance to the nearest, as in OpenCV's own patterns."""
_ROUNDS = 3
"""Rounds of correction for perspective; the second changes centers by less than 1e-3 px."""
_LEAST_AREA_PX = 10.0
"""Minimum area of a circle's image, px^2. OpenCV's default of 25 misses 3 % of the paper's views of 9 x 9 circles, 50
misses 17 %; 5 finds no more than 10."""


STEPS = {f"threshold step {step:g}": step for step in (10.0, 5.0, 2.0)}
"""Steps between the thresholds at which blobs are sought, grey levels; OpenCV's default is 10."""
CENTERS = {"cv2's centers": False, "our correction of the centers for perspective": True}
"""OpenCV returns the center of a circle's image, which is not the image of its center."""


@dataclass(frozen=True, eq=False)
class CircleGrid(Printed):
    """A grid of black circles; its detector tells them apart up to rotations that turn the grid into itself."""

    name: str
    columns: int
    rows: int
    asymmetric: bool
    pitch: float
    diameter: float
    radius: float
    detectors = STEPS
    refiners = CENTERS
    detector = "cv2.findCirclesGrid, clustering"

    @property
    def turns(self) -> int:  # type: ignore[override]
        """See `Contestant.turns`."""
        if self.asymmetric:
            return 1 if self.rows % 2 else 2
        return 4 if self.columns == self.rows else 2

    @property
    def plane_points(self) -> Array:
        """See `Printed.plane_points`: the centers, row by row from the top left."""
        return self.pitch * unit_grid(self.columns, self.rows, self.asymmetric)

    @property
    def size(self) -> str:
        """See `Contestant.size`."""
        return f"{len(self.points)} circles of {1e3 * self.diameter:.4g} mm"

    def outlines(self, moved: Array, scale_px: float) -> tuple[Array, ...]:
        """See `Printed.outlines`."""
        return disk_outlines(self.plane_points + moved, self.diameter / 2, scale_px)

    def find(self, image: Grey, camera: Camera, options: float) -> Sighting:
        """See `Printed.find`."""
        import cv2

        del camera
        flags = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        # Without clustering a third of the paper's views are missed, and the others are no better.
        flags |= cv2.CALIB_CB_CLUSTERING
        blobs = _blob_detector(options, image.size / len(self.points))
        is_found, centers = cv2.findCirclesGrid(image, (self.columns, self.rows), flags=flags, blobDetector=blobs)
        if not is_found:
            return Sighting(reason="no grid")
        return Sighting(np.arange(len(self.points)), centers.reshape(-1, 2).astype(float))

    def refine(self, image: Grey, camera: Camera, detection: Sighting, refiner: bool) -> Array:
        """See `Printed.refine`."""
        del image
        return self._corrected(detection.pixels, camera) if refiner else detection.pixels

    def _corrected(self, pixels: Array, camera: Camera) -> Array:
        """Images (n, 2) of the circles' centers, from the centers of their images; without lens distortion exactly."""
        corrected = pixels
        for _ in range(_ROUNDS):
            rotation, translation = pose_of(self.points, corrected, camera)
            if not np.isfinite(translation).all():
                return pixels
            homography = plane_homography(rotation[None], translation[None], camera.matrix)
            corrected = pixels - center_offset(self.plane_points, self.diameter / 2, homography)
        return corrected


@lru_cache(maxsize=16)
def _blob_detector(step: float, most_px: float) -> Any:
    import cv2 as untyped

    cv2: Any = untyped
    parameters = cv2.SimpleBlobDetector_Params()
    parameters.thresholdStep = step
    parameters.minDistBetweenBlobs = 3.0
    parameters.minArea, parameters.maxArea = _LEAST_AREA_PX, most_px
    # Both leave out small or steeply tilted circles.
    parameters.filterByInertia = parameters.filterByConvexity = False
    return cv2.SimpleBlobDetector_create(parameters)


def _grid(text: str, arena: Arena) -> CircleGrid:
    kind = text.partition(":")[0]
    form, example = f"{kind}:COLUMNSxROWS[:SHARE]", f"{kind}:5x5:{SHARE:g}"
    columns, rows, rest = grid_size(text, form, example)
    if min(columns, rows) < 3 or columns * rows > 2500:
        raise InputError(f"{form}, of 3x3 circles or more", repr(text), f"write for example {example}")
    share = share_of(rest, "a circle's diameter over the distance to the nearest", SHARE, 0.1, 0.9)
    asymmetric = kind == "acircles"
    unit = unit_grid(columns, rows, asymmetric)
    # Distance of the nearest neighbors in units of the grid; the outermost rims lie on the circle.
    nearest = np.sqrt(2) if asymmetric else 1.0
    reach = float(np.linalg.norm(unit, axis=-1).max() + share * nearest / 2)
    width, height = (np.ptp(unit, axis=0) + share * nearest).tolist()
    pitch = arena.scale(width, height, reach)
    return CircleGrid(text, columns, rows, asymmetric, pitch, float(share * nearest * pitch), pitch * reach)


KINDS.register("circles")(ContestantKind(_grid, "circles:CxR[:SHARE]", "symmetric grid of circles", "OpenCV"))
KINDS.register("acircles")(ContestantKind(_grid, "acircles:CxR[:SHARE]", "asymmetric grid of circles", "OpenCV"))
