"""A calibration in words."""

from typing import TYPE_CHECKING

from markergen.calibration.judging import NotJudged
from markergen.presentation.tables import Table
from markergen.units import format_length

if TYPE_CHECKING:
    from markergen.calibration.calibration import Calibration


def summary(found: "Calibration") -> list[str | Table]:
    """Return some ten lines: the expected error before and after, the scale, the residuals, and what limits it."""
    before, after, sightings = found.before, found.after, found.sightings
    adjustment = found.adjustment
    used = len({int(k) for k in sightings.photo[found.used]})
    said: list[str | Table] = [
        f"Expected pose error over the working volume: {after.rotation_deg:.2g} deg and "
        f"{format_length(float(f'{after.translation:.2g}'))}; with the print as designed {before.rotation_deg:.2g} deg "
        f"and {format_length(float(f'{before.translation:.2g}'))}.",
        found.scale_source,
        f"{len(found.chosen)} dots in {used} of {len(sightings.photos)} photographs; residuals {adjustment.rms:.3f} px "
        f"RMS, chi2 {adjustment.variance_factor:.2f} per degree of freedom; {int(found.dropped.sum())} dots rejected.",
    ]
    said += [
        each.verdict[:1].upper() + each.verdict[1:] + "."
        for each in (found.cross_validation, found.halves)
        if not isinstance(each, NotJudged)
    ]
    if found.camera_covariance is not None:
        said.append(f"Camera: {found.camera}.")
    return [*said, *found.notes]
