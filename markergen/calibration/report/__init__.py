"""The report of a calibration: one self-contained HTML file, with the same bytes for the same results."""

from importlib.resources import files
from typing import TYPE_CHECKING

from markergen import __version__
from markergen.calibration.report import sections
from markergen.calibration.report.subject import Subject
from markergen.presentation.pages import page_bytes
from markergen.validation.report.overview import title

if TYPE_CHECKING:
    from markergen.calibration.calibration import Calibration

TEMPLATE = "calibration.html.j2"


def page(found: "Calibration") -> bytes:
    """Make a self-contained HTML page from a calibration.

    Returns
    -------
    bytes
        UTF-8 without scripts, dates or external resources. Text from files is escaped.
    """
    subject = Subject(found)
    made = sections.present(
        [
            ("print", "The print", sections.print_found(subject)),
            ("relation", "The rig", sections.relation(subject)),
            ("judged", "Does it hold?", sections.judgment(subject)),
            ("camera", "The camera", sections.camera(subject)),
            ("photos", "Photographs", sections.photos(subject)),
            ("coverage", "Coverage", sections.coverage(subject)),
            ("next", "Next photographs", sections.next_photos(subject)),
        ]
    )
    return page_bytes(
        files(__name__).joinpath(TEMPLATE).read_text("utf-8"),
        {
            "title": "; ".join(title(marker) for marker in found.designs),
            "version": __version__,
            "found": found,
            "answer": sections.answer(subject),
            "sections": made,
        },
    )
