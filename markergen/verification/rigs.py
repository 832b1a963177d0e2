"""Check one file against a rig: a solid of the whole, or sheets that show its markers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.guard import read
from markergen.model.body import Plate
from markergen.model.marker import check_supported
from markergen.model.rig import Rig
from markergen.verification.check import (
    Check,
    best_check,
    changed,
    check_tolerance,
    copies,
    is_strange,
    with_tag,
)  # fmt: skip
from markergen.verification.findings import AGAIN
from markergen.verification.matching import DotSet, dots_of, expected_dots
from markergen.verification.reading import Page, Reading, reader_of, suffix_of
from markergen.verification.rig_solids import SUFFIXES, check_solid
from markergen.verification.words import Finding

Array = NDArray[np.float64]

SAME = 1e-3
"""Distance in mm below which dots of unknown size are one."""

SHEETS = (".pdf", ".svg", ".png", ".dxf")


def verify_rig(rig: Rig, path: Path, tolerance: float | None = None) -> Check:
    """Read a file back and compare every marker in it with a rig.

    In solids and models for simulators the markers' relation counts; sheets show each by itself, on any page.

    Parameters
    ----------
    tolerance : float or None
        As for a marker.

    Raises
    ------
    InputError
        If the file cannot be read, its format is unknown, or the tolerance is out of range.
    MissingLibraryError
        If the file is STEP or BREP and the CAD kernel is missing.
    """
    for each in rig.markers:
        check_supported(each.marker, "to verify a file against")
    check_tolerance(tolerance)
    reader, suffix = reader_of(path), suffix_of(path)
    if suffix not in (*SHEETS, *SUFFIXES):
        known = ", ".join((*SHEETS, *SUFFIXES))
        raise InputError(f"a sheet or a solid of a rig ({known})", str(path), "verify it against the one marker in it")
    designed = replace(rig, markers=tuple(replace(each, marker=each.marker.as_designed) for each in rig.markers))
    with np.errstate(all="ignore"):
        data = read(path, "artifact").data
        if suffix in SUFFIXES:
            return replace(check_solid(designed, suffix, data, str(path), tolerance), path=str(path))
        readings = [reader(data, str(path), each.marker) for each in rig.markers]
    return replace(_of_sheets(rig, readings, tolerance), path=str(path))


@dataclass(frozen=True, eq=False)
class _Shown:
    """A marker on a page: its index and that of the page, how many findings there are, and its dots (m, 2), mm."""

    marker: int
    page: int
    cost: tuple[int, float]
    dots: DotSet


def _of_sheets(rig: Rig, readings: Sequence[Reading], tolerance: float | None) -> Check:
    """Find every marker on some page, and check each as if the others were not there."""
    allowed, kind = readings[0].tolerance if tolerance is None else tolerance, readings[0].kind
    shown = _shown(rig.markers, readings, allowed)
    if not shown:
        return _none_found(rig, readings, allowed)
    findings, notes, checks = list[Finding](), list[str](), dict[str, Check]()
    for k, (each, reading) in enumerate(zip(rig.markers, readings, strict=True)):
        if k not in shown:
            findings.append(Finding("missing", f"{each.name} is missing: it is on no page", AGAIN))
            continue
        number = shown[k].page
        others = [one.dots for j, one in shown.items() if one.page == number and j != k]
        page = _without(reading.pages[number], others)
        checks[each.name] = best_check(each.marker, replace(reading, pages=(page,), papers=()), allowed)
        # In a net the outlines are folds, in dashes.
        own = [said for said in checks[each.name].findings if not others or said.kind != "outline"]
        findings += [replace(said, sentence=f"{each.name}: {said.sentence}") for said in own]
        notes += checks[each.name].notes
    worst = max(checks, key=lambda name: np.nan_to_num(checks[name].largest, nan=np.inf))
    scales = np.array([each.scale for each in checks.values()])
    return Check(
        "", kind, sum(each.dots for each in checks.values()), 1, checks[worst].largest,
        None if checks[worst].worst is None else f"{worst}/{checks[worst].worst}",
        (float(scales[:, 0].mean()), float(scales[:, 1].mean())),
        readings[0].papers or tuple(page.size for page in readings[0].pages), allowed, tuple(findings),
        tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _none_found(rig: Rig, readings: Sequence[Reading], tolerance: float) -> Check:
    """Check of sheets that show no marker of the rig, unless they are scaled as a whole."""
    for each, reading in zip(rig.markers, readings, strict=True):
        for page in reading.pages:
            alone = replace(reading, pages=(page,), papers=())
            found = changed(each.marker, alone, tolerance, best_check(each.marker, alone, tolerance))
            if not is_strange(found):
                findings = tuple(replace(one, sentence=f"{each.name}: {one.sentence}") for one in found.findings)
                return replace(found, findings=findings)
    remedy = "export it again, or verify it against its own rig"
    said = Finding("no dots", "no marker of the rig is in it", remedy)
    return Check("", readings[0].kind, tolerance=tolerance, findings=(said,))


def _shown(markers: Sequence[Plate], readings: Sequence[Reading], tolerance: float) -> dict[int, _Shown]:
    """Where each marker is shown, the one with the fewest findings first; dots belong to one marker only."""
    places = []
    for k, (each, reading) in enumerate(zip(markers, readings, strict=True)):
        wanted = expected_dots(each.marker)
        ids = [point.id for point in each.marker.control_points]
        for number, page in enumerate(reading.pages):
            dots = dots_of(page, wanted)
            verdicts = copies(wanted, ids, dots, tolerance, reading, page)
            if each.marker.tag is not None and reading.tagged:
                verdicts = with_tag(verdicts, each.marker.tag, (1.0, 1.0), page, tolerance)
            places += [
                _Shown(k, number, (len(one.findings), one.largest), dots.take(one.used))
                for one in verdicts
                if len(one.used)
            ]
    chosen: dict[int, _Shown] = {}
    for one in sorted(places, key=lambda one: one.cost):
        taken = [other.dots for other in chosen.values() if other.page == one.page]
        if one.marker not in chosen and not any(_near(one.dots.centers, dots).any() for dots in taken):
            chosen[one.marker] = one
    return chosen


def _without(page: Page, others: Sequence[DotSet]) -> Page:
    """Page without the circles of other markers' dots; with others, not all that is to be cut is the marker's."""
    for dots in others:
        page = replace(page, circles=page.circles[~_near(page.circles[:, :2], dots)], cut=None)
    return page


def _near(points: Array, dots: DotSet) -> NDArray[np.bool_]:
    """Tell which points (m, 2) lie in dots."""
    radii = np.nan_to_num(dots.radii, nan=SAME)
    return np.asarray((np.linalg.norm(points[:, None] - dots.centers, axis=-1) < radii).any(axis=1))
