"""The report of a calibration: one self-contained HTML file, with the same bytes for the same results."""

from typing import TYPE_CHECKING

from markergen.calibration.report import sections
from markergen.calibration.report.subject import Subject
from markergen.presentation import pages
from markergen.validation.report.overview import title

if TYPE_CHECKING:
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
        "length, fix what no photograph tells: all dots together neither shift nor turn nor grow against the design.",
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


def page(found: "Calibration") -> bytes:
    """Make a self-contained HTML page from a calibration.

    Returns
    -------
    bytes
        UTF-8 without scripts, dates or external resources. Text from files is escaped.
    """
    subject = Subject(found)
    designs = "; ".join(title(marker) for marker in found.designs)
    photos, size = len(found.sightings.photos), found.sightings.size
    known = "the camera given with its errors" if found.camera_covariance is not None else "the camera taken as given"
    return pages.page(
        "Calibration report",
        designs,
        [
            ("answer", "What to expect", sections.answer(subject)),
            ("print", "The print", sections.print_found(subject)),
            ("relation", "The rig", sections.relation(subject)),
            ("judged", "Does it hold?", sections.judgment(subject)),
            ("camera", "The camera", sections.camera(subject)),
            ("photos", "Photographs", sections.photos(subject)),
            ("coverage", "Coverage", sections.coverage(subject)),
            ("next", "Next photographs", sections.next_photos(subject)),
            (
                "method",
                "How it was measured",
                pages.Section(terms=METHOD, book=("what it does", "calibrate.md#what-it-does")),
            ),
        ],
        f"{designs}. {photos} photographs of {size[0]} x {size[1]} px; the print was "
        f"{'measured' if found.measured else 'taken as designed'}, "
        f"{'the camera calibrated' if found.estimated else known}.",
        "The same photographs and options give the same page.",
    )
