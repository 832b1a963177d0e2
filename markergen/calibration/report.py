"""The report of a calibration: one self-contained HTML file, with the same bytes for the same results.

A section without its data is left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.calibration.camera_choice import CameraChoice
from markergen.calibration.coverage import coverage_of, view_angles
from markergen.calibration.flexing import Flex
from markergen.calibration.judging import CrossValidation, Halves, parameters_of
from markergen.calibration.projection_uncertainty import (
    camera_difference,
    draw_difference,
    draw_uncertainty,
    image_axes,
    projection_uncertainty,
)
from markergen.calibration.sentences import SOURCES, sentence, sentences_of, unused
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.presentation import pages
from markergen.presentation.pages import Section
from markergen.presentation.plots import FAINT, INK, MUTED, SERIES, Plot, legend_below, log_axis, plot, positive
from markergen.presentation.tables import Table, number
from markergen.validation.metrics import rms
from markergen.validation.report import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from markergen.calibration.calibration import Calibration


METHOD = [
    (
        "Adjustment",
        "Dots, the pose of each photograph and, unless it was given, the camera are adjusted at once, to the least sum "
        "of squared residuals weighted by the image's noise. Dots are disks: their images' centers are predicted "
        "exactly.",
    ),
    (
        "Marker frame",
        "Meters; x right, y up, z out of the printed face toward the viewer. Seven conditions, or six with a measured "
        "length, fix what no photograph shows: all dots together neither translate nor rotate nor grow against the "
        "design.",
    ),
    ("Sigma", "Standard deviation to first order, multiplied by the root of chi2/dof where that is above 1."),
    (
        "Expected pose error",
        "RMS over the poses of the working volume, to first order, for images as noisy as the photographs. As "
        "designed, each dot is off by the print error given with --print-sigma along x and y, and the scale, while "
        "nothing measures it, as --scale-sigma says; a bent sheet comes on top.",
    ),
    ("Tilt", "Angle between the marker's plane and that of the image; 0 is frontal."),
    (
        "chi2/dof",
        "Squared residuals in units of their claimed variance, per degree of freedom: 1 is expected. Several times as "
        "much is a marker that bends, a lens the model does not follow, or noise that was underestimated.",
    ),
]


def calibration_page(calibration: "Calibration") -> bytes:
    """Make a self-contained HTML page from a calibration.

    Returns
    -------
    bytes
        UTF-8 without scripts, dates or external resources. Text from files is escaped.
    """
    quantities = Quantities(calibration)
    designs = "; ".join(title(marker) for marker in calibration.designs)
    photos, size = len(calibration.sightings.photos), calibration.sightings.size
    camera_words = (
        "the camera given with its errors" if calibration.camera_covariance is not None else "the camera taken as given"
    )
    return pages.page(
        "Calibration report",
        designs,
        [
            ("answer", "What to expect", _answer_section(quantities)),
            ("print", "The print", _print_section(quantities)),
            ("relation", "Held together", _relation_section(quantities)),
            ("judged", "Does it hold?", _judgment_section(quantities)),
            ("camera", "The camera", _camera_section(quantities)),
            ("photos", "Photographs", _photos_section(quantities)),
            ("coverage", "Coverage", _coverage_section(quantities)),
            ("next", "Next photographs", _next_photos_section(quantities)),
            (
                "method",
                "How it was measured",
                pages.Section(terms=METHOD, book=("what it does", "calibrate.md#what-it-does")),
            ),
        ],
        f"{designs}. {photos} photographs of {size[0]} x {size[1]} px; the print was "
        f"{'measured' if calibration.measured else 'taken as designed'}, "
        f"{'the camera calibrated' if calibration.estimated else camera_words}.",
        "The same photographs and options give the same page.",
    )


UM = 1e6
"""Micrometers in a meter."""

LONGEST_NAME = 60
"""Maximum number of characters shown of a photograph's name."""


@dataclass(frozen=True, eq=False)
class Quantities:
    """The calibration that a report shows; rows are its used views, columns its adjusted dots."""

    calibration: "Calibration"

    @cached_property
    def sentences(self) -> dict[str, list[str]]:
        """See `sentences_of`."""
        return sentences_of(self.calibration)

    @cached_property
    def dots(self) -> list[str]:
        """Ids of the adjusted dots; with several markers, as ``2:5`` the fifth of the second."""
        named = [(k, point.id) for k, marker in enumerate(self.calibration.designs) for point in marker.control_points]
        several = len(self.calibration.designs) > 1
        return [f"{named[i][0] + 1}:{named[i][1]}" if several else str(named[i][1]) for i in self.calibration.chosen]

    @cached_property
    def photos(self) -> list[str]:
        """Names of the photographs; the end of long ones."""
        return [
            name if len(name) <= LONGEST_NAME else "..." + name[3 - LONGEST_NAME :]
            for name in self.calibration.sightings.photos
        ]

    @cached_property
    def rows(self) -> list[str]:
        """Name of the photograph of each used view; with several markers also which."""
        sightings, used = self.calibration.sightings, self.calibration.used
        several = len(self.calibration.designs) > 1
        return [
            f"{self.photos[photo]}, marker {marker + 1}" if several else self.photos[photo]
            for photo, marker in zip(sightings.photo[used], sightings.marker[used], strict=True)
        ]

    @property
    def taken(self) -> NDArray[np.bool_]:
        """Measurements (v, n) that took part."""
        return self.calibration.adjustment.weights > 0

    @property
    def rejected(self) -> NDArray[np.bool_]:
        """Measurements (v, n) that were rejected, of the used views."""
        return self.calibration.dropped[self.calibration.used]

    @property
    def displacement(self) -> Array:
        """Where the print's dots (n, 3) are, less where they were designed, um."""
        adjustment = self.calibration.adjustment
        return UM * (adjustment.places - adjustment.network.design)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (n, 3, 3) of each dot, um^2."""
        n = len(self.calibration.chosen)
        index = np.arange(n)
        return UM**2 * self.calibration.adjustment.covariance.reshape(n, 3, n, 3)[index, :, index]

    @cached_property
    def spread(self) -> Array:
        """Covariance (v, n, 2, 2) of the residuals, px^2, scaled."""
        return self.calibration.adjustment.scale * self.calibration.adjustment.residual_covariance()

    @cached_property
    def variance_factors(self) -> Array:
        """chi2 (v,) of each view over its expected value, the trace of its residuals' cofactors: 1 on average.

        A view's own share of the degrees of freedom is tr(S^-1 A), S the covariance of its measurements in the image
        and A that of their residuals.
        """
        adjustment, taken = self.calibration.adjustment, self.taken
        inverse = np.linalg.inv(adjustment.views.covariance)
        chi2 = np.einsum("vni,vnij,vnj->vn", adjustment.residual, inverse, adjustment.residual)
        expected = np.einsum("vnij,vnji->vn", inverse, self.spread / adjustment.scale)
        return np.asarray((chi2 * taken).sum(axis=1) / np.maximum((expected * taken).sum(axis=1), 1e-12))

    @cached_property
    def squares(self) -> Array:
        """Squared lengths (v, n) of the residuals that took part, px^2."""
        return np.where(self.taken, (self.calibration.adjustment.residual**2).sum(axis=-1), 0.0)

    def rms(self, axis: int) -> Array:
        """RMS of the residuals in px of each dot (axis 0) or each view (axis 1); nan where none took part."""
        count = self.taken.sum(axis=axis)
        return np.sqrt(np.where(count > 0, self.squares.sum(axis=axis) / np.maximum(count, 1), np.nan))

    @cached_property
    def outliers(self) -> list[list[str]]:
        """Rejected dots of the used views, the worst first: photograph, dot, and by how many px and sigma it is off."""
        residual, listed = self.calibration.adjustment.residual, []
        for row, column in np.argwhere(self.rejected):
            off = residual[row, column]
            sigma = float(np.sqrt(off @ np.linalg.solve(self.spread[row, column], off)))
            cells = [self.rows[row], self.dots[column], _px(float(np.linalg.norm(off))), f"{sigma:.1f}"]
            listed.append((sigma, cells))
        return [cells for _, cells in sorted(listed, key=lambda rejected: -rejected[0])]


_HANG_UP, _SQUARE = (5.8, 5.0), (4.4, 4.4)
"""Widths and heights of plots in inches."""


def _answer_section(quantities: Quantities) -> Section:
    """What to expect before and after, by source, and where the scale comes from."""
    calibration = quantities.calibration
    section = Section(
        [*quantities.sentences["answer"], *quantities.sentences["next"]],
        warnings=list(calibration.notes),
        book=("what is measured, and how well it works", "calibrate.md#how-well-it-works"),
    )
    rows = []
    for name, pick in (("rotation, deg", 0), ("translation, mm", 1)):
        factor = (1.0, 1e3)[pick]
        for when, error in (("as designed", calibration.before), ("as measured", calibration.after)):
            if when == "as measured" and not calibration.measured:
                continue
            total = (error.rotation_deg, error.translation)[pick]
            parts = [getattr(error, source)[pick] for source in SOURCES]
            rows.append(
                [name, when, *(number(factor * error_size) if error_size else "0" for error_size in (total, *parts))]
            )
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


def _print_section(quantities: Quantities) -> Section | None:
    """Map of each marker, and the table of its dots."""
    calibration = quantities.calibration
    section = Section()
    if calibration.measured:
        away = quantities.displacement
        plane, height = np.linalg.norm(away[:, :2], axis=1), away[:, 2]
        sigma = np.sqrt(np.einsum("nii->ni", quantities.covariance))
        section.sentences.append(
            f"In the print dots are {number(rms(plane))} um RMS from where they were designed within the plane, at "
            f"most {number(float(plane.max()))} um (dot {quantities.dots[int(plane.argmax())]}); in height they "
            f"spread by {number(float(np.ptp(height)))} um. The photographs tell this to "
            f"{number(rms(sigma[:, :2]))} um along x and y, and to {number(rms(sigma[:, 2]))} um in height "
            "(1 sigma, RMS)."
        )
        section.plots += list(_maps(quantities, away, quantities.covariance, "map"))
    section.tables.append(_dot_table(quantities))
    return section


def _relation_section(quantities: Quantities) -> Section | None:
    """Where the markers of a rig are, beside where they were designed."""
    relation = quantities.calibration.relation
    if relation is None:
        return None
    section = Section(quantities.sentences["relation"])
    if len(relation.names) > 1:
        section.tables.append(
            Table(
                "Poses of the cameras",
                ["camera", "turned, deg", "x, mm", "y, mm", "z, mm", "sigma, deg", "sigma, mm"],
                [
                    [name, *map(number, (angle, *(1e3 * away), by_rotation, 1e3 * by_translation))]
                    for name, angle, away, by_rotation, by_translation in relation.camera_rows()
                ],
                f"T_camera_{relation.names[0]}, with what is unknown of the print's scale; JSON has the covariance.",
            )
        )
    if relation.rig is None:
        return section
    rows = [
        [plate.name, *map(number, (angle, 1e3 * distance, by_rotation, 1e3 * by_translation))]
        for plate, angle, distance, by_rotation, by_translation in relation.plate_rows()
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


def _maps(quantities: Quantities, away: np.ndarray, covariance: np.ndarray, name: str) -> Iterator[Plot]:
    """Map of the displacements (n, 3) of the dots of each marker; nan where there is none."""
    network, designs = quantities.calibration.adjustment.network, quantities.calibration.designs
    for k, marker in enumerate(designs):
        dots = np.flatnonzero((network.marker == k) & np.isfinite(away).all(axis=1))
        if len(dots) < 2:
            continue
        points = 1e3 * network.design[dots, :2]
        size = 2e3 * marker.boundary.radius
        factor = enlargement(points, 1e-3 * away[dots, :2], 1e-6 * covariance[dots, :2, :2], size)
        ids = [quantities.dots[i] for i in dots]
        which = f" {k + 1}" if len(designs) > 1 else ""
        if name == "map":
            alt = f"Map of marker{which} with its {len(dots)} dots, each with an arrow to where it is in the print"
            caption = (
                "Each disk is a dot where it was designed, seen from the front; its color is by how much it stands "
                f"higher (orange) or lower (blue). The arrow, {factor:g} times as long as it is, shows where it is in "
                "the print, the ellipse at its tip the 2-sigma region."
            )
        else:
            alt = f"Map of marker{which} with the difference between the two halves for {len(dots)} dots"
            caption = (
                f"By how much the second half has each dot elsewhere than the first, {factor:g} times as long. If the "
                "claimed errors are right, seven of eight ellipses contain their dot's center: they are the 2-sigma "
                "regions of such a difference, twice as wide as those of all photographs together."
            )
        alt += f"; {number(float(np.linalg.norm(away[dots, :2], axis=1).max()))} um at most."
        yield plot(
            partial(draw_print_map, marker, ids, points, away[dots], covariance[dots], factor),
            f"{name}-{k}",
            alt,
            caption,
            _HANG_UP,
        )


def _dot_table(quantities: Quantities) -> Table:
    calibration = quantities.calibration
    taken, rejected, rms_px = quantities.taken.sum(axis=0), calibration.dropped.sum(axis=0), quantities.rms(axis=0)
    header, cells = ["dot"], [[name] for name in quantities.dots]
    if calibration.measured:
        header += ["dx", "dy", "dz", "sigma x", "sigma y", "sigma z"]
        sigma = np.sqrt(np.einsum("nii->ni", quantities.covariance))
        for row, moved, spread in zip(cells, quantities.displacement, sigma, strict=True):
            row += [f"{value:+.1f}" for value in moved] + [f"{value:.1f}" for value in spread]
    header += ["seen", "rejected", "RMS, px"]
    for row, *counts, residual in zip(cells, taken, rejected, rms_px, strict=True):
        row += [str(count) for count in counts] + [_px(residual)]
    title = "Dots of the print less the design, um" if calibration.measured else "Dots"
    return Table(
        title,
        header,
        cells,
        "Translation, rotation and, unless a length was measured, mean size of the whole print are those of the "
        "design: photographs cannot tell them. Seen: photographs in which the dot took part."
        if calibration.measured
        else "Seen: photographs in which the dot took part.",
    )


def _photos_section(quantities: Quantities) -> Section:
    """Photographs with their residuals, rejected dots, unused photographs, and the residuals over the image."""
    calibration, views = quantities.calibration, quantities.calibration.adjustment.views
    residual = calibration.adjustment.residual
    section = Section(quantities.sentences["photos"][:1])
    taken, rejected = quantities.taken, quantities.rejected
    for k, calibrated in enumerate(calibration.cameras):
        rows = (views.camera == k)[:, None]
        if not (taken & rows).any():
            continue
        part, lost = taken & rows, rejected & rows
        length_px = float(np.quantile(np.linalg.norm(residual[part], axis=1), 0.9))
        factor = round_factor(calibrated.camera.width / 30 / max(length_px, 1e-9))
        crossed = (views.pixels[lost], residual[lost])
        section.plots.append(
            plot(
                partial(draw_residual_vectors, views.pixels[part], residual[part], crossed, factor, calibrated.camera),
                f"residuals{k or ''}",
                f"Residuals of {int(part.sum())} dots over the image{of_camera(calibrated.name)}, "
                f"{number(rms(np.linalg.norm(residual[part], axis=1)))} px RMS.",
                f"What is left between dots seen and dots predicted, {factor:g} times as long. A pattern in them is a "
                "lens that the model does not follow, or a marker that bends.",
                _image_size(quantities),
            )
        )
    rms_px, factors, tilt = quantities.rms(axis=1), quantities.variance_factors, view_angles(views.rotation)[0]
    distance = np.linalg.norm(views.translation, axis=1)
    numbers = calibration.sightings.photo[calibration.used] + 1
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
                    _px(rms_px[row]),
                    f"{factors[row]:.2f}",
                    f"{tilt[row]:.0f}",
                    f"{distance[row]:.3f}",
                ]
                for row, name in enumerate(quantities.rows)
            ],
            "RMS of the distance between a dot and its prediction. chi2/dof compares it with the image's noise: 1 is "
            "expected, much more is a poor fit.",
        )
    )
    if quantities.outliers:
        section.tables.append(
            Table(
                "Rejected dots",
                ["photograph", "dot", "off, px", "off, sigma"],
                quantities.outliers,
                "Rejected because they are farther from where all other dots and photographs put them than chance and "
                "noise allow.",
            )
        )
    left = unused(calibration)
    if left:
        names = dict(zip(calibration.sightings.photos, quantities.photos, strict=True))
        section.tables.append(
            Table("Photographs not used", ["photograph", "reason"], [[names[name], reason] for name, reason in left])
        )
    return section


def _coverage_section(quantities: Quantities) -> Section:
    """Where in the image, from which sides, and with which turns the marker was seen."""
    section, adjustment = Section(), quantities.calibration.adjustment
    for k, calibrated in enumerate(quantities.calibration.cameras):
        of_one = adjustment.of_camera(k)
        covered, views = coverage_of(of_one), of_one.views
        pixels = [seen[weights > 0] for seen, weights in zip(views.pixels, of_one.weights, strict=True)]
        distance = np.linalg.norm(views.translation, axis=1)
        section.sentences += [
            covered.sentence,
            f"The camera was {distance.min():.2f} to {distance.max():.2f} m from the marker.",
        ]
        section.plots += [
            plot(
                partial(draw_image_coverage, pixels, calibrated.camera),
                f"coverage{k or ''}",
                f"Outlines of the dots of {len(pixels)} views{of_camera(calibrated.name)} over the image; "
                f"{100 * covered.image:.0f} % of its cells have a dot.",
                "Where in the image the dots were, each photograph as the outline of its dots. A camera is known only "
                "where dots were.",
                _image_size(quantities),
            ),
            plot(
                partial(draw_directions, views.rotation, covered.tilt_deg),
                f"directions{k or ''}",
                f"Sides and tilts from which {len(pixels)} views were taken{of_camera(calibrated.name)}: tilts of "
                f"{covered.tilt_deg.min():.0f} to {covered.tilt_deg.max():.0f} deg, to {len(covered.sides)} of 8 "
                "sides.",
                "From which side each photograph was taken, seen from the front of the marker: the middle is frontal, "
                "the rings are tilts. The hand of each mark points where the upper edge of the image is. Good sets "
                "have marks all around, with hands in all directions.",
                _SQUARE,
            ),
        ]
    return section


def _next_photos_section(quantities: Quantities) -> Section | None:
    """Which photographs to take next, in words and pictures; None if that was not asked."""
    asked = quantities.calibration.next_photos
    if asked is None:
        return None
    section = Section(quantities.sentences["next"])
    if not asked.helps:
        return section
    for k, photo in enumerate(asked.photos):
        error = f"{number(photo.after.rotation_deg)} deg and {number(1e3 * photo.after.translation)} mm"
        section.plots.append(
            plot(
                partial(asked.draw, which=k),
                f"next-{k}",
                f"Picture {k + 1} to take next: {photo.request}.",
                f"{k + 1}. {sentence(photo.request)} With it, expect {error}, and the error of the scale. Gray: the "
                "photographs taken.",
                _image_size(quantities),
            )
        )
    return section


def _judgment_section(quantities: Quantities) -> Section:
    """Left-out photographs, two halves, and bending."""
    calibration = quantities.calibration
    section = Section([*quantities.sentences["judged"]])
    if isinstance(calibration.flex, Flex):
        section.sentences.append(sentence(calibration.flex.verdict))
    cross, halves = calibration.cross_validation, calibration.halves
    if isinstance(cross, CrossValidation):
        measured = f"{number(cross.measured.rms)} px with the measured print, " if calibration.measured else ""
        section.plots.append(
            plot(
                partial(draw_left_out, cross),
                "left-out",
                f"RMS residuals of {len(cross.photos)} left-out photographs: {measured}"
                f"{number(cross.best_nominal.rms)} px as designed.",
                "Each photograph was left out and predicted from the others, with a pose of its own. Lines are the RMS "
                "over all. Residuals of photographs that took part always fall when dots are freed; these do not.",
            )
        )
        rows = [("as designed", cross.nominal)]
        if calibration.measured:
            rows.insert(0, ("as measured", cross.measured))
        if calibration.measured and cross.refitted is not None:
            rows.append(("as designed, and a camera that suits it", cross.refitted))
        section.tables.append(
            Table(
                "Left-out photographs",
                ["print", "RMS, px", "chi2/dof"],
                [[name, _px(left_out.rms), f"{left_out.variance_factor:.2f}"] for name, left_out in rows],
            )
        )
    if isinstance(halves, Halves) and len(halves.dots):
        away = np.full((len(calibration.chosen), 3), np.nan)
        away[halves.dots] = UM * halves.difference
        section.plots += list(_maps(quantities, away, 4 * quantities.covariance, "halves"))
    return section


def _camera_section(quantities: Quantities) -> Section | None:
    """Parameters of the cameras, how well they project, and what was tried; None if all were given as exact."""
    calibration, halves = quantities.calibration, quantities.calibration.halves
    section = Section([*quantities.sentences["camera"]])
    shape = _image_size(quantities)
    for k, calibrated in enumerate(calibration.cameras):
        camera, covariance = calibrated.camera, calibrated.covariance
        if covariance is None:
            continue
        sigma, center = np.sqrt(np.diag(covariance)), projection_uncertainty(camera, covariance)
        low, high = (number(float(extreme(center)), 2) for extreme in (np.nanmin, np.nanmax))
        section.plots.append(
            plot(
                partial(draw_uncertainty, center, camera),
                f"uncertainty{k or ''}",
                f"Standard deviation of the projection{of_camera(calibrated.name)} over the image, {low} to {high} px.",
                "Standard deviation of where a point at infinity projects, less what a rotation of the camera makes "
                "good.",
                shape,
            )
        )
        if isinstance(halves, Halves) and halves.camera_chi2 is not None:
            pair = halves.cameras[0][k], halves.cameras[1][k]
            difference = camera_difference(*pair)
            difference_px = f"{number(float(np.sqrt(np.nanmean((difference**2).sum(axis=-1)))), 2)} px RMS"
            section.plots.append(
                plot(
                    partial(draw_difference, difference, pair[0]),
                    f"cameras{k or ''}",
                    f"Difference between the cameras of the two halves over the image, {difference_px}.",
                    f"Where the camera of the second half sees what that of the first sees at each pixel: "
                    f"{difference_px}. About twice the standard deviation beside it is expected.",
                    shape,
                )
            )
            section.sentences.append(
                f"The cameras of the two halves differ by {difference_px}{of_camera(calibrated.name)}; all parameters "
                f"have a chi2 of {halves.camera_chi2:.2f} per degree of freedom, where 1 is expected."
            )
        section.tables.append(
            Table(
                f"Camera {calibrated.name}".rstrip(),
                ["parameter", "value", "sigma"],
                [
                    [name, f"{value:.7g}", number(float(deviation)) if deviation else "held"]
                    for name, value, deviation in zip(camera.parameter_names, parameters_of(camera), sigma, strict=True)
                ],
                f"{camera.width} x {camera.height} px, {camera.distortion.model} lens; f and c in px.",
            )
        )
        if isinstance(calibrated.choice, CameraChoice):
            section.tables.append(_trials(calibrated.choice))
    return section if section.tables else None


def of_camera(name: str) -> str:
    """Return of which of several cameras something is; nothing for a single one."""
    return f" of camera {name}" if name else ""


def _trials(choice: CameraChoice) -> Table:
    rows = [
        [
            " ".join(trial.names) or "none",
            "not determined" if trial.left_out is None else _px(trial.left_out.rms),
            "-" if trial.gain is None else f"{trial.gain.ratio:.3f}",
            "-" if trial.gain is None else f"{trial.gain.low:.3f} to {trial.gain.high:.3f}",
            "yes" if trial.taken else "no",
        ]
        for trial in choice.tried
    ]
    return Table(
        "Camera parameters that were tried",
        ["estimated", "left out, px", "better by", "95 %", "taken"],
        rows,
        "A parameter joins only where it predicts left-out photographs better: how many times, with the 95 % interval.",
    )


def _image_size(quantities: Quantities) -> tuple[float, float]:
    """Return width and height in inches of a plot over the image."""
    width, height = quantities.calibration.sightings.size
    return (4.9, float(np.clip(4.3 * height / width + 0.9, 2.6, 5.6)))


def _px(value: float) -> str:
    return "-" if not np.isfinite(value) else f"{value:.3f}"


_HEIGHTS = ("#2f6db5", "#a9c8e8", "#ffffff", "#f4c08a", "#c55a11")
"""Colors from low to high: two hues that color-blind readers tell apart, white between."""
_MOST_IDS, _MOST_VECTORS = 60, 2000
"""Maximum number of dots with their numbers in a map, and of residuals drawn over an image."""

_AROUND = np.linspace(0, 2 * np.pi, 49)
_RINGS = (15, 30, 45, 60, 75)
"""Tilts in deg that are drawn as rings."""


def round_factor(value: float) -> float:
    """Return the largest of 1, 1.5, 2, 3, 5, 7, 10, 15... that is no more than a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 1.5, 2, 3, 5, 7) if step * power <= value * (1 + 1e-9)))


def enlargement(points: Array, displacement: Array, covariance: Array, size: float) -> float:
    """Return the factor by which displacements (n, 2) are drawn, in the unit of the points (n, 2).

    Nine of ten arrows, with the 2-sigma regions at their tips, are at most as long as the distance to the nearest dot,
    and as a fifth of the size.
    """
    apart = np.linalg.norm(points[:, None] - points, axis=-1) + np.diag(np.full(len(points), np.inf))
    room = min(float(np.median(apart.min(axis=1))), size / 5)
    around = 2 * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
    longest = float(np.quantile(np.linalg.norm(displacement, axis=1) + around, 0.9))
    return round_factor(room / max(longest, 1e-9))


def _clear_sides(points: Array, radii: Array, moved: Array, height: float) -> Array:
    """Sides (n, 2) of dots on which there is room for a number of that height, if any, away from their arrows first."""
    sides = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]], dtype=float)
    chosen, written = np.zeros_like(points), np.full_like(points, np.inf)
    for k, (point, radius) in enumerate(zip(points, radii, strict=True)):
        order = sides[np.argsort(sides @ moved[k], kind="stable")]
        places = point + (radius + height) * order
        room = np.linalg.norm(places[:, None] - points, axis=-1) - radii - height
        room[:, k] = np.inf
        beside = np.linalg.norm(places[:, None] - written, axis=-1) - 2 * height
        best = int(np.argmax(np.minimum(room, beside).min(axis=1) >= 0))
        chosen[k], written[k] = order[best], places[best]
    return chosen


def draw_print_map(
    marker: Marker, ids: list[str], points: Array, displacement: Array, covariance: Array, factor: float, ax: "Axes"
) -> "Axes":
    """Draw displacements (n, 3) in um of points (n, 2) in mm, `factor` times as long, with their 2-sigma ellipses."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import EllipseCollection
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.patches import Polygon

    for ring in marker.boundary.outlines():
        ax.add_patch(Polygon(1e3 * ring, facecolor="#fbfbfb", edgecolor=MUTED, linewidth=0.9, zorder=1))
    # Heights that are no larger than their errors stay pale.
    reach = max(float(np.abs(displacement[:, 2]).max()), 3 * float(np.sqrt(covariance[:, 2, 2].max())), 1e-3)
    colors = LinearSegmentedColormap.from_list("heights", _HEIGHTS, N=41)
    norm = Normalize(-reach, reach)
    diameter = {str(point.id): 1e3 * point.feature.diameter for point in marker.control_points}
    rim = 1e3 * np.concatenate(marker.boundary.outlines())
    low, high = rim.min(axis=0), rim.max(axis=0)
    size = float((high - low).max())
    ends = points + 1e-3 * factor * displacement[:, :2]
    # The smallest dots would not show their color.
    radii = np.array([max(diameter[name.rpartition(":")[2]] / 2, size / 120) for name in ids])
    look: dict[str, Any] = {"units": "xy", "offset_transform": ax.transData, "edgecolors": INK, "linewidths": 0.7}
    ax.add_collection(
        EllipseCollection(
            2 * radii,
            2 * radii,
            0 * radii,
            offsets=points,
            facecolors=colors(norm(displacement[:, 2])),
            zorder=2,
            **look,
        )
    )
    if len(ids) <= _MOST_IDS:
        sides = _clear_sides(points, radii, displacement[:, :2], 0.025 * size)
        for name, point, radius, side in zip(ids, points, radii, sides, strict=True):
            ax.annotate(
                name, point + radius * side, tuple(7 * side), textcoords="offset points", ha="center", va="center",
                fontsize=8, color=MUTED, zorder=6,
            )  # fmt: skip
    values, vectors = np.linalg.eigh(covariance[:, :2, :2])
    axes = 4e-3 * factor * np.sqrt(np.maximum(values, 0.0))
    angles = np.rad2deg(np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0]))
    regions = {"widths": axes[:, 0], "heights": axes[:, 1], "angles": angles, "offsets": ends}
    ax.add_collection(EllipseCollection(**regions, facecolors=(1, 1, 1, 0.6), zorder=3, **look))
    steps = ends - points
    ax.quiver(
        *points.T, *steps.T, angles="xy", scale_units="xy", scale=1, width=6e-3 if len(ids) <= _MOST_IDS else 2.5e-3,
        color=INK, edgecolor="#ffffff", linewidth=0.4, zorder=4,
    )  # fmt: skip
    margin = 0.04 * size
    # A length in the drawing to compare with.
    length_um = round_factor(0.2 * size / (1e-3 * factor))
    written = f"{length_um:g} um" if length_um < 1000 else f"{length_um / 1000:g} mm"
    bar = np.array([low[0], low[1] - 2.2 * margin])
    ax.plot([bar[0], bar[0] + 1e-3 * factor * length_um], [bar[1]] * 2, color=INK, linewidth=2.5, solid_capstyle="butt")
    ax.text(
        bar[0] + 1e-3 * factor * length_um + margin / 2, bar[1], f"{written}, drawn {factor:g} times as long",
        va="center_baseline", fontsize=9,
    )  # fmt: skip
    reached = np.concatenate([rim, ends, bar[None] - margin])
    ax.set(
        xlim=(reached[:, 0].min() - margin, reached[:, 0].max() + margin),
        ylim=(reached[:, 1].min(), reached[:, 1].max() + margin),
        aspect="equal",
    )
    ax.axis("off")
    bar_axes = ax.figure.colorbar(ScalarMappable(norm, colors), ax=ax, shrink=0.7, pad=0.02, aspect=26)
    bar_axes.set_label("height z over the design, um")
    return ax


def draw_residual_vectors(
    pixels: Array, residual: Array, rejected: tuple[Array, Array], factor: float, camera: Camera, ax: "Axes"
) -> "Axes":
    """Draw residuals (k, 2) as strokes from where the dots were seen, `factor` times as long; rejected ones crossed.

    Of very many only every second, third... is drawn.
    """
    every = max(1, -(-len(pixels) // _MOST_VECTORS))
    start, step = pixels[::every], residual[::every]
    ax.plot(*_strokes(start, start + factor * step), color=SERIES[0]["color"], linewidth=0.9, zorder=2)
    ax.plot(*start.T, linestyle="none", marker="o", markersize=1.8, color=SERIES[0]["color"], label="dot", zorder=2)
    start, step = rejected
    if len(start):
        # Far-off dots would leave the picture.
        length = np.linalg.norm(factor * step, axis=1, keepdims=True)
        step = factor * step * np.minimum(1.0, camera.width / 8 / np.maximum(length, 1e-9))
        ax.plot(*_strokes(start, start + step), color=SERIES[1]["color"], linewidth=1.1, zorder=3)
        ax.plot(
            *start.T, linestyle="none", marker="x", markersize=6, color=SERIES[1]["color"], label="rejected", zorder=3
        )
        legend_below(ax)
    return image_axes(camera, ax)


def draw_image_coverage(pixels: list[Array], camera: Camera, ax: "Axes") -> "Axes":
    """Draw the outline of the dots (k, 2) of each view over the image."""
    import cv2
    from matplotlib.patches import Polygon

    for dots in pixels:
        hull = cv2.convexHull(dots.astype(np.float32))[:, 0]
        ax.add_patch(Polygon(hull, facecolor=SERIES[0]["color"], alpha=min(0.15, 2 / len(pixels)), linewidth=0))
        ax.add_patch(Polygon(hull, fill=False, edgecolor=SERIES[0]["color"], linewidth=0.6))
    return image_axes(camera, ax)


def draw_directions(rotation: Array, tilt_deg: Array, ax: "Axes") -> "Axes":
    """Draw from which side each photograph was taken: tilt as the distance from the middle, a hand for the turn.

    The side is that of the camera as seen from the front of the marker, its x to the right and y up; the hand points to
    where the upper edge of the image is in this view.
    """
    spots = tilt_deg[:, None] * _unit(-rotation[:, 2, :2])
    outermost = next((ring for ring in _RINGS if ring >= tilt_deg.max()), 90)
    for ring in (*(tilt for tilt in _RINGS if tilt < outermost), outermost):
        ax.plot(ring * np.cos(_AROUND), ring * np.sin(_AROUND), color=FAINT, linewidth=0.8, zorder=1)
        ax.text(0, ring, f"{ring}°", ha="center", va="bottom", fontsize=8, color=MUTED, zorder=1)
    for angle in np.arange(4) * np.pi / 4:
        along = outermost * np.array([np.cos(angle), np.sin(angle)])
        ax.plot([-along[0], along[0]], [-along[1], along[1]], color=FAINT, linewidth=0.8, zorder=1)
    hands = spots + 0.13 * outermost * _unit(-rotation[:, 1, :2])
    ax.plot(*_strokes(spots, hands), color=SERIES[0]["color"], linewidth=1.5, zorder=3)
    ax.plot(*spots.T, linestyle="none", marker="o", markersize=5, color=SERIES[0]["color"], zorder=3)
    ax.text(1.04 * outermost, 0, "x", ha="left", va="center", style="italic", color=MUTED)
    ax.text(0, -1.04 * outermost, "tilt", ha="center", va="top", fontsize=8.5, color=MUTED)
    reach = 1.18 * outermost
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ax.axis("off")
    return ax


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def draw_left_out(cross: CrossValidation, ax: "Axes") -> "Axes":
    """Draw the RMS residual of each left-out photograph, with the design and, if it was measured, with the print."""
    from matplotlib.ticker import MaxNLocator

    numbers = cross.photos + 1
    prints = [("as designed", cross.best_nominal, SERIES[1]), ("as measured", cross.measured, SERIES[0])]
    for name, left_out, look in prints[: 1 if cross.gain is None else 2]:
        values = [positive(value) for value in left_out.rms_each]
        marks: dict[str, Any] = {**look, "linestyle": "none", "markersize": 6}
        ax.plot(numbers, values, label=f"print {name}", **marks)
        ax.axhline(left_out.rms, color=look["color"], linestyle=look["linestyle"], linewidth=1.0, zorder=1)
    log_axis(ax, "y")
    ax.set(xlabel="number of the photograph", ylabel="RMS residual when left out, px")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(ax)
    return ax


def _strokes(start: Array, end: Array) -> tuple[Array, Array]:
    """Coordinates of separate strokes as one line with gaps."""
    line = np.stack([start, end, np.full_like(start, np.nan)], axis=1).reshape(-1, 2)
    return line[:, 0], line[:, 1]
