"""Check one file against a marker or a rig.

Whatever the objects of a page say, a dot may be white, grey, covered, stroked, on a layer that is switched off, or
outside of the visible page. So layers, lines to cut, and what shows are judged beside places and sizes of the dots.
"""

# tests: tests/verification/test_check.py tests/verification/test_placement.py tests/verification/test_flat.py

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Indices, Mask
from markergen.drawing.colors import LEAST_CONTRAST
from markergen.errors import InputError, MissingLibraryError
from markergen.guard import read
from markergen.model.body import Body, Plate
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker, check_supported
from markergen.model.tag import Tag
from markergen.verification.findings import (
    ABSENT,
    AGAIN,
    BENT,
    UNTAGGED,
    PlaneMotion,
    Verdict,
    at_holes,
    change_findings,
    extras,
    judge,
    judge_copies,
    round_holes,
    tag_findings,
)
from markergen.verification.lines import (
    CutLine,
    in_picture,
    line_findings,
    pieces_of,
    plate_lines,
    sampled,
    seek_among,
    sheet_lines,
    strays,
)
from markergen.verification.matching import CONCENTRIC, DotSet, changes, dots_on_page, expected_dots, moved_page
from markergen.verification.printed import printed_findings
from markergen.verification.reading import WHITE, Page, PagePicture, Reading, Settings, reader_of
from markergen.verification.result import MOST_LISTED, NO_PLATE, Check, Finding, is_strange, listed_ids

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

INFO_ON = "INFO"
"""Layer of a DXF of what is drawn for information only."""

STILL_TRUE = {"shifted", "missing", "diameter", "kind", "twice", "tag"}
"""Kinds of findings that leave the rest of the page comparable."""


def flat_findings(
    marker: Marker,
    factor: tuple[float, float],
    page: Page,
    dots: DotSet,
    verdicts: Sequence[Verdict],
    tolerance: float,
) -> tuple[list[Verdict], list[Finding], list[str]]:
    """Add to the verdicts on the copies on a page what else is wrong with each; findings about the page; notes.

    `factor` is the ratio of drawn to true lengths along x and y, `dots` are all of the page, the tolerance is in m.
    """
    judged, notes = [], dict[str, None]()
    tol = 1e3 * tolerance
    to_cut = page.lines if page.are_cut and page.lines is not None else np.zeros((0, 2, 2))
    strange = to_cut[:0]
    kinds = [sheet_lines(marker)]
    if page.layers:
        # A plate that cannot be made has no lines.
        with suppress(InputError):
            kinds.append(plate_lines(marker))
    for verdict in verdicts:
        if verdict.motion is None or not verdict.kinds <= STILL_TRUE:
            judged.append(verdict)
            continue
        motion, drawn = verdict.motion, verdict.motion._replace(factor=factor)
        of_copy = replace(dots.take(verdict.used), names=verdict.expected.names)
        flaws = _on_layers(page, of_copy)
        lines, wanted = _lines(kinds, page, drawn, expected_dots(marker), tol)
        flaws += lines
        if page.picture is not None:
            around = _around(marker, wanted, drawn, tol + 1.5 * page.picture.grain)
            others = np.delete(np.arange(len(dots)), verdict.used)
            crowd = np.column_stack([dots.centers[others], dots.radii[others]])
            placed = _with_absent(of_copy, marker, drawn)
            appearance, remarks, absent = shown_findings(
                placed, len(of_copy), page.picture, motion, tol, np.concatenate([around, crowd])
            )
            flaws += appearance
            notes.update(dict.fromkeys(remarks))
            kept = tuple(finding for finding in verdict.findings if finding.kind != "missing")
            missing = (Finding("missing", f"{listed_ids(absent)} missing", AGAIN),) if absent else ()
            verdict = replace(verdict, findings=(*kept, *missing))
        flaws += _unread(page, marker, drawn)
        if len(to_cut) and not any(finding.kind == "layer" for finding in flaws):
            pieces = pieces_of([line.contour for line in wanted])
            to_cut = strange = to_cut[strays(drawn.to_marker(to_cut), pieces, misplaced=bool(lines))]
        if len(verdicts) == 1 and page.picture is not None and page.picture.whole and not (verdict.findings or flaws):
            flaws = printed_findings(marker, factor != (1.0, 1.0), page, motion, len(crowd) > 0)
        judged.append(replace(verdict, findings=(*verdict.findings, *flaws)))
    if page.lines is None and page.picture is not None and page.picture.bilevel:
        notes["a picture in black and white alone, which may lack grey lines to cut"] = None
    unclaimed, left_open = _unclaimed(page, marker, dots, judged, factor)
    extra = []
    for kind, wrong, what, remedy in (
        ("outline", strange, "lines that are neither outline nor hole are to be cut",
         "remove them from the layer of the cuts"),
        ("tag", left_open, "a side of the tag is not to be engraved", "close it, or export it again"),
        ("extra", unclaimed, "lines that are neither dot nor tag are to be engraved",
         f"remove them, or move them to the layer {INFO_ON}"),
    ):  # fmt: skip
        if len(wrong):
            x, y = wrong[0].mean(axis=0)
            extra.append(Finding(kind, f"{what}, at x {x:.4g}, y {y:.4g} mm of the page", remedy))
    return judged, extra, list(notes)


def _unclaimed(
    page: Page, marker: Marker, dots: DotSet, verdicts: Sequence[Verdict], factor: tuple[float, float]
) -> tuple[Array, Array]:
    """Lines to engrave (m, 2, 2) of neither a dot nor the tag, and sides (k, 2, 2) of the tag without a line, mm."""
    if page.engraved is None or any(verdict.findings for verdict in verdicts):
        return np.zeros((0, 2, 2)), np.zeros((0, 2, 2))
    motions = [verdict.motion._replace(factor=factor) for verdict in verdicts if verdict.motion is not None]
    tag = [1e3 * np.asarray(ring)[:, :2] for ring in marker.tag.outlines] if marker.tag is not None else []
    rings = [motion.to_page(ring) for ring in tag for motion in motions]
    around = np.exp(2j * np.pi * np.arange(60) / 60)
    for radii in (dots.radii, dots.inner):
        circles = radii[radii > 0, None] * around
        rings += list(dots.centers[radii > 0, None] + np.stack([circles.real, circles.imag], axis=-1))
    wanted = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    of_tag = wanted[: sum(map(len, tag)) * len(motions)]
    return page.engraved[strays(page.engraved, wanted)], of_tag[strays(of_tag, page.engraved)]


def _with_absent(dots: DotSet, marker: Marker, motion: PlaneMotion) -> DotSet:
    """The dots of a copy with those that were not found, at their places on the page."""
    expected = expected_dots(marker).take(~np.isin(marker.ids, dots.names))
    placed = replace(expected, centers=motion.to_page(expected.centers))
    columns = map(np.concatenate, zip(dots.columns, placed.columns, strict=True))
    return DotSet(*columns, names=(*dots.names, *placed.names))


def _on_layers(page: Page, dots: DotSet) -> list[Finding]:
    """Dots on a layer that makes something else of them."""
    if not page.layers:
        return []
    wrong: dict[str, list[int]] = {}
    for k, name in enumerate(dots.names):
        on = _layers_of(page, dots, k)
        if DOTS_ON not in on:
            wrong.setdefault(sorted(on)[0] if on else "", []).append(name)
    findings = []
    for layer, ids in wrong.items():
        effect = " and would be cut out" if layer == "CUT" else ""
        remedy = f"move {'it' if len(ids) == 1 else 'them'} to the layer {DOTS_ON}"
        findings.append(Finding("layer", f"{listed_ids(ids)} on the layer {layer}{effect}", remedy))
    return findings


def informative(page: Page, dots: DotSet) -> NDArray[np.intp]:
    """Indices of dots that are only drawn where nothing is made, such as keep-outs of their size."""
    indices = [k for k in range(len(dots)) if _layers_of(page, dots, k) == {INFO_ON}] if INFO_ON in page.layers else []
    return np.array(indices, dtype=np.intp)


def _layers_of(page: Page, dots: DotSet, k: int) -> set[str]:
    is_here = np.linalg.norm(page.circles[:, :2] - dots.centers[k], axis=1) < CONCENTRIC * dots.radii[k]
    size = np.abs(page.circles[:, 2] / dots.radii[k] - 1) < 0.05
    return {page.layers[index] for index in np.flatnonzero(is_here & size)}


def _unread(page: Page, marker: Marker, motion: PlaneMotion) -> list[Finding]:
    """Text, images and so on that may be over a dot or its quiet zone, or over the tag."""
    expected, tag, findings = expected_dots(marker), marker.tag, []
    places = motion.to_page(expected.centers)
    for name, corners in page.unread:
        bounded = np.isfinite(corners).all()
        low, high = corners.min(axis=0), corners.max(axis=0)
        away = np.linalg.norm(places - np.clip(places, low, high), axis=1)
        crossed = marker.ids[~(away >= 2 * expected.radii)].tolist() if bounded else []
        square = motion.to_page(1e3 * tag.corners[:, :2]) if tag else np.zeros((0, 2))
        over = bounded and len(square) and (square.min(axis=0) <= high).all() and (square.max(axis=0) >= low).all()
        if bounded and not crossed and not over:
            continue
        dots = f"dot{'s' * (len(crossed) > 1)} {', '.join(map(str, crossed[:MOST_LISTED]))}" if crossed else ""
        covered = " and ".join(part for part in (dots, "the tag" if over else "") if part) or "the marker"
        remedy = "convert it to paths, or move it away" if name.startswith("the text") else "move it away"
        remedy = f"explode it, or move it to the layer {INFO_ON}" if page.layers else remedy
        remedy = "delete it" if name.startswith("the layout") else remedy
        findings.append(Finding("covered", f"{name} is not read, and may cover {covered}", remedy))
    return findings


def _lines(
    kinds: Sequence[list[CutLine]], page: Page, motion: PlaneMotion, expected: DotSet, tol: float
) -> tuple[list[Finding], list[CutLine]]:
    """Findings about outline and holes, and the lines that are wanted: those of a sheet or of a plate."""

    def free(points: Array) -> Mask:
        radii = np.maximum(QUIET * expected.radii, 2 * expected.radii + SPECK)
        away = np.linalg.norm(points[:, None] - expected.centers, axis=2) - radii
        return np.asarray((away < 0).any(axis=1))

    if page.picture is not None:
        points = np.concatenate([sampled(line.contour)[0][::4] for line in kinds[0]])
        places = motion.to_page(points[~free(points)])
        if len(places) and np.isnan(page.picture.sample(places)).mean() > 0.01:
            sentence = "the outline reaches beyond the visible page: the page is cropped"
            return [Finding("hidden", sentence, "print or save the whole page")], kinds[0]
    if page.lines is not None:
        seek, allowed, outliers = seek_among(motion.to_marker(page.lines)), tol, 0.0
    elif page.picture is None or page.picture.grain > COARSEST or page.picture.bilevel:
        return [], kinds[0]
    else:
        sample, grain = page.picture.sample, page.picture.grain
        seek = in_picture(lambda points: sample(motion.to_page(points)), grain)
        allowed, outliers = max(tol, grain / 2, THIN), CROSSED
    gaps = None if page.layers else free
    results = [(line_findings(wanted, seek, allowed, gaps, outliers), wanted) for wanted in kinds]
    findings, wanted = min(results, key=lambda result: len(result[0]))
    seen = page.picture if page.lines is not None and not findings else None
    if seen is not None and len(places) and lines_hidden(places, seen):
        sentence = "the lines to cut do not show: their layer is switched off, or they are covered"
        findings = [Finding("hidden", sentence, "switch the layer cut on")]
    return findings, wanted


def _around(marker: Marker, wanted: Sequence[CutLine], motion: PlaneMotion, spare: float) -> Array:
    """Circles (m, 3) on the page that cover the tag and all lines to cut, which may be in quiet zones."""
    points = [sampled(line.contour)[0] for line in wanted]
    disks = [np.column_stack([line_points, np.full(len(line_points), 1.0 + spare)]) for line_points in points]
    if marker.tag is not None:
        grid = (np.stack(np.meshgrid(np.arange(9), np.arange(9)), axis=-1).reshape(-1, 2) - 4) / 8
        cells = 1e3 * (marker.tag.side * grid + marker.tag.center)
        disks.append(np.column_stack([cells, np.full(len(cells), 1e3 * marker.tag.side / 8 + spare)]))
    both = np.concatenate(disks) if disks else np.zeros((0, 3))
    return np.column_stack([motion.to_page(both[:, :2]), both[:, 2]])


# --- What shows -------------------------------------------------------------------------------------------------------

UNSEEN = 24.0
"""Difference of grey levels below which a dot does not show."""

ALIKE = 0.85
"""Minimum contrast of a dot as a share of that of the others."""

STRANGE = 0.3
"""Minimum difference from the ink, or from the paper, of what covers it, as a share of the contrast."""

COVERED, INKED, PALE_INKED = {False: 0.003, True: 0.025}, 0.003, 0.006
"""Maximum share of a dot, by whether it was measured in pixels, and of its quiet zone that may be strange: rounding.

The last is that of pale ink: with 0.003 the edges of an outline beside a dot of 36 mm count.
"""

TINT = 16.0
"""Difference in grey levels of paper from white, in a file of paths, below which it is not filled."""

STROKE = 0.15
"""Share of a dot that a white stroke may cover; what covers more is something else."""

PLACES, RAYS = 1000, 48
"""Number of places in and around a dot that are looked at, and of rays along which its edge is found."""

ACROSS = 0.35
"""Minimum distance in mm from the edge up to which a stroke is found."""

CROSS = 0.3
"""Half the width in mm of what is left out around the cross in the middle of the marker."""

LINE, FAINTEST = 0.3, 12.0
"""Distance in mm around a thin line where it must show, and the minimum range of grey levels there."""

PRINT_ALL = "export it again, and print the whole page with all layers"


def shown_findings(
    dots: DotSet,
    count: int,
    picture: PagePicture,
    motion: PlaneMotion,
    tolerance: float,
    around: Array,
) -> tuple[list[Finding], list[str], list[int]]:
    """Findings and notes about how a marker's dots show, and the ids of those of which nothing shows.

    The first `count` of the dots were found; the others are at the places where they should be. `around` (m, 3) has
    center and radius of everything else that may have ink in quiet zones, such as a tag. All is in mm.
    """
    names, edge = np.array(dots.names), tolerance + 1.5 * picture.grain
    outer = np.maximum(dots.radii - edge, (dots.radii + dots.inner) / 2)
    inner = np.where(dots.inner > 0, np.minimum(dots.inner + edge, outer), 0.0)
    on, off = _spread(dots.centers, inner, outer), _spread(dots.centers, dots.radii + edge, 2 * dots.radii)
    hole = _spread(dots.centers, 0 * inner, np.maximum(dots.inner - edge, 0.1 * dots.inner))
    ink, paper, middle = (picture.sample(sites.reshape(-1, 2)).reshape(len(dots), -1) for sites in (on, off, hole))
    covered_most = COVERED[picture.measured]
    hidden = np.isnan(ink).mean(axis=1) > COVERED[True]
    findings = []
    if hidden.any():
        sentence = f"{listed_ids(names[hidden].tolist())} outside the visible page: the page is cropped"
        findings.append(Finding("hidden", sentence, PRINT_ALL))
    # There may be a fine cross in the middle of the marker.
    for seen, sites in ((ink, on), (middle, hole)):
        seen[(np.abs(motion.to_marker(sites)) < CROSS).any(axis=2)] = np.nan
    crowd = np.concatenate([np.column_stack([dots.centers, dots.radii + edge]), around])
    for k in range(len(dots)):
        others = np.delete(crowd, k, axis=0)
        nearby = others[np.linalg.norm(others[:, :2] - dots.centers[k], axis=1) < 2 * dots.radii[k] + others[:, 2]]
        away = np.linalg.norm(off[k][:, None] - nearby[:, :2], axis=2) - nearby[:, 2]
        paper[k, (away < 0).any(axis=1)] = np.nan
    ground = np.array([_median(row) for row in paper])
    # A dot in a crowd takes the paper of the others.
    ground = np.where(np.isfinite(ground), ground, _median(np.append(ground, picture.paper)))
    # Grey level of a dot, even if half of it is covered.
    inked = np.abs(np.nan_to_num(ink - ground[:, None])) > UNSEEN
    counted = np.where(inked.mean(axis=1, keepdims=True) > 0.1, inked, True)
    level = np.array([_median(row[chosen]) for row, chosen in zip(ink, counted, strict=True)])
    is_found = np.arange(len(dots)) < count
    visible = np.flatnonzero(~hidden & (is_found | (np.abs(ground - level) >= UNSEEN)))
    unexplained = ~is_found & ~hidden
    if not len(visible):
        return findings, [], names[unexplained].tolist()
    ground, level = ground[visible], level[visible]
    contrast_findings, notes, good = _contrasts(ground - level, names[visible], picture)
    unexplained[visible[np.abs(ground - level) < ALIKE * np.abs(ground - level).max()]] = False
    findings += contrast_findings
    filled = WHITE - picture.paper > TINT and not picture.measured
    if filled and not any(finding.kind == "inverted" for finding in contrast_findings):
        sentence = f"the page is filled: its paper has the grey level {picture.paper:.0f} of 255"
        findings.append(Finding("extra", sentence, "remove what is drawn over the whole page"))
    for place in np.flatnonzero(good):
        k, levels = int(visible[place]), (float(level[place]), float(ground[place]))
        if not picture.whole and is_found[k]:
            continue
        is_round = is_found[k] and dots.rough[k] <= tolerance + BENT * dots.radii[k]
        stroked = (
            _edges(names[k], dots.take(np.array([k])), picture, levels, tolerance)
            if is_round and not picture.measured
            else []
        )
        most = STROKE if stroked else covered_most
        if dots.inner[k] > 0 and (np.abs(np.nan_to_num(middle[k] - ground[place])) > UNSEEN).mean() > covered_most:
            findings.append(Finding("kind", f"the middle of ring {names[k]} shows ink", "draw it as a ring"))
        more = _covers(names[k], ink[k], paper[k], motion.to_marker(off[k]), levels, most)
        covered = any(finding.kind == "covered" for finding in more)
        findings += more if covered else stroked or more
        unexplained[k] &= not covered
    return findings[: 2 * MOST_LISTED], notes, names[unexplained].tolist()


def _spread(centers: Array, low: Array, high: Array) -> Array:
    """Places (m, PLACES, 2) spread evenly over the areas between two circles around each center."""
    number = np.arange(PLACES) + 0.5
    radius = np.sqrt(low[:, None] ** 2 + (high**2 - low**2)[:, None] * number / PLACES)
    angle = number * np.pi * (3 - 5**0.5)
    return centers[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _median(values: Array) -> float:
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if len(kept) else np.nan


def _contrasts(contrast: Array, names: Indices, picture: PagePicture) -> tuple[list[Finding], list[str], Mask]:
    """Findings about dots that do not show, are pale, or inverted; notes; and a mask of the others."""
    strength = np.abs(contrast)
    unseen = strength < UNSEEN
    if unseen.all() and len(names) > 1:
        sentence = "no dot shows: their layer is switched off, or they are white or covered"
        return [Finding("hidden", sentence, "switch the layer dots on")], [], ~unseen
    findings = []
    if unseen.any():
        sentence = f"{listed_ids(names[unseen].tolist())} invisible: white, covered, or on a layer that is switched off"
        findings.append(Finding("pale", sentence, "make it black, and remove what covers it"))
    usual = float(np.median(strength[~unseen])) if (~unseen).any() else 0.0
    pale = ~unseen & (strength < ALIKE * strength.max())
    for name, share in zip(names[pale], strength[pale] / strength.max(), strict=True):
        sentence = f"dot {name} is grey: {100 * share:.0f} % as dark as the darkest dot"
        findings.append(Finding("pale", sentence, "give all dots the same ink"))
    if usual < LEAST_CONTRAST and (~unseen).any():
        sentence = f"all dots are pale: {usual:.0f} of 255 grey levels from their ground"
        findings.append(Finding("pale", sentence, f"use at least {LEAST_CONTRAST}"))
    light = ~unseen & (contrast < 0)
    notes = []
    if light.sum() == (~unseen).sum() > 0:
        # A printed ground has paper around it; a file that was inverted has none.
        if picture.paper > 255 / 2:
            notes.append("light dots on a dark ground, as made with --colors inverted")
        else:
            remedy = "invert it back, or export it with --colors inverted if light dots are meant"
            findings.append(Finding("inverted", "light and dark are swapped: even the paper is dark", remedy))
    elif light.any():
        sentence = f"{listed_ids(names[light].tolist())} light on a dark ground, unlike the others"
        findings.append(Finding("inverted", sentence, "export it again"))
    return findings, notes, ~unseen & ~light if not light.all() else ~unseen


def _covers(
    name: int, ink: Array, paper: Array, places: Array, levels: tuple[float, float], most: float
) -> list[Finding]:
    """Findings about what covers more than a share `most` of a dot, or is in its quiet zone, at `places`."""
    level, ground = levels
    step = STRANGE * abs(ground - level)
    findings = []
    seen = ink[np.isfinite(ink)]
    share = float((np.abs(seen - level) > step).mean()) if len(seen) else 0.0
    if share > most:
        sentence = f"{100 * share:.2g} % of dot {name} is covered or missing"
        findings.append(Finding("covered", sentence, "remove what is drawn over it"))
    away = np.abs(np.nan_to_num(paper - ground))
    inked = away > (step if (away > step).mean() > INKED else UNSEEN)
    if inked.mean() > (INKED if (away > step).mean() > INKED else PALE_INKED):
        x, y = places[inked].mean(axis=0)
        sentence = f"there is ink in the quiet zone of dot {name}, around x {x:.4g}, y {y:.4g} mm"
        findings.append(Finding("quiet", sentence, "keep a ring half a diameter wide around each dot free"))
    return findings


def lines_hidden(points: Array, picture: PagePicture) -> bool:
    """Tell whether most of points (m, 2) on thin lines do not show."""
    reach = np.linspace(-LINE, LINE, 9)
    cross = np.concatenate([np.stack([reach, 0 * reach], axis=-1), np.stack([0 * reach, reach], axis=-1)])
    seen = picture.sample((points[:, None] + cross).reshape(-1, 2)).reshape(len(points), -1)
    seen = seen[np.isfinite(seen).all(axis=1)]
    return bool(len(seen) and (np.ptp(seen, axis=1) < FAINTEST).mean() > 0.5)


def _edges(
    name: int, dot: DotSet, picture: PagePicture, levels: tuple[float, float], tolerance: float
) -> list[Finding]:
    """Finding about a dot whose edge shows elsewhere than its outline is, as with a stroke."""
    radius, center = float(dot.radii[0]), dot.centers[0]
    width = min(max(4 * picture.grain, ACROSS), 0.18 * radius)
    if width < 3 * picture.grain:
        return []
    angle = 2 * np.pi * (np.arange(RAYS) + 0.5) / RAYS
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # Each ray starts a little farther out, so that together they resolve a fraction of a step.
    steps = (np.arange(64)[None] + (np.arange(RAYS) / RAYS)[:, None]) / 64 * 2 * width - width
    seen = picture.sample((center + (radius + steps)[..., None] * directions[:, None]).reshape(-1, 2)).reshape(RAYS, -1)
    level, ground = levels
    share = np.clip((seen - ground) / (level - ground), 0, 1)
    edge_radius = radius - width + 2 * width * float(np.nanmedian(np.nanmean(share, axis=1)))
    if abs(edge_radius - radius) <= max(tolerance, 0.12 * picture.grain):
        return []
    sentence = f"dot {name} shows with a diameter of {2 * edge_radius:.4g} mm, not {2 * radius:.6g} mm"
    return [Finding("diameter", f"{sentence}: its edge has a stroke, or is blurred or covered", "remove what is there")]


# --- The file ---------------------------------------------------------------------------------------------------------

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
    for k, (marker, factor, _) in [(k, wanted) for k, plate in enumerate(plates) for wanted in _wanted(plate.marker)]:
        expected = expected_dots(marker)
        for number, page in enumerate(reading.pages):
            dots = dots_on_page(page, expected)
            verdicts = judge_copies(expected, dots, tolerance, upright=page.upright, pixels=page.measured)
            for verdict in verdicts:
                if len(verdict.used):
                    verdict = with_tag(verdict, marker.tag, factor, page, tolerance)
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
