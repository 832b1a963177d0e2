"""Check one file against a marker or a rig."""

# tests: tests/verification/test_check.py tests/verification/test_placement.py

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError, MissingLibraryError
from markergen.guard import read
from markergen.model.body import Body, Plate
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker, check_supported
from markergen.model.tag import Tag
from markergen.verification.findings import (
    AGAIN,
    UNTAGGED,
    Verdict,
    at_holes,
    change_findings,
    extras,
    judge,
    judge_copies,
    round_holes,
)
from markergen.verification.flat import flat_findings, informative
from markergen.verification.matching import DotSet, changes, dots_on_page, expected_dots, moved_page
from markergen.verification.reading import Page, Reading, Settings, reader_of
from markergen.verification.result import Check, is_strange
from markergen.verification.tags import ABSENT, tag_findings
from markergen.verification.words import MOST_LISTED, NO_PLATE, Finding

USUAL = Settings()
"""Nothing said."""

LACKING = {"no dots", "missing", "another marker", "tag", "outline", "hole"}
"""Kinds of findings that hidden layers explain."""

Wanted = tuple[Marker, tuple[float, float], str]
"""A marker as it may be drawn, the ratio of drawn to true lengths along x and y, and a note."""


def verify(body: Body, path: Path, settings: Settings = USUAL) -> Check:
    """Read a file back and compare everything in it with a marker or a rig.

    The dots of sheets and solids are aligned with the marker's by the best rotation and translation only: scaling and
    mirroring are reported as findings. In solids the relation of several plates counts; sheets show each by itself, on
    any page. Files that only markergen writes are made again and compared value by value. The default tolerance is
    20 um, which no printer shows, or a quarter of a pixel where that is more.

    Raises InputError if the file cannot be read, its format is unknown, the tolerance is out of range, or
    `check_supported` refuses; MissingLibraryError if the file is STEP or BREP and the CAD kernel is missing.
    """
    for plate in body.plates:
        check_supported(plate.marker, "to verify a file against")
    check_tolerance(settings.tolerance)
    reader = reader_of(path)
    # Numbers in a file that overflow become infinite and are left out.
    with np.errstate(all="ignore"):
        reading = reader(read(path, "artifact").data, str(path), body, settings)
        if isinstance(reading, Check):
            return replace(reading, path=str(path))
        allowed = reading.tolerance if settings.tolerance is None else settings.tolerance
        sheet = _several if body.frame != "marker" else _single
        return replace(sheet(body, reading, allowed), path=str(path), tolerance=allowed)


def check_tolerance(tolerance: float | None) -> None:
    """Refuse a tolerance in m that is not above 0 and below 1; None stands for the format's own."""
    if tolerance is not None and not 0 < tolerance < 1:
        raise InputError("a tolerance above 0 and below 1 m", f"{tolerance} m", "give a length such as 0.01mm")


def verify_all(check: Callable[[Path], Check], paths: Sequence[Path]) -> list[Check]:
    """Check every file; for one that cannot be used, `error` says why."""
    checks = []
    for path in paths:
        try:
            checks.append(check(path))
        except (InputError, MissingLibraryError) as error:
            checks.append(Check(str(path), error=str(error)))
    return checks


def best_check(marker: Marker, reading: Reading, tolerance: float) -> Check:
    """Check a reading as it is, as the design or as a print of it, whichever has fewer findings."""
    checks = [_against(wanted, reading, tolerance) for wanted in _wanted(marker)]
    return min(checks, key=lambda check: (bool(check.findings), np.nan_to_num(check.largest, nan=np.inf)))


def _single(body: Body, reading: Reading, tolerance: float) -> Check:
    """Check a sheet of a marker, perhaps scaled, stretched or sheared as a whole, if that explains more."""
    marker = body.plates[0].marker
    plain = best_check(marker, reading, tolerance)
    apart = sum(finding.kind == "shifted" for finding in plain.findings)
    if not is_strange(plain) and apart < min(len(marker) / 2, MOST_LISTED):
        return plain
    expected = expected_dots(marker)
    if any(page.of_any_size for page in reading.pages):
        larger = (replace(page, circles=page.of_any_size()) if page.of_any_size else page for page in reading.pages)
        reading = replace(reading, pages=tuple(larger))
    page = max(reading.pages, key=lambda page: len(page.circles))
    for undo, change in changes(page, expected):
        pages = tuple(moved_page(page, undo) for page in reading.pages)
        check = best_check(marker, replace(reading, pages=pages), tolerance)
        if is_strange(check) or check.kinds & {"shifted", "scaled"}:
            continue
        change_errors = change_findings(change, expected, 1e3 * tolerance, page.measured)
        # Lines and edges at the wrong scale mean nothing.
        rest = tuple(finding for finding in check.findings if finding.kind in ("mirrored", "missing", "kind", "extra"))
        scale = (float(change[0, 0]), float(change[1, 1]))
        return replace(check, largest=np.nan, worst=None, scale=scale, findings=(*change_errors, *rest))
    return plain


def _wanted(marker: Marker) -> list[Wanted]:
    """Return what the file may hold: the design, or a print of it with the printer's scale compensated."""
    design = marker.as_designed
    wanted: list[Wanted] = [(design, (1.0, 1.0), "")]
    if marker.print_scale != (1.0, 1.0):
        x, y = marker.print_scale
        mean, points = (x * y) ** 0.5, list[ControlPoint]()
        for point in design.control_points:
            feature = Feature(point.feature.diameter / mean, point.feature.inner_diameter / mean)
            points.append(replace(point, x=point.x / x, y=point.y / y, feature=feature))
        note = f"made for a printer that prints {100 * x:.6g} % along x and {100 * y:.6g} % along y"
        wanted.append((replace(design, control_points=tuple(points)), (1 / x, 1 / y), note))
    return wanted


def _against(wanted: Wanted, reading: Reading, tolerance: float) -> Check:
    marker, factor, note = wanted
    expected = expected_dots(marker)
    verdicts: list[Verdict] = []
    findings = [*reading.findings]
    findings += [
        Finding("twice", f"page {k + 1} is page {j + 1} again", "leave one of both")
        for k, page in enumerate(reading.pages)
        for j, earlier in enumerate(reading.pages[:k])
        if len(page.circles)
        and all(
            first.shape == second.shape and np.allclose(first, second, atol=1e-3)
            for first, second in ((page.circles, earlier.circles), (page.corners, earlier.corners))
        )
    ]
    holes = round_holes(marker)
    count = 0
    notes = [*reading.notes, *([note] if note else [])]
    for page in reading.pages:
        dots = dots_on_page(page, expected)
        # A page may have no dots, such as assembly instructions.
        if not len(dots) and len(reading.pages) > 1:
            continue
        first, *others = judge_copies(expected, dots, tolerance, upright=page.upright, pixels=page.measured)
        # Holes may be as many as the dots, and as large: they are not another marker.
        bored = at_holes(dots, first.motion, holes)
        here = [first, *(verdict for verdict in others if not bored[verdict.used].all())]
        bored[np.concatenate([verdict.used for verdict in here])] = False
        count += len(dots) - int(bored.sum())
        here = [with_tag(verdict, marker.tag, factor, page, tolerance) for verdict in here]
        here, of_page, remarks = flat_findings(marker, factor, page, dots, here, tolerance)
        findings += of_page
        notes += remarks
        verdicts += here
        explained_dots = np.concatenate([*(verdict.used for verdict in here), informative(page, dots)])
        findings += extras(dots, explained_dots, here[0].motion, holes)
    hidden = [layer for page in reading.pages for layer in page.hidden]
    verdicts = verdicts or [judge(expected, dots_on_page(reading.pages[0], expected), tolerance)]
    if len(verdicts) > 1 and not all("tag" in verdict.kinds for verdict in verdicts):
        # One has the right tag: others are those of a family of markers on one sheet.
        kept = [tuple(f for f in verdict.findings if not f.sentence.endswith(ABSENT)) for verdict in verdicts]
        verdicts = [replace(verdict, findings=findings) for verdict, findings in zip(verdicts, kept, strict=True)]
    if reading.alone and len(verdicts) > 1:
        findings.append(Finding("twice", f"the marker is there {len(verdicts)} times", "leave one of them"))
    worst = max(verdicts, key=lambda verdict: np.nan_to_num(verdict.largest, nan=np.inf))
    if hidden and any(verdict.kinds & LACKING for verdict in verdicts):
        findings.insert(0, Finding("hidden", f"not everything is visible: {', '.join(hidden)}", "show all layers"))
    of_copies = [
        finding.about(f"copy {k}") if len(verdicts) > 1 else finding
        for k, verdict in enumerate(verdicts, 1)
        for finding in verdict.findings
    ]
    return Check(
        "", reading.kind, count, sum(len(verdict.used) > 0 for verdict in verdicts), worst.largest,
        worst.worst, worst.scale, reading.papers or tuple(page.size for page in reading.pages),
        tolerance, (*findings, *of_copies), tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def with_tag(verdict: Verdict, tag: Tag | None, factor: tuple[float, float], page: Page, tolerance: float) -> Verdict:
    """Add findings about the tag, if there is one, to a verdict."""
    # Without the marker's dots the tag's position is not known.
    if tag is None or verdict.motion is None or verdict.kinds & UNTAGGED:
        return verdict
    errors = tag_findings(tag, page, verdict.motion._replace(factor=factor), 1e3 * tolerance)
    return replace(verdict, findings=(*verdict.findings, *errors))


# --- Sheets of several plates -----------------------------------------------------------------------------------------


class _PlateOnPage(NamedTuple):
    """A plate on a page: its index and that of the page, how many findings there are, and its dots."""

    plate: int
    page: int
    cost: tuple[int, float]
    dots: DotSet


def _several(body: Body, reading: Reading, tolerance: float) -> Check:
    """Find every plate on some page, and check each as if the others were not there."""
    places = _on_pages(body.plates, reading, tolerance)
    if not places:
        return _none_found(body, reading, tolerance)
    from markergen.drawing.paper_net import sheet_labels

    labels = sheet_labels(body)
    findings, notes, checks = list[Finding](), list[str](), dict[str, Check]()
    for k, plate in enumerate(body.plates):
        if k not in places:
            findings.append(Finding("missing", f"{plate.name} is missing: it is on no page", AGAIN))
            continue
        number = places[k].page
        neighbors = [place.dots for j, place in places.items() if place.page == number and j != k]
        page = replace(reading.pages[number], labels=labels[k])
        for dots in neighbors:
            # With others, not all that is to be cut is the plate's.
            page = replace(page, circles=page.circles[~_in_dots(page.circles[:, :2], dots)], are_cut=False)
        check = checks[plate.name] = best_check(plate.marker, replace(reading, pages=(page,), papers=()), tolerance)
        # In a net the outlines are folds, in dashes.
        judged = [finding for finding in check.findings if not neighbors or finding.kind != "outline"]
        findings += [finding.about(plate.name) for finding in judged]
        notes += check.notes
    worst = max(checks, key=lambda name: np.nan_to_num(checks[name].largest, nan=np.inf))
    x, y = np.mean([check.scale for check in checks.values()], axis=0).tolist()
    return Check(
        "", reading.kind, sum(check.dots for check in checks.values()), 1, checks[worst].largest,
        None if checks[worst].worst is None else f"{worst}/{checks[worst].worst}",
        (x, y), reading.papers or tuple(page.size for page in reading.pages), tolerance, tuple(findings),
        tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _none_found(body: Body, reading: Reading, tolerance: float) -> Check:
    """Check of sheets that show no plate of the body, unless they are scaled as a whole."""
    for plate in body.plates:
        for page in reading.pages:
            check = _single(plate.marker, replace(reading, pages=(page,), papers=()), tolerance)
            if not is_strange(check):
                return replace(check, findings=tuple(finding.about(plate.name) for finding in check.findings))
    return Check("", reading.kind, findings=(NO_PLATE,))


def _on_pages(plates: Sequence[Plate], reading: Reading, tolerance: float) -> dict[int, _PlateOnPage]:
    """Where each plate is shown, the one with the fewest findings first; dots belong to one plate only."""
    places = []
    for k, plate in enumerate(plates):
        expected = expected_dots(plate.marker)
        for number, page in enumerate(reading.pages):
            dots = dots_on_page(page, expected)
            verdicts = judge_copies(expected, dots, tolerance, upright=page.upright, pixels=page.measured)
            for verdict in verdicts:
                if len(verdict.used):
                    verdict = with_tag(verdict, plate.marker.tag, (1.0, 1.0), page, tolerance)
                    # To 10 um: plates may be alike but for their outlines, and are on the pages in their order.
                    cost = len(verdict.findings), round(verdict.largest, 5)
                    places.append(_PlateOnPage(k, number, cost, dots.take(verdict.used)))
    chosen: dict[int, _PlateOnPage] = {}
    for place in sorted(places, key=lambda place: place.cost):
        taken = [earlier.dots for earlier in chosen.values() if earlier.page == place.page]
        if place.plate not in chosen and not any(_in_dots(place.dots.centers, dots).any() for dots in taken):
            chosen[place.plate] = place
    return chosen


def _in_dots(points: Array, dots: DotSet) -> NDArray[np.bool_]:
    """Tell which points (m, 2) lie in dots."""
    return np.asarray((np.linalg.norm(points[:, None] - dots.centers, axis=-1) < dots.radii).any(axis=1))
