"""A calibration in words: what its report says first, and the terminal at all."""

from typing import TYPE_CHECKING

from markergen.calibration.judging import CHANCE, CrossValidation, Halves, NotJudged
from markergen.calibration.working_error import ExpectedError
from markergen.presentation.tables import Table, number

if TYPE_CHECKING:
    from markergen.calibration.calibration import Calibration

SOURCES = ("image", "print", "camera")
"""Sources of an `ExpectedError`."""
_WORDS = {"image": "image noise", "print": "the print", "camera": "the camera"}
_MOST_NAMED = 3
_WORSE = 1.05
"""Ratio of translation errors from which on the measured print counts as worse."""


def summary(found: "Calibration") -> list[str | Table]:
    """Return some ten lines: the error to expect, the scale, the residuals, how it was judged, and warnings."""
    said: list[str | Table] = [headline(found), what_is_left(found), found.scale_source, *photographs(found)]
    said += [] if found.relation is None else found.relation.sentences[:1]
    said += judged(found)
    if found.camera_covariance is not None:
        said.append(f"Camera: {found.camera}.")
    if found.next_photos is not None:
        said.append(found.next_photos.sentence)
    return [*said, *found.notes]


def headline(found: "Calibration") -> str:
    """Return the verdict in a sentence: the pose error to expect, before and after, and whether it is confirmed."""
    before, after = errors(found.before), errors(found.after)
    where = "over the working volume"
    if len(found.designs) > 1:
        where = f"from the first marker {where}"
    if not found.measured:
        return f"The camera is calibrated: expect a pose error of {after} {where}, with the print as designed."
    cross, halves = found.cross_validation, found.halves
    if found.before.rotation_deg <= found.after.rotation_deg:
        if isinstance(cross, CrossValidation) and cross.better and cross.gain is not None:
            return (
                f"Use the measured marker: it predicts left-out photographs {cross.gain.ratio:.3g} times better than "
                f"the design does; expect a pose error of {after} {where}. The {before} of the design are those of "
                "a better print than this one."
            )
        return (
            f"Keep the marker as designed: with the print as these photographs measure it, expect a pose error of "
            f"{after} {where}, as designed {before}."
        )
    expect = f"a pose error of {after} {where} instead of {before} with the print as designed"
    scaled = found.adjustment.network.scale_known(int(found.adjustment.network.marker[0]))
    worse_moves = found.after.translation > _WORSE * found.before.translation
    if worse_moves and not scaled:
        return (
            "Take more photographs before you use the measured marker, since rotations gain by it but translations "
            f"lose: expect {expect}."
        )
    if isinstance(cross, CrossValidation) and not cross.better:
        worse = "worse than" if cross.gain is not None and cross.gain.high < 1 else "no better than"
        return (
            f"Do not use the measured marker yet: it predicts left-out photographs {worse} the design does, "
            f"although its claimed errors promise {expect}."
        )
    if isinstance(halves, Halves) and halves.chance < CHANCE:
        return (
            f"Use the measured marker with care: expect {expect}, or somewhat more, since two halves of the "
            "photographs differ by more than their claimed errors."
        )
    confirmed = "left-out photographs confirm it"
    if isinstance(cross, NotJudged):
        confirmed = "there were too few photographs to confirm it by leaving some out"
    if worse_moves:
        confirmed += "; only the translation as measured counts how well the scale of the print is known"
    return f"Use the measured marker: expect {expect}; {confirmed}."


def errors(error: ExpectedError) -> str:
    """Return both errors as words: ``0.025 deg and 0.11 mm``."""
    return f"{number(error.rotation_deg, 2)} deg and {number(1e3 * error.translation, 2)} mm"


def shares(error: ExpectedError) -> dict[str, tuple[float, float]]:
    """Return the share of each source in the sum of the variances of rotation and of translation."""
    parts = {name: getattr(error, name) for name in SOURCES}
    totals = [sum(part[k] ** 2 for part in parts.values()) or 1.0 for k in range(2)]
    return {name: (part[0] ** 2 / totals[0], part[1] ** 2 / totals[1]) for name, part in parts.items()}


def what_is_left(found: "Calibration") -> str:
    """Return what the error that is left comes from, the largest source first."""
    parts = sorted(shares(found.after).items(), key=lambda part: -max(part[1]))
    listed = [
        f"{_WORDS[name]} (rotation {100 * turn:.0f} %, translation {100 * move:.0f} %)"
        for name, (turn, move) in parts
        if max(turn, move) >= 0.005
    ]
    return f"The variance that is left comes from {', '.join(listed)}."


def photographs(found: "Calibration") -> list[str]:
    """Return how many photographs and dots took part and how well they fit, and which ones did not."""
    sightings, adjustment = found.sightings, found.adjustment
    used = len({int(k) for k in sightings.photo[found.used]})
    rejected = int(found.dropped.sum())
    said = [
        f"{len(found.chosen)} dots in {used} of {len(sightings.photos)} photographs; residuals {adjustment.rms:.3f} px "
        f"RMS, chi2 {adjustment.variance_factor:.2f} per degree of freedom; {rejected or 'no'} "
        f"dot{'s' * (rejected != 1)} rejected."
    ]
    left = unused(found)
    if left:
        named = "; ".join(f"{name}: {reason}" for name, reason in left[:_MOST_NAMED])
        more = f"; and {len(left) - _MOST_NAMED} more" if len(left) > _MOST_NAMED else ""
        said.append(f"Not used: {named}{more}.")
    return said


def unused(found: "Calibration") -> list[tuple[str, str]]:
    """Return the photographs that took no part, with the reason of each, in the order of the photographs."""
    sightings = found.sightings
    reasons = dict(sightings.unused)
    taken = {int(k) for k in sightings.photo[found.used]}
    for k in sightings.photo.tolist():
        if k not in taken:
            reasons[k] = "too few dots that agree with the other photographs"
    return [(sightings.photos[k], reasons[k].rstrip(".")) for k in sorted(reasons)]


def judged(found: "Calibration") -> list[str]:
    """Return what left-out photographs and two halves say, or why they could not be asked."""
    return [
        sentence(each.reason if isinstance(each, NotJudged) else each.verdict)
        for each in (found.cross_validation, found.halves)
    ]


def sentence(text: str) -> str:
    """Return text with a capital and a period."""
    return text[:1].upper() + text[1:].rstrip(".") + "."
