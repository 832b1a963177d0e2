"""Sections of a calibration's report, each from what was found; without its data a section is left out."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from markergen.calibration.camera_choice import CameraChoice
from markergen.calibration.flexing import Flex
from markergen.calibration.judging import CrossValidation, Halves, parameters_of
from markergen.calibration.projection_uncertainty import (
    camera_difference,
    draw_difference,
    draw_uncertainty,
    projection_uncertainty,
)
from markergen.calibration.report import plots
from markergen.calibration.report.subject import UM, Subject
from markergen.calibration.words import (
    SOURCES,
    far_points,
    headline,
    judged,
    photographs,
    sentence,
    unused,
    what_is_left,
)
from markergen.presentation.pages import Section
from markergen.presentation.plots import Plot, plot
from markergen.presentation.tables import Table, number

_HANG_UP, _SQUARE = (5.8, 5.0), (4.4, 4.4)
"""Widths and heights of plots in inches."""


def answer(subject: Subject) -> Section:
    """What to expect before and after, by source, and where the scale comes from."""
    found = subject.found
    section = Section(
        [headline(found), what_is_left(found), found.scale_source],
        warnings=list(found.notes),
        book=("what is measured, and how well it works", "calibrate.md#how-well-it-works"),
    )
    if found.next_photos is not None:
        section.sentences.append(found.next_photos.sentence)
    rows = []
    for name, pick in (("rotation, deg", 0), ("translation, mm", 1)):
        factor = (1.0, 1e3)[pick]
        for when, error in (("as designed", found.before), ("as measured", found.after)):
            if when == "as measured" and not found.measured:
                continue
            total = (error.rotation_deg, error.translation)[pick]
            parts = [getattr(error, source)[pick] for source in SOURCES]
            rows.append([name, when, *(number(factor * each) if each else "0" for each in (total, *parts))])
    section.tables.append(
        Table(
            "Expected pose error over the working volume, RMS over its poses",
            ["error", "marker", "total", "image noise", "print", "camera"],
            rows,
            "Each source alone. Dots and camera that come from the same photographs err together, so that the total "
            "may be less than the root of the sum of squares.",
        )
    )
    return section


def print_found(subject: Subject) -> Section | None:
    """Map of each marker, and the table of its dots."""
    found = subject.found
    section = Section()
    if found.measured:
        away = subject.displacement
        plane, height = np.linalg.norm(away[:, :2], axis=1), away[:, 2]
        sigma = np.sqrt(np.einsum("nii->ni", subject.covariance))
        section.sentences.append(
            f"In the print dots are {number(_rms(plane))} um RMS from where they were designed within the plane, at "
            f"most {number(float(plane.max()))} um (dot {subject.dots[int(plane.argmax())]}); in height they spread by "
            f"{number(float(np.ptp(height)))} um. The photographs tell this to {number(_rms(sigma[:, :2]))} um along x "
            f"and y, and to {number(_rms(sigma[:, 2]))} um in height (1 sigma, RMS)."
        )
        section.plots += list(_maps(subject, away, subject.covariance, "map"))
    section.tables.append(_dot_table(subject))
    return section


def relation(subject: Subject) -> Section | None:
    """Where the markers of a rig are, beside where they were designed."""
    found = subject.found.relation
    if found is None:
        return None
    section = Section(list(found.sentences))
    rows = [
        [each.name, *map(number, (turn, 1e3 * shift, by_turn, 1e3 * by_shift))]
        for each, turn, shift, by_turn, by_shift in zip(
            found.rig.plates, found.turned_deg, found.moved, *found.sigma, strict=True
        )
    ]
    section.tables.append(
        Table(
            "Markers of the rig",
            ["marker", "turned, deg", "moved, mm", "sigma of rotation, deg", "sigma of translation, mm"],
            rows,
            "Turned and moved from where the rig has them; standard deviations as roots of sums over the three axes. "
            "The rig frame is that in which the dots, all together, are nearest to the rig as designed.",
        )
    )
    return section


def _maps(subject: Subject, away: np.ndarray, covariance: np.ndarray, name: str) -> Iterator[Plot]:
    """Map of the displacements (n, 3) of the dots of each marker; nan where there is none."""
    network, designs = subject.found.adjustment.network, subject.found.designs
    for k, marker in enumerate(designs):
        own = np.flatnonzero((network.marker == k) & np.isfinite(away).all(axis=1))
        if len(own) < 2:
            continue
        points = 1e3 * network.design[own, :2]
        size = 2e3 * marker.boundary.radius
        factor = plots.enlargement(points, 1e-3 * away[own, :2], 1e-6 * covariance[own, :2, :2], size)
        ids = [subject.dots[i] for i in own]
        which = f" {k + 1}" if len(designs) > 1 else ""
        if name == "map":
            alt = f"Map of marker{which} with its {len(own)} dots, each with an arrow to where it is in the print"
            told = (
                "Each disk is a dot where it was designed, seen from the front; its color is by how much it stands "
                f"higher (orange) or lower (blue). The arrow, {factor:g} times as long as it is, shows where it is in "
                "the print, the ellipse at its tip the 2-sigma region."
            )
        else:
            alt = f"Map of marker{which} with the difference between the two halves for {len(own)} dots"
            told = (
                f"By how much the second half has each dot elsewhere than the first, {factor:g} times as long. If the "
                "claimed errors are right, seven of eight ellipses contain their dot's center: they are the 2-sigma "
                "regions of such a difference, twice as wide as those of all photographs together."
            )
        alt += f"; {number(float(np.linalg.norm(away[own, :2], axis=1).max()))} um at most."
        yield plot(
            partial(plots.print_map, marker, ids, points, away[own], covariance[own], factor),
            f"{name}-{k}",
            alt,
            told,
            _HANG_UP,
        )


def _dot_table(subject: Subject) -> Table:
    found = subject.found
    taken, rejected, rms = subject.taken.sum(axis=0), found.dropped.sum(axis=0), subject.rms(axis=0)
    header, cells = ["dot"], [[name] for name in subject.dots]
    if found.measured:
        header += ["dx", "dy", "dz", "sigma x", "sigma y", "sigma z"]
        sigma = np.sqrt(np.einsum("nii->ni", subject.covariance))
        for row, moved, spread in zip(cells, subject.displacement, sigma, strict=True):
            row += [f"{value:+.1f}" for value in moved] + [f"{value:.1f}" for value in spread]
    header += ["seen", "rejected", "RMS, px"]
    for row, *counts, residual in zip(cells, taken, rejected, rms, strict=True):
        row += [str(count) for count in counts] + [_px(residual)]
    title = "Dots of the print less the design, um" if found.measured else "Dots"
    return Table(
        title,
        header,
        cells,
        "Shift, turn and, unless a length was measured, mean size of the whole print are those of the design: "
        "photographs cannot tell them. Seen: photographs in which the dot took part."
        if found.measured
        else "Seen: photographs in which the dot took part.",
    )


def photos(subject: Subject) -> Section:
    """Photographs with their residuals, rejected dots, unused photographs, and the residuals over the image."""
    found, views = subject.found, subject.found.adjustment.views
    camera, residual = found.camera, found.adjustment.residual
    section = Section([photographs(found)[0]])
    taken, rejected = subject.taken, subject.rejected
    if taken.any():
        factor = plots.residual_factor(residual[taken], camera.width)
        crossed = (views.pixels[rejected], residual[rejected])
        section.plots.append(
            plot(
                partial(plots.residual_vectors, views.pixels[taken], residual[taken], crossed, factor, camera),
                "residuals",
                f"Residuals of {int(taken.sum())} dots over the image, {number(found.adjustment.rms)} px RMS.",
                f"What is left between dots seen and dots predicted, {factor:g} times as long. A pattern in them is a "
                "lens that the model does not follow, or a marker that bends.",
                _image_size(subject),
            )
        )
    rms, factors, tilt = subject.rms(axis=1), subject.variance_factors, subject.coverage.tilt_deg
    distance = np.linalg.norm(views.translation, axis=1)
    numbers = found.sightings.photo[found.used] + 1
    section.tables.append(
        Table(
            "Photographs",
            ["photograph", "number", "dots", "rejected", "RMS, px", "chi2/dof", "tilt, deg", "distance, m"],
            [
                [
                    name,
                    str(numbers[row]),
                    str(taken[row].sum()),
                    str(rejected[row].sum()),
                    _px(rms[row]),
                    f"{factors[row]:.2f}",
                    f"{tilt[row]:.0f}",
                    f"{distance[row]:.3f}",
                ]
                for row, name in enumerate(subject.rows)
            ],
            "RMS of the distance between a dot and its prediction. chi2/dof compares it with the image's noise: 1 is "
            "expected, much more is a poor fit.",
        )
    )
    if subject.outliers:
        section.tables.append(
            Table(
                "Rejected dots",
                ["photograph", "dot", "off, px", "off, sigma"],
                [[each.photo, each.dot, _px(each.off_px), f"{each.off_sigma:.1f}"] for each in subject.outliers],
                "Rejected because they are farther from where all other dots and photographs put them than chance and "
                "noise allow.",
            )
        )
    left = unused(found)
    if left:
        names = dict(zip(found.sightings.photos, subject.photos, strict=True))
        section.tables.append(
            Table("Photographs not used", ["photograph", "reason"], [[names[name], reason] for name, reason in left])
        )
    return section


def coverage(subject: Subject) -> Section:
    """Where in the image, from which sides, and with which turns the marker was seen."""
    covered, views, camera = subject.coverage, subject.found.adjustment.views, subject.found.camera
    pixels = [views.pixels[row][taken] for row, taken in enumerate(subject.taken)]
    distance = np.linalg.norm(views.translation, axis=1)
    section = Section(
        [covered.sentence, f"The camera was {distance.min():.2f} to {distance.max():.2f} m from the marker."]
    )
    section.plots += [
        plot(
            partial(plots.image_coverage, pixels, camera),
            "coverage",
            f"Outlines of the dots of {len(pixels)} views over the image; {100 * covered.image:.0f} % of its cells "
            "have a dot.",
            "Where in the image the dots were, each photograph as the outline of its dots. A camera is known only "
            "where dots were.",
            _image_size(subject),
        ),
        plot(
            partial(plots.directions, views.rotation, covered.tilt_deg),
            "directions",
            f"Sides and tilts from which {len(pixels)} views were taken: tilts of {covered.tilt_deg.min():.0f} to "
            f"{covered.tilt_deg.max():.0f} deg, to {len(covered.sides)} of 8 sides.",
            "From which side each photograph was taken, seen from the front of the marker: the middle is frontal, the "
            "rings are tilts. The hand of each mark points where the upper edge of the image is. Good sets have marks "
            "all around, with hands in all directions.",
            _SQUARE,
        ),
    ]
    return section


def next_photos(subject: Subject) -> Section | None:
    """Which photographs to take next, in words and pictures; None if that was not asked."""
    asked = subject.found.next_photos
    if asked is None:
        return None
    section = Section([asked.sentence])
    if not asked.helps:
        return section
    network = subject.found.adjustment.network
    for k, photo in enumerate(asked.photos):
        section.plots.append(
            plot(
                partial(asked.draw, which=k),
                f"next-{k}",
                f"Picture {k + 1} to take next: {photo.request}.",
                f"{k + 1}. {sentence(photo.request)} Gray: the photographs taken.",
                _image_size(subject),
            )
        )
    section.tables.append(
        Table(
            "Expected pose error after the next photographs, one after the other",
            ["photograph", "rotation, deg", "translation, mm"],
            [
                [name, number(error.rotation_deg), number(1e3 * error.translation)]
                for name, error in (
                    ("now", asked.photos[0].before),
                    *((str(k + 1), photo.after) for k, photo in enumerate(asked.photos)),
                )
            ],
            ""
            if network.scale_known(int(network.marker[0]))
            else "Without the error of the print's scale, which no photograph tells and the first section counts.",
        )
    )
    return section


def judgment(subject: Subject) -> Section:
    """Left-out photographs, two halves, and bending."""
    found = subject.found
    section = Section(judged(found))
    if isinstance(found.flex, Flex):
        section.sentences.append(sentence(found.flex.verdict))
    cross, halves = found.cross_validation, found.halves
    if isinstance(cross, CrossValidation):
        measured = f"{number(cross.measured.rms)} px with the measured print, " if found.measured else ""
        section.plots.append(
            plot(
                partial(plots.left_out, cross),
                "left-out",
                f"RMS residuals of {len(cross.photos)} left-out photographs: {measured}"
                f"{number(cross.best_nominal.rms)} px as designed.",
                "Each photograph was left out and predicted from the others, with a pose of its own. Lines are the RMS "
                "over all. Residuals of photographs that took part always fall when dots are freed; these do not.",
            )
        )
        rows = [("as designed", cross.nominal)]
        if found.measured:
            rows.insert(0, ("as measured", cross.measured))
        if found.measured and cross.refitted is not None:
            rows.append(("as designed, and a camera that suits it", cross.refitted))
        section.tables.append(
            Table(
                "Left-out photographs",
                ["print", "RMS, px", "chi2/dof"],
                [[name, _px(each.rms), f"{each.variance_factor:.2f}"] for name, each in rows],
            )
        )
    if isinstance(halves, Halves) and len(halves.dots):
        away = np.full((len(found.chosen), 3), np.nan)
        away[halves.dots] = UM * halves.difference
        section.plots += list(_maps(subject, away, 4 * subject.covariance, "halves"))
        sides = [len(each) for each in halves.photos]
        section.tables.append(
            Table(
                "Two halves",
                ["photographs", "dots", "difference, um RMS", "chi2/dof", "chance, %"],
                [
                    [
                        f"{sides[0]} and {sides[1]}",
                        str(len(halves.dots)),
                        number(halves.rms_um),
                        f"{halves.variance_factor:.2f}",
                        f"{100 * halves.chance:.2g}",
                    ]
                ],
                "chi2/dof compares the difference with the claimed errors: 1 is expected. Chance is the probability of "
                "so much or more if they are right.",
            )
        )
    return section


def camera(subject: Subject) -> Section | None:
    """Parameters of the camera, how well it projects, and what was tried; None if it was given as exact."""
    found, covariance = subject.found, subject.found.camera_covariance
    if covariance is None:
        return None
    names, values = found.camera.parameter_names, parameters_of(found.camera)
    sigma = np.sqrt(np.diag(covariance))
    center = projection_uncertainty(found.camera, covariance)
    low, high = (number(float(each(center)), 2) for each in (np.nanmin, np.nanmax))
    section = Section([far_points(found.camera, covariance)])
    shape = _image_size(subject)
    section.plots.append(
        plot(
            lambda ax: draw_uncertainty(center, found.camera, ax),
            "uncertainty",
            f"Standard deviation of the projection over the image, {low} to {high} px.",
            "Standard deviation of where a point at infinity projects, less what a turn of the camera makes good.",
            shape,
        )
    )
    halves = found.halves
    if isinstance(halves, Halves) and halves.camera_chi2 is not None:
        difference = camera_difference(*halves.cameras)
        size = np.linalg.norm(difference, axis=-1)
        said = f"{number(float(np.sqrt(np.nanmean(size**2))), 2)} px RMS"
        section.plots.append(
            plot(
                lambda ax: draw_difference(difference, halves.cameras[0], ax),
                "cameras",
                f"Difference between the cameras of the two halves over the image, {said}.",
                f"Where the camera of the second half sees what that of the first sees at each pixel: {said}. About "
                "twice the standard deviation beside it is expected.",
                shape,
            )
        )
        section.sentences.append(
            f"The cameras of the two halves differ by {said}; their parameters have a chi2 of {halves.camera_chi2:.2f} "
            "per degree of freedom, where 1 is expected."
        )
    section.tables.append(
        Table(
            "Camera",
            ["parameter", "value", "sigma"],
            [
                [name, f"{value:.7g}", number(float(each)) if each else "held"]
                for name, value, each in zip(names, values, sigma, strict=True)
            ],
            f"{found.camera.width} x {found.camera.height} px, {found.camera.distortion.model} lens; f and c in px.",
        )
    )
    if isinstance(found.camera_choice, CameraChoice):
        section.tables.append(_trials(found.camera_choice))
    return section


def _trials(choice: CameraChoice) -> Table:
    rows = []
    for each in choice.tried:
        gain = each.gain
        rows.append(
            [
                " ".join(each.names) or "none",
                "not determined" if each.left_out is None else _px(each.left_out.rms),
                "-" if gain is None else f"{gain.ratio:.3f}",
                "-" if gain is None else f"{gain.low:.3f} to {gain.high:.3f}",
                "yes" if each.taken else "no",
            ]
        )
    return Table(
        "Camera parameters that were tried",
        ["estimated", "left out, px", "better by", "95 %", "taken"],
        rows,
        "A parameter joins only where it predicts left-out photographs better: how many times, with the 95 % interval.",
    )


def _image_size(subject: Subject) -> tuple[float, float]:
    """Return width and height in inches of a plot over the image."""
    width, height = subject.found.sightings.size
    return (4.9, float(np.clip(4.3 * height / width + 0.9, 2.6, 5.6)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _px(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value:.3f}"
