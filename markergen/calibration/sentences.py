"""A calibration in words: what its report says first, and the terminal at all."""

# tests: tests/calibration/test_report.py

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from markergen.arrays import Array
from markergen.calibration.judging import CHANCE, CrossValidation, Halves, NotJudged
from markergen.calibration.projection_uncertainty import projection_uncertainty
from markergen.calibration.scale import measured_growth
from markergen.calibration.working_error import ExpectedError
from markergen.errors import enumerated
from markergen.model.camera import Camera
from markergen.presentation.tables import number

if TYPE_CHECKING:
    from markergen.calibration.calibration import Calibration


SOURCES = ("image", "print", "camera")
"""Sources of an `ExpectedError`."""
_WORDS = {"image": "image noise", "print": "the print", "camera": "the camera"}
MOST_NAMED = 3
"""Maximum number of unused photographs that are named."""
TOO_FEW = "too few dots that agree with the other photographs"
"""Why a photograph that shows the marker took no part."""
_AS_DESIGNED = 2.0
"""chi2 per degree of freedom, relative to that of the adjustment, up to which the design predicts left-out photographs
as well as they fit: 1.9 in twenty poor photographs of a print as designed; at 1.5 these are refused."""
_BADLY_PX = 1.0
"""Standard deviation of the image of a far point from which on the camera is known badly there."""
_WORSE = 1.05
"""Ratio of translation errors from which on the measured print counts as worse."""


def sentences_of(calibration: "Calibration") -> dict[str, list[str]]:
    """Return what was found in sentences, by the names of the report's sections; empty where nothing was."""
    relation, following = calibration.relation, calibration.next_photos
    return {
        "answer": [verdict(calibration)[0], what_is_left(calibration), calibration.scale_source],
        "photos": photographs(calibration),
        "relation": [] if relation is None else list(relation.sentences),
        "judged": judged(calibration),
        "camera": [
            f"Camera{f' {entry.name}' * bool(entry.name)}: {entry.camera}. {far_points(entry.camera, entry.covariance)}"
            for entry in calibration.cameras
            if entry.covariance is not None
        ],
        "next": [] if following is None else [following.sentence],
    }


def summary(calibration: "Calibration") -> list[str]:
    """Return some ten sentences: the error to expect, the scale, the residuals, how it was judged, and warnings."""
    return [*chain.from_iterable(sentences_of(calibration).values()), *calibration.notes]


def verdict(calibration: "Calibration") -> tuple[str, bool]:
    """Return the headline, and whether what was measured is to be used."""
    before, after = errors(calibration.before), errors(calibration.after)
    where = "over the working volume"
    if len(calibration.designs) > 1:
        where = f"from the first marker {where}"
    if not calibration.measured:
        care = ", and to be used with care" if calibration.cause else ""
        expect = f"expect a pose error of {after} {where}, with the print as designed{_or_more(calibration)}"
        return f"The camera is calibrated{care}: {expect}.", True
    cross, halves = calibration.cross_validation, calibration.halves
    if calibration.before.rotation_deg <= calibration.after.rotation_deg:
        if isinstance(cross, CrossValidation) and cross.better and cross.gain is not None:
            return (
                f"Use the measured marker: it predicts left-out photographs {cross.gain.ratio:.3g} times better than "
                f"the design does; expect a pose error of {after} {where}. The {before} of the design are those of "
                "a better print than this one.",
                True,
            )
        return (
            f"Keep the marker as designed: with the print as these photographs measure it, expect a pose error of "
            f"{after} {where}, as designed {before}.",
            False,
        )
    expect = f"a pose error of {after} {where} instead of {before} with the print as designed"
    scaled = calibration.adjustment.network.scale_known(int(calibration.adjustment.network.marker[0]))
    worse_moves = calibration.after.translation > _WORSE * calibration.before.translation
    if worse_moves and not scaled:
        return (
            "Take more photographs before you use the measured marker, since rotations gain by it but translations "
            f"lose: expect {expect}.",
            False,
        )
    if isinstance(cross, CrossValidation) and not cross.better:
        worse = cross.gain is not None and cross.gain.high < 1
        noise = 1.0 if worse else max(1.0, calibration.adjustment.variance_factor)
        if cross.best_nominal.variance_factor <= _AS_DESIGNED * noise:
            if deviations := list(_beside_the_dots(calibration)):
                measured = "marker" if calibration.rig is None else "rig"
                return (
                    f"Use the measured {measured}: {enumerated(deviations, 'and')}; otherwise the print is as "
                    f"designed, as far as left-out photographs tell: expect {expect}"
                    f"{_or_more(calibration)}.",
                    True,
                )
            return (
                "Use the measured marker or the design, since the print is as designed, as far as left-out photographs "
                f"tell: expect a pose error of {after} {where} instead of the {before} of a print that nobody "
                f"measured{_or_more(calibration)}.",
                True,
            )
        predicts = "worse" if worse else "not significantly better"
        return (
            f"Keep the marker as designed: left-out photographs are predicted {predicts} by the measured one, although "
            f"its claimed errors promise {expect}; --geometry nominal gives the camera for it.",
            False,
        )
    if isinstance(halves, Halves) and halves.chance < CHANCE:
        return (
            f"Use the measured marker with care: expect {expect}, or somewhat more, since two halves of the "
            "photographs differ by more than their claimed errors.",
            True,
        )
    if calibration.cause:
        # Photographs that were left out share the camera and the print.
        return (
            f"Use the measured marker with care: expect {expect}{_or_more(calibration)}.",
            True,
        )
    confirmed = "left-out photographs confirm it"
    if isinstance(cross, NotJudged):
        confirmed = "there were too few photographs to confirm it by leaving some out"
    if worse_moves:
        confirmed += "; only the translation as measured counts how well the scale of the print is known"
    return f"Use the measured marker: expect {expect}; {confirmed}.", True


def _beside_the_dots(calibration: "Calibration") -> Iterator[str]:
    """Yield what is not as designed of what left-out photographs do not judge: the scale, and the relation of a rig."""
    if growth := measured_growth(calibration.adjustment):
        larger = f"{100 * abs(growth):.2g} % {'larger' if growth > 0 else 'smaller'}"
        yield f"by the length measured on it, it is {larger} than designed"
    if calibration.relation is not None and not calibration.relation.is_as_designed:
        yield f"its markers are {calibration.relation.deviation}"


def _or_more(calibration: "Calibration") -> str:
    """Return why errors may be larger than expected; empty if the residuals are the image's noise."""
    if not calibration.cause:
        return ""
    return (
        f", or more, since residuals are larger than noise, chi2 {number(calibration.adjustment.variance_factor, 2)}, "
        f"most likely because {calibration.cause}"
    )


def closing_sentence(calibration: "Calibration", printed: bool) -> str:
    """Return what is to be said of the files that were written: that they are not to be used, or that there are none.

    Empty if there is nothing to say; `printed` results may do without files.
    """
    if not calibration.to_use:
        files = (
            f"{', '.join(str(written.path) for written in calibration.written)}: written, but"
            if calibration.written
            else "the result is"
        )
        return f"{files} not to be used yet: see the first line"
    return "" if calibration.written or printed else "nothing was written: add -o measured.json"


def errors(error: ExpectedError) -> str:
    """Return both errors as words: ``0.025 deg and 0.11 mm``."""
    return f"{number(error.rotation_deg, 2)} deg and {number(1e3 * error.translation, 2)} mm"


def what_is_left(calibration: "Calibration") -> str:
    """Return what the error that is left comes from, the largest source first."""
    variances = {name: np.square(getattr(calibration.after, name)) for name in SOURCES}
    total = sum(variances.values())
    shares = {name: part / np.where(total > 0, total, 1.0) for name, part in variances.items()}
    parts = sorted(shares.items(), key=lambda part: -max(part[1]))
    listed = [
        f"{_WORDS[name]} (rotation {100 * rotation:.0f} %, translation {100 * move:.0f} %)"
        for name, (rotation, move) in parts
        if max(rotation, move) >= 0.005
    ]
    return f"The variance that is left comes from {', '.join(listed)}."


def photographs(calibration: "Calibration") -> list[str]:
    """Return how many photographs and dots took part and how well they fit, and which ones did not."""
    sightings, adjustment = calibration.sightings, calibration.adjustment
    used = len({int(k) for k in sightings.photo[calibration.used]})
    rejected = int(calibration.dropped.sum())
    sentences = [
        f"{len(calibration.chosen)} dots in {used} of {len(sightings.photos)} photographs; residuals "
        f"{adjustment.rms:.3f} px RMS, chi2 {adjustment.variance_factor:.2f} per degree of freedom; {rejected or 'no'} "
        f"dot{'s' * (rejected != 1)} rejected."
    ]
    return sentences + named_unused(unused(calibration))


def named_unused(photos: Sequence[tuple[str, str]]) -> list[str]:
    """Return a sentence on photographs that took no part, from their names and reasons; none without any."""
    named = "; ".join(f"{name}: {reason}" for name, reason in photos[:MOST_NAMED])
    more = f"; and {len(photos) - MOST_NAMED} more" if len(photos) > MOST_NAMED else ""
    return [f"Not used: {named}{more}."] if photos else []


def unused(calibration: "Calibration") -> list[tuple[str, str]]:
    """Return the photographs that took no part, with the reason of each, in the order of the photographs."""
    sightings = calibration.sightings
    reasons = dict(sightings.unused)
    taken = {int(k) for k in sightings.photo[calibration.used]}
    for k in sightings.photo.tolist():
        if k not in taken:
            reasons[k] = TOO_FEW
    return [(sightings.photos[k], reasons[k].rstrip(".")) for k in sorted(reasons)]


def far_points(camera: Camera, covariance: Array) -> str:
    """Return how well the camera is known over the image, and what helps where that is badly."""
    sigma = projection_uncertainty(camera, covariance)
    low, high = float(np.nanmin(sigma)), float(np.nanmax(sigma))
    accuracy = f"Where the camera sees a far point is known to {number(low, 2)} to {number(high, 2)} px over the image"
    return f"{accuracy}{': bring the marker into the corners, too' if high > _BADLY_PX else ''}."


def judged(calibration: "Calibration") -> list[str]:
    """Return what left-out photographs and two halves say, or why they could not be asked."""
    return [
        sentence(judgment.reason if isinstance(judgment, NotJudged) else judgment.verdict)
        for judgment in (calibration.cross_validation, calibration.halves)
    ]


def sentence(text: str) -> str:
    """Return text with a capital and a period."""
    return text[:1].upper() + text[1:].rstrip(".") + "."
