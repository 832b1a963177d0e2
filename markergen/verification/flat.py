"""Judge everything on a flat page but the places and sizes of its dots: layers, lines to cut, and what shows."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.verification.appearance import damaged_findings, lines_hidden, shown_findings
from markergen.verification.findings import AGAIN, Verdict
from markergen.verification.lines import (
    CutLine,
    among,
    in_picture,
    line_findings,
    plate_lines,
    sampled,
    sheet_lines,
    strays,
)
from markergen.verification.matching import CONCENTRIC, DotSet, expected_dots
from markergen.verification.picture import PagePicture
from markergen.verification.reading import Page
from markergen.verification.words import MOST_LISTED, Finding, listed_ids

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

QUIET = 2.2
"""Radius in which the outline may be interrupted, relative to that of the dot: the quiet zone, and rounding."""

SPECK = 1.6
"""Distance in mm from a quiet zone within which the rest of an outline, as at a corner, is too short to be drawn."""

CROSSED = 0.05
"""Share of a line where ticks and other lines that cross it may mislead its measurement in pixels."""

COARSEST = 0.2
"""Size in mm of pixels that show no hairlines, so that lines to cut cannot be compared."""

THIN = 0.05
"""Accuracy in mm with which a hairline is found in pixels, however fine they are: half of its width."""

DOTS_ON = "ENGRAVE"
"""Layer of a DXF on which dots are made as dots."""

TOLD_ON = "INFO"
"""Layer of a DXF of what is only told."""

STILL_TRUE = {"shifted", "missing", "diameter", "kind", "twice", "tag"}
"""Kinds of findings that leave the rest of the page comparable."""


def flat_findings(
    marker: Marker,
    factor: tuple[float, float],
    page: Page,
    found: DotSet,
    verdicts: Sequence[Verdict],
    tolerance: float,
) -> tuple[list[Verdict], list[Finding], list[str]]:
    """Add to the verdicts on the copies on a page what else is wrong with each; findings about the page; notes.

    Parameters
    ----------
    factor : (x, y)
        Ratio of drawn to true lengths.
    found : DotSet
        All dots of the page, mm.
    tolerance : float
        m.
    """
    judged, notes, strange = [], dict[str, None](), None
    tol = 1e3 * tolerance
    kinds = [sheet_lines(marker)]
    if page.layers:
        # A plate that cannot be made has no lines.
        with suppress(InputError):
            kinds.append(plate_lines(marker))
    for verdict in verdicts:
        if verdict.motion is None or not {each.kind for each in verdict.findings} <= STILL_TRUE:
            judged.append(verdict)
            continue
        said = _on_layers(page, found.take(verdict.used), verdict.names)
        lines, wanted = _lines(kinds, page, verdict.motion, expected_dots(marker), factor, tol)
        said += lines
        if page.picture is not None:
            around = _around(marker, wanted, verdict.motion, factor, tol + 1.5 * page.picture.grain)
            others = np.delete(np.arange(len(found)), verdict.used)
            crowd = np.column_stack([found.centers[others], found.radii[others]])
            shown, remarks = shown_findings(
                found.take(verdict.used), verdict.names, page.picture, verdict.motion, tol,
                np.concatenate([around, crowd]),
            )  # fmt: skip
            said += shown
            notes.update(dict.fromkeys(remarks))
        said += _unread(page, marker, verdict.motion, factor)
        misplaced = any(each.kind == "layer" for each in said)
        if page.cut is not None and page.lines is not None and not misplaced:
            own = strays(wanted, _to_marker(page.lines[page.cut], verdict.motion, factor))
            strange = own if strange is None else strange & own
        seen = verdict if page.picture is None else _explained(verdict, marker, page.picture)
        judged.append(replace(verdict, findings=(*seen.findings, *said)))
    extra = []
    if strange is not None and strange.any() and page.lines is not None:
        x, y = page.lines[page.cut][strange].mean(axis=1)[0]
        what = f"lines that are neither outline nor hole are to be cut, at x {x:.4g}, y {y:.4g} mm of the page"
        extra.append(Finding("outline", what, "remove them from the layer of the cuts"))
    return judged, extra, list(notes)


def _explained(verdict: Verdict, marker: Marker, picture: PagePicture) -> Verdict:
    """Replace the findings about missing dots where something shows at their places, or they are cropped."""
    ids = [point.id for point in marker.control_points]
    absent = [k for k, name in enumerate(ids) if name not in set(verdict.names)]
    if not absent or verdict.motion is None:
        return verdict
    seen = damaged_findings(expected_dots(marker), absent, picture, verdict.motion)
    kept = [each for each in verdict.findings if each.kind != "missing"]
    left = [ids[k] for k in absent if k not in seen]
    missing = [Finding("missing", f"{listed_ids(left)} missing", AGAIN)] if left else []
    named = [replace(each, sentence=each.sentence.replace(f"dot {k} ", f"dot {ids[k]} ")) for k, each in seen.items()]
    return replace(verdict, findings=(*kept, *missing, *named))


def _on_layers(page: Page, dots: DotSet, names: Sequence[int]) -> list[Finding]:
    """Dots on a layer that makes something else of them."""
    if not page.layers:
        return []
    wrong: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        on = _layers_of(page, dots, k)
        if DOTS_ON not in on:
            wrong.setdefault(sorted(on)[0] if on else "", []).append(name)
    findings = []
    for layer, ids in wrong.items():
        effect = " and would be cut out" if layer == "CUT" else ""
        remedy = f"move {'it' if len(ids) == 1 else 'them'} to the layer {DOTS_ON}"
        findings.append(Finding("layer", f"{listed_ids(ids)} on the layer {layer}{effect}", remedy))
    return findings


def only_told(page: Page, dots: DotSet) -> NDArray[np.intp]:
    """Indices of dots that are only drawn where nothing is made, such as keep-outs of their size."""
    told = [k for k in range(len(dots)) if _layers_of(page, dots, k) == {TOLD_ON}] if TOLD_ON in page.layers else []
    return np.array(told, dtype=np.intp)


def _layers_of(page: Page, dots: DotSet, k: int) -> set[str]:
    near = np.linalg.norm(page.circles[:, :2] - dots.centers[k], axis=1) < CONCENTRIC * dots.radii[k]
    size = np.abs(page.circles[:, 2] / dots.radii[k] - 1) < 0.05
    return {page.layers[index] for index in np.flatnonzero(near & size)}


def _unread(page: Page, marker: Marker, motion: tuple[Array, Array], factor: tuple[float, float]) -> list[Finding]:
    """Text, images and so on that may be over a dot or its quiet zone, or over the tag."""
    expected, findings = expected_dots(marker), []
    places = _to_page(expected.centers, motion, factor)
    ids = np.array([point.id for point in marker.control_points])
    tag = marker.tag
    for name, corners in page.unread:
        bounded = np.isfinite(corners).all()
        low, high = corners.min(axis=0), corners.max(axis=0)
        away = np.linalg.norm(places - np.clip(places, low, high), axis=1)
        near = ids[~(away >= 2 * expected.radii)].tolist() if bounded else []
        square = _to_page(1e3 * tag.corners[:, :2], motion, factor) if tag else np.zeros((0, 2))
        over = bounded and len(square) and (square.min(axis=0) <= high).all() and (square.max(axis=0) >= low).all()
        if bounded and not near and not over:
            continue
        dots = f"dot{'s' * (len(near) > 1)} {', '.join(map(str, near[:MOST_LISTED]))}" if near else ""
        covered = " and ".join(part for part in (dots, "the tag" if over else "") if part) or "the marker"
        remedy = "convert it to paths, or move it away" if name.startswith("the text") else "move it away"
        remedy = f"explode it, or move it to the layer {TOLD_ON}" if page.layers else remedy
        findings.append(Finding("covered", f"{name} is not read, and may cover {covered}", remedy))
    return findings


def _lines(
    kinds: Sequence[list[CutLine]], page: Page, motion: tuple[Array, Array], expected: DotSet,
    factor: tuple[float, float], tol: float,
) -> tuple[list[Finding], list[CutLine]]:  # fmt: skip
    """Findings about outline and holes, and the lines that are wanted: those of a sheet or of a plate."""
    if page.lines is None and page.picture is None:
        return [], kinds[0]

    def free(points: Array) -> Mask:
        radii = np.maximum(QUIET * expected.radii, 2 * expected.radii + SPECK)
        away = np.linalg.norm(points[:, None] - expected.centers, axis=2) - radii
        return np.asarray((away < 0).any(axis=1))

    if page.picture is not None:
        points = np.concatenate([sampled(line.contour)[0][::4] for line in kinds[0]])
        places = _to_page(points[~free(points)], motion, factor)
        if len(places) and np.isnan(page.picture.sample(places)).mean() > 0.01:
            said = "the outline reaches beyond the visible page: the page is cropped"
            return [Finding("hidden", said, "print or save the whole page")], kinds[0]
    if page.lines is not None:
        lines = page.lines if page.cut is None else page.lines[page.cut]
        seek = among(_to_marker(lines, motion, factor))
        allowed = tol
    else:
        assert page.picture is not None
        sample, grain = page.picture.sample, page.picture.grain
        seek = in_picture(lambda points: sample(_to_page(points, motion, factor)), grain)
        allowed = max(tol, grain / 2, THIN)
    if page.lines is None and page.picture is not None and page.picture.grain > COARSEST:
        return [], kinds[0]
    gaps = None if page.layers else free
    outliers = 0.0 if page.lines is not None else CROSSED
    results = [(line_findings(wanted, seek, allowed, gaps, outliers), wanted) for wanted in kinds]
    findings, wanted = min(results, key=lambda result: len(result[0]))
    seen = page.picture if page.lines is not None and not findings else None
    if seen is not None and len(places) and lines_hidden(places, seen):
        said = "the lines to cut do not show: their layer is switched off, or they are covered"
        findings = [Finding("hidden", said, "switch the layer cut on")]
    return findings, wanted


def _around(
    marker: Marker, wanted: Sequence[CutLine], motion: tuple[Array, Array], factor: tuple[float, float], spare: float
) -> Array:
    """Circles (m, 3) on the page that cover the tag and all lines to cut, which may be in quiet zones."""
    points = [sampled(line.contour)[0] for line in wanted]
    disks = [np.column_stack([each, np.full(len(each), 1.0 + spare)]) for each in points]
    if marker.tag is not None:
        grid = (np.stack(np.meshgrid(np.arange(9), np.arange(9)), axis=-1).reshape(-1, 2) - 4) / 8
        cells = 1e3 * (marker.tag.side * grid + marker.tag.center)
        disks.append(np.column_stack([cells, np.full(len(cells), 1e3 * marker.tag.side / 8 + spare)]))
    both = np.concatenate(disks) if disks else np.zeros((0, 3))
    return np.column_stack([_to_page(both[:, :2], motion, factor), both[:, 2]])


def _to_page(points: Array, motion: tuple[Array, Array], factor: tuple[float, float]) -> Array:
    return np.asarray(points * factor @ motion[0].T + motion[1])


def _to_marker(points: Array, motion: tuple[Array, Array], factor: tuple[float, float]) -> Array:
    return np.asarray((points - motion[1]) @ motion[0] / factor)
