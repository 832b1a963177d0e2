"""Rescaling for a print of another size: the marker with its control points at their places in the print."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, isfinite
from types import MappingProxyType
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.maths.rotation import rigid_motion
from markergen.model.body import Body
from markergen.model.marker import ControlPoint, JointCovariance, Marker, check_supported
from markergen.units import format_length

MOST_OFF = 0.05
"""Relative error of a length above which something else was probably measured."""

LONGEST = 3.0
"""Length that may be measured on a sheet, in diameters of the circle around the marker."""

WIDEST = 0.5
"""Range of scales that marker.json supports: from this to its inverse."""

POOR_FIT = 2.0
"""chi2 per degree of freedom above which photographs of a print fit worse than their noise: those of which camera and
print are right have 0.9 to 1.4, those with a lens model that lacks a coefficient 7 and more."""

RULERS_MM = (200, 150, 100, 50, 20)
"""Lengths of the rulers on a sheet, in mm: the longest that has room.

No measured length is within `MOST_OFF` of two of them, so it shows which of them was measured.
"""


@dataclass(frozen=True)
class MeasuredDot:
    """Center of a dot as measured on a print, in m, in any frame; covariance (xx, xy, yy) in m^2 or None."""

    id: int
    x: float
    y: float
    covariance: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Rulers:
    """Measured lengths in m of a print's rulers, None if not measured, and the lengths printed beside them.

    A nominal length that is not given is the one of `RULERS_MM` that is within `MOST_OFF` of the measured length.
    """

    x: float | None
    y: float | None
    nominal_x: float | None = None
    nominal_y: float | None = None


def rescale_body(
    body: Body, rulers: Rulers, force: bool = False, others: Mapping[str, Rulers] = MappingProxyType({})
) -> tuple[Body, tuple[str, ...]]:
    """Rescale a marker, or the markers of a rig, for a print whose rulers are off; with sentences about the result.

    Every control point moves to (x sx, y sy), s being measured over nominal lengths; a single measured ruler gives
    both. They are relative to the design: a second rescaling replaces the first. The plates of a rig stay where they
    are, each rescaled about its own origin: their markers were printed at another size, not the body.

    Parameters
    ----------
    others : mapping
        Rulers of single markers, by name, instead of those of all.

    Raises
    ------
    InputError
        If a length is not above 0, differs from its nominal by `MOST_OFF` or more without `force`, or by a factor of
        2, or no nominal length is given and none is that near; if nothing was measured; if dots have been measured one
        by one; if the nominal length is not the one that the marker states for its ruler; or if a name is none of the
        rig's. Also as `check_supported` does.
    """
    names = [plate.name for plate in body.plates]
    unknown = [name for name in others if name not in names]
    if unknown:
        raise InputError("the name of a marker of the rig", brief(unknown[0]), among(unknown[0], names))
    rescaled = {plate.name: _rescaled(plate.marker, others.get(plate.name, rulers), force) for plate in body.plates}
    names_of = dict[tuple[str, ...], list[str]]()
    for name, (_, sentences) in rescaled.items():
        names_of.setdefault(sentences, []).append(name)
    remarks = [
        " ".join(lines) if len(names_of) == 1 else f"{', '.join(which)}: {' '.join(lines)}"
        for lines, which in names_of.items()
    ]
    if body.frame == "marker":
        remarks = [*next(iter(names_of))]
    changed = tuple(replace(plate, marker=rescaled[plate.name][0]) for plate in body.plates)
    reach = _reach([plate.marker for plate in changed])
    return body.with_plates(changed, body.relation_covariance), (*remarks, *reach)


def exchanged(rulers: Rulers, printed: Collection[tuple[float, float]]) -> tuple[float, float] | None:
    """Return the rulers (x, y) in m of a sheet, of those that may be, that fit if x and y were measured for each other.

    None if a sheet fits as they are, none fits, or only one ruler was measured.
    """
    x, y = rulers.x, rulers.y
    if x is None or y is None:
        return None
    sheets = [sheet for sheet in printed if all(sheet)]
    if any(not _off(x / sheet[0]) and not _off(y / sheet[1]) for sheet in sheets):
        return None
    return next((sheet for sheet in sheets if not _off(y / sheet[0]) and not _off(x / sheet[1])), None)


def check_not_exchanged(rulers: Rulers, printed: Collection[tuple[float, float]]) -> None:
    """Refuse lengths that are `exchanged`; raises InputError."""
    swapped = exchanged(rulers, printed)
    if swapped is not None and rulers.x is not None and rulers.y is not None:
        (x, y), (u, v) = (map(format_length, lengths) for lengths in (swapped, (rulers.x, rulers.y)))
        raise InputError(
            f"rulers as on the sheet, x {x} and y {y}",
            f"x {u} and y {v}",
            "are x and y exchanged? If not, --nominal-x and --nominal-y have the lengths printed beside them",
        )


def _rescaled(marker: Marker, rulers: Rulers, force: bool) -> tuple[Marker, tuple[str, ...]]:
    check_supported(marker, "to rescale")
    if any(point.designed or point.designed_z is not None for point in marker.control_points):
        raise InputError(
            "a marker whose dots were not measured one by one",
            "one with measured dots",
            "rescale the marker.json that was designed",
        )
    measured = {name: getattr(rulers, name) for name in "xy"}
    nominal = {name: getattr(rulers, f"nominal_{name}") for name in "xy"}
    stated = dict(zip("xy", marker.rulers or (None, None), strict=True))
    x, y = (nominal[name] if nominal[name] is not None else stated[name] for name in "xy")
    if x is not None and y is not None and not force:
        check_not_exchanged(rulers, [(x, y)])
    lengths = {
        name: _nominal(name, length, nominal[name], stated[name], force)
        for name, length in measured.items()
        if length is not None
    }
    most = max(LONGEST * 2 * marker.boundary.radius, RULERS_MM[0] / 1e3)
    for name, length in lengths.items():
        if length > most * (1 + 1e-9):
            raise InputError(
                f"a length along {name} that is on the sheet, at most {format_length(float(f'{most:.2g}'))}",
                format_length(length),
                "give it with its unit, such as 149.7mm: a bare number is in meters",
            )
    ratios = {name: measured[name] / lengths[name] for name in lengths}
    if not ratios:
        raise InputError("a measured length", "none", "give --measured-x, --measured-y or --measured-points")
    scale = ratios.get("x", ratios.get("y", 1.0)), ratios.get("y", ratios.get("x", 1.0))
    changed = _scaled(marker.as_designed, scale)
    points = tuple(
        replace(p, measured=before.measured)
        for p, before in zip(changed.control_points, marker.control_points, strict=True)
    )
    record = {
        "measured_x": rulers.x,
        "measured_y": rulers.y,
        "nominal_x": lengths.get("x"),
        "nominal_y": lengths.get("y"),
    }
    sentences = [
        f"The print is {_percent(scale[0])} of the design along x and {_percent(scale[1])} along y: "
        + ", ".join(f"{name} {format_length(measured[name])} of {format_length(lengths[name])}" for name in ratios)
        + "."
    ]
    taken = [
        f"--nominal-{name} {format_length(lengths[name]).replace(' ', '')}"
        for name in ratios
        if nominal[name] is None and stated[name] is None
    ]
    if taken:
        sentences.append(f"This assumes {' and '.join(taken)}; if another length is printed beside a ruler, give that.")
    if rulers.x is None or rulers.y is None:
        axis, other_axis = ("x", "y") if rulers.y is None else ("y", "x")
        sentences.append(
            f"Only {axis} was measured and stands for {other_axis}, too; printers often differ between the two."
        )
    if marker.print_scale != (1.0, 1.0):
        x, y = map(_percent, marker.print_scale)
        sentences.append(f"It takes the place of the earlier {x} and {y}: both are of the design.")
    return _recorded(replace(changed, control_points=points), "rulers", record), tuple(sentences)


def _reach(markers: Sequence[Marker]) -> list[str]:
    """Say how far rescaled dots are from where they were designed."""
    scales = [np.array(marker.print_scale) - 1 for marker in markers]
    moved = [m.as_designed.xyz[:, :2] * off for m, off in zip(markers, scales, strict=True) if off.any()]
    if not moved:
        return []
    reach = max(float(np.linalg.norm(offsets, axis=-1).max()) for offsets in moved)
    return [f"Dots are up to {_short(reach)} from where they were designed."]


def remeasure(marker: Marker, dots: tuple[MeasuredDot, ...], force: bool = False) -> tuple[Marker, tuple[str, ...]]:
    """Move the dots of a marker to their measured places in the print, and return it with sentences about the result.

    The measured places may be in any frame: the rigid motion that best aligns them with the design, with equal weights,
    transforms them and their covariances to the marker frame. Dots measured before and not now keep their place.

    Raises
    ------
    InputError
        If fewer than two dots were measured, one is unknown or repeated, all are at one place, they are mirrored, or
        one is off by more than `MOST_OFF` of the farthest dot's distance from the middle, or by a dot's radius, without
        `force`. Also as `check_supported` does.
    """
    check_supported(marker, "to measure dots of")
    if marker.joint_covariance is not None:
        raise InputError(
            "a marker whose dots were not measured by photographs",
            "one that markergen calibrate wrote",
            "measure the marker.json that was designed, and calibrate that",
        )
    here = {point.id: point for point in marker.control_points}
    unknown = [dot.id for dot in dots if dot.id not in here]
    if unknown:
        listed = ", ".join(map(str, here)) if len(here) <= 20 else f"{min(here)} to {max(here)}"
        raise InputError("ids of the marker's dots", f"id {unknown[0]}", f"the marker has {listed}")
    if len({dot.id for dot in dots}) < len(dots):
        raise InputError("every dot once", "an id twice", "give the mean of several measurements")
    if len(dots) < 2:
        raise InputError("two measured dots or more", f"{len(dots)}", "one alone does not show how the frame is turned")
    measured = np.array([[dot.x, dot.y] for dot in dots])
    # Scale known without measuring dots: that of the rulers, if they were read.
    expected = np.array([_expected(here[dot.id], marker) for dot in dots])
    reach = float(np.linalg.norm(expected - expected.mean(axis=0), axis=-1).max())
    if not np.isfinite(measured).all() or not 0 < float(np.linalg.norm(np.ptp(measured, axis=0))) < 1e3:
        raise InputError("measured places apart from each other", "all at one place, or km apart", "check the unit")
    rotation, translation = rigid_motion(measured, expected)
    moved = measured @ rotation.T + translation
    off = np.linalg.norm(moved - expected, axis=-1)
    worst = int(np.argmax(off))
    # The tolerance on scale, at the outermost dot: a share of its distance from the middle.
    allowed = min(MOST_OFF * reach, here[dots[worst].id].feature.diameter / 2 or np.inf)
    if off[worst] >= allowed and not force:
        reflection, there = rigid_motion(measured, expected, mirror=True)
        mirrored = np.linalg.norm(measured @ reflection.T + there - expected, axis=-1).max()
        remedy = (
            "they are mirrored: x is right and y is up on the print"
            if mirrored < allowed
            else "check ids and unit, or add --force"
        )
        actual = f"dot {dots[worst].id} {_short(float(off[worst]))} from its place"
        raise InputError(f"measured dots within {_short(float(allowed))} of the design", actual, remedy)
    places = {dot.id: (place, _rotated(dot, rotation)) for dot, place in zip(dots, moved.tolist(), strict=True)}
    points = tuple(
        _placed(point, marker, *places[point.id]) if point.id in places else point for point in here.values()
    )
    sentences = [*_fit_sentences(dots, rotation, expected.mean(axis=0) - measured.mean(axis=0), off)]
    missing = [point.id for point in marker.control_points if point.id not in places]
    if missing:
        verb = (
            "was not measured and keeps its place" if len(missing) == 1 else "were not measured and keep their places"
        )
        sentences.append(f"{'Dot' if len(missing) == 1 else 'Dots'} {', '.join(map(str, missing))} {verb}.")
    record = {
        "ids": [dot.id for dot in dots],
        "frame_turned": float(np.arctan2(rotation[1, 0], rotation[0, 0])),
        "frame_moved": [float(value) for value in translation],
    }
    return _recorded(replace(marker, control_points=points), "points", record), tuple(sentences)


def photographed(
    marker: Marker, ids: Sequence[int], places: Array, covariance: Array, record: Mapping[str, Any]
) -> Marker:
    """Move dots of a marker to where photographs of the print show them.

    Parameters
    ----------
    marker : Marker
        As designed, rescaled, or with dots measured by hand, which took part in the adjustment.
    ids : sequence of int
        Ids of the k dots that were measured; the others keep their places.
    places : array (k, 3), m
        Places in the marker frame.
    covariance : array (3 k, 3 k), m^2
        Covariance of all of them together, x y z of each in turn.
    record : mapping
        Plain JSON values about the photographs, for the provenance.
    """
    measured = dict(zip(ids, np.round(places, 12).tolist(), strict=True))

    def moved(point: ControlPoint) -> ControlPoint:
        if point.id not in measured:
            return replace(point, covariance=None)
        x, y, z = measured[point.id]
        designed = point.designed or (
            round(point.x / marker.print_scale[0], 12),
            round(point.y / marker.print_scale[1], 12),
        )
        height = point.z if point.designed_z is None else point.designed_z
        return replace(point, x=x, y=y, z=z, covariance=None, designed=designed, designed_z=height)

    joint = JointCovariance(tuple(ids), "xyz", tuple(map(tuple, ((covariance + covariance.T) / 2).tolist())))
    points = tuple(moved(point) for point in marker.control_points)
    return _recorded(replace(marker, control_points=points, joint_covariance=joint), "photographs", record)


def poor_fit_sentence(body: Body) -> str:
    """Return a sentence on photographs of a print that fit worse than their noise; empty if they fit, or for others."""
    of_plates = [plate.marker.provenance.get("print") for plate in body.plates]
    taken = [stored.get("photographs") for stored in of_plates if isinstance(stored, Mapping)]
    factors = [record.get("variance_factor") for record in taken if isinstance(record, Mapping)]
    worst = max((factor for factor in factors if isinstance(factor, int | float)), default=0.0)
    if worst <= POOR_FIT:
        return ""
    return (
        f"the photographs that measured the print fit worse than their noise, chi2 {worst:.2g} per degree of freedom: "
        "errors may be larger than claimed"
    )


def scale_sigmas(marker: Marker, unmeasured: float, ruler_sigma: float) -> tuple[float, float]:
    """Return the standard deviations, as shares, of a print's scale along x and y.

    Parameters
    ----------
    unmeasured : float
        That of an axis whose ruler was not measured.
    ruler_sigma : float, m
        That of the length of a ruler, which `rescale_body` took.
    """
    print_record = marker.provenance.get("print")
    record = print_record.get("rulers") if isinstance(print_record, Mapping) else None
    rulers = record if isinstance(record, Mapping) else {}
    lengths = [rulers.get(f"nominal_{name}") if rulers.get(f"measured_{name}") else None for name in "xy"]
    # Provenance is what a file says.
    x, y = (ruler_sigma / length if isinstance(length, float) and length > 0 else unmeasured for length in lengths)
    return x, y


def by_rulers(marker: Marker) -> Marker:
    """Return a marker as its rulers alone show it, without what was measured of its dots."""
    return _scaled(marker.as_designed, marker.print_scale)


def _scaled(nominal: Marker, scale: tuple[float, float]) -> Marker:
    points = tuple(replace(p, x=p.x * scale[0], y=p.y * scale[1]) for p in nominal.control_points)
    return replace(nominal, control_points=points, print_scale=scale)


def _nominal(name: str, measured: float, requested: float | None, stated: float | None, force: bool) -> float:
    """Nominal length in m of a ruler: as given, as the marker states it, or as the measured length shows.

    Raises as `rescale_body` does.
    """
    nominal = requested if requested is not None else stated
    if nominal is not None and not (isfinite(nominal) and nominal > 0):
        raise InputError(
            f"a ruler along {name} above 0", f"nominal_{name}={nominal} m", "give the length it is marked with"
        )
    if requested is not None and stated is not None and abs(requested - stated) > 1e-9:
        raise InputError(
            f"the length of the ruler along {name} as the sheet has it, {format_length(stated)}",
            f"nominal_{name}={format_length(requested)}",
            f"give --nominal-{name} {format_length(stated).replace(' ', '')}",
        )
    if not (isfinite(measured) and measured > 0):
        raise InputError(f"a measured length along {name} above 0", f"{measured} m", "give a length such as 198.6mm")
    if nominal is None:
        rulers = [length / 1e3 for length in RULERS_MM if not _off(measured / length * 1e3)]
        if not rulers:
            choices = f"{', '.join(map(str, RULERS_MM[:-1]))} or {RULERS_MM[-1]} mm"
            raise InputError(
                f"a length along {name} within {100 * MOST_OFF:g} % of a sheet's ruler, {choices}",
                format_length(measured),
                f"check the unit; or give --nominal-{name}, the length stated on the sheet, of a ruler or of dots, "
                "and --force if it is off",
            )
        return rulers[0]
    scale = measured / nominal
    actual = f"{format_length(measured)}, which is {100 * (scale - 1):+.2f} %"
    expected = f"about {format_length(nominal)} along {name}, as long as the ruler on the sheet is"
    another = f"give --nominal-{name} if the ruler is another" if stated is None else "measure that ruler"
    if not WIDEST <= scale <= 1 / WIDEST:
        raise InputError(expected, actual, f"check the unit, or {another}")
    if _off(scale) and not force:
        raise InputError(expected, actual, f"{another}, or add --force")
    return nominal


def _off(scale: float) -> bool:
    # Rounding in a length such as 190mm must not decide; what is no number is off.
    return not abs(scale - 1) <= MOST_OFF - 1e-9


def _expected(point: ControlPoint, marker: Marker) -> tuple[float, float]:
    if point.designed is None:
        return point.x, point.y
    return point.designed[0] * marker.print_scale[0], point.designed[1] * marker.print_scale[1]


def _placed(
    point: ControlPoint, marker: Marker, place: list[float], covariance: tuple[float, float, float] | None
) -> ControlPoint:
    x, y = _expected(point, marker)
    designed = point.designed or (round(x / marker.print_scale[0], 12), round(y / marker.print_scale[1], 12))
    return replace(point, x=round(place[0], 12), y=round(place[1], 12), covariance=covariance, designed=designed)


def _rotated(dot: MeasuredDot, rotation: Array) -> tuple[float, float, float] | None:
    if dot.covariance is None:
        return None
    xx, xy, yy = dot.covariance
    rotated = rotation @ np.array([[xx, xy], [xy, yy]]) @ rotation.T
    return float(rotated[0, 0]), float(rotated[0, 1]), float(rotated[1, 1])


def _fit_sentences(dots: tuple[MeasuredDot, ...], rotation: Array, moved: Array, off: Array) -> list[str]:
    angle = degrees(float(np.arctan2(rotation[1, 0], rotation[0, 0])))
    worst = int(np.argmax(off))
    sentences = [
        f"The measured frame was turned by {angle:.6g} deg, and the middle of the dots moved by "
        f"x {_short(float(moved[0]))}, y {_short(float(moved[1]))}, to fit the design.",
        f"{len(dots)} dots were measured; they are {_short(float(np.sqrt(np.mean(off**2))))} RMS from the "
        f"design, at most {_short(float(off[worst]))} (dot {dots[worst].id}).",
    ]
    bare = [dot.id for dot in dots if dot.covariance is None]
    if bare:
        which = "No dot has a" if len(bare) == len(dots) else f"Dots {', '.join(map(str, bare))} have no"
        sentences.append(f"{which} sigma: --print-sigma of detect and validate stands for it.")
    return sentences


def _recorded(marker: Marker, kind: str, record: Mapping[str, Any]) -> Marker:
    before = marker.provenance.get("print")
    kept = dict(before) if isinstance(before, Mapping) and kind != "rulers" else {}
    return replace(marker, provenance={**marker.provenance, "print": {**kept, kind: dict(record)}})


def _short(meters: float) -> str:
    return format_length(float(f"{meters:.4g}"))


def _percent(ratio: float) -> str:
    """A ratio in percent, to a hundredth: a ruler of 200 mm is not read to less than 0.02 mm."""
    return f"{100 * ratio:.2f}".rstrip("0").rstrip(".") + " %"
