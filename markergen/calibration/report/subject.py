"""Quantities of a calibration that several sections of its report show."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from markergen.calibration.coverage import Coverage, coverage

if TYPE_CHECKING:
    from markergen.calibration.calibration import Calibration

Array = NDArray[np.float64]

UM = 1e6
LONGEST_NAME = 60
"""Maximum number of characters shown of a photograph's name."""


@dataclass(frozen=True)
class Rejected:
    """A rejected dot: in which photograph, and by how many px and sigma it is off what all the others say."""

    photo: str
    dot: str
    off_px: float
    off_sigma: float


@dataclass(frozen=True, eq=False)
class Subject:
    """The calibration that a report shows; rows are its used views, columns its adjusted dots."""

    found: "Calibration"

    @cached_property
    def dots(self) -> list[str]:
        """Ids of the adjusted dots; with several markers, as ``2:5`` the fifth of the second."""
        named = [(k, point.id) for k, marker in enumerate(self.found.designs) for point in marker.control_points]
        several = len(self.found.designs) > 1
        return [f"{named[i][0] + 1}:{named[i][1]}" if several else str(named[i][1]) for i in self.found.chosen]

    @cached_property
    def photos(self) -> list[str]:
        """Names of the photographs; the end of long ones."""
        return [
            name if len(name) <= LONGEST_NAME else "..." + name[3 - LONGEST_NAME :]
            for name in self.found.sightings.photos
        ]

    @cached_property
    def rows(self) -> list[str]:
        """Name of the photograph of each used view; with several markers also which."""
        sightings, used = self.found.sightings, self.found.used
        several = len(self.found.designs) > 1
        return [
            f"{self.photos[photo]}, marker {marker + 1}" if several else self.photos[photo]
            for photo, marker in zip(sightings.photo[used], sightings.marker[used], strict=True)
        ]

    @property
    def taken(self) -> NDArray[np.bool_]:
        """Measurements (v, n) that took part."""
        return self.found.adjustment.weights > 0

    @property
    def rejected(self) -> NDArray[np.bool_]:
        """Measurements (v, n) that were rejected, of the used views."""
        return self.found.dropped[self.found.used]

    @property
    def displacement(self) -> Array:
        """Where the print's dots (n, 3) are, less where they were designed, um."""
        adjustment = self.found.adjustment
        return UM * (adjustment.places - adjustment.network.design)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (n, 3, 3) of each dot, um^2."""
        n = len(self.found.chosen)
        index = np.arange(n)
        return UM**2 * self.found.adjustment.covariance.reshape(n, 3, n, 3)[index, :, index]

    @cached_property
    def spread(self) -> Array:
        """Covariance (v, n, 2, 2) of the residuals, px^2, scaled."""
        return self.found.adjustment.scale * self.found.adjustment.residual_covariance()

    @cached_property
    def variance_factors(self) -> Array:
        """chi2 (v,) of each view over its expected value, the trace of its residuals' cofactors: 1 on average.

        A view's own share of the degrees of freedom is tr(S^-1 A), S the covariance of its measurements in the image
        and A that of their residuals.
        """
        adjustment, taken = self.found.adjustment, self.taken
        inverse = np.linalg.inv(adjustment.views.covariance)
        chi2 = np.einsum("vni,vnij,vnj->vn", adjustment.residual, inverse, adjustment.residual)
        expected = np.einsum("vnij,vnji->vn", inverse, self.spread / adjustment.scale)
        return np.asarray((chi2 * taken).sum(axis=1) / np.maximum((expected * taken).sum(axis=1), 1e-12))

    @cached_property
    def squares(self) -> Array:
        """Squared lengths (v, n) of the residuals that took part, px^2."""
        return np.where(self.taken, (self.found.adjustment.residual**2).sum(axis=-1), 0.0)

    def rms(self, axis: int) -> Array:
        """RMS of the residuals in px of each dot (axis 0) or each view (axis 1); nan where none took part."""
        count = self.taken.sum(axis=axis)
        return np.sqrt(np.where(count > 0, self.squares.sum(axis=axis) / np.maximum(count, 1), np.nan))

    @cached_property
    def coverage(self) -> Coverage:
        """What the used views cover."""
        return coverage(self.found.adjustment)

    @cached_property
    def outliers(self) -> list[Rejected]:
        """Rejected dots of the used views, the worst first."""
        residual = self.found.adjustment.residual
        listed = []
        for row, column in np.argwhere(self.rejected):
            off = residual[row, column]
            sigma = float(np.sqrt(off @ np.linalg.solve(self.spread[row, column], off)))
            listed.append(Rejected(self.rows[row], self.dots[column], float(np.linalg.norm(off)), sigma))
        return sorted(listed, key=lambda each: -each.off_sigma)
