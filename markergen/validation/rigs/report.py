"""The report of a rig: one self-contained HTML file, with the same bytes for the same results."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.resources import files
from typing import Any

from markergen import __version__
from markergen.model.camera import Camera
from markergen.model.rig import Rig
from markergen.model.rig_picture import draw_rig, sides
from markergen.presentation.pages import data_uri, page_bytes
from markergen.presentation.plots import plot
from markergen.presentation.tables import Table
from markergen.units import format_length
from markergen.validation.report.subject import ReportSection
from markergen.validation.tables import limit_sentences
from markergen.validation.views import Picture

TEMPLATE = "rig.html.j2"


def rig_report(
    rig: Rig,
    camera: Camera,
    results: Mapping[str, Any],
    answer: Sequence[str],
    tables: Sequence[Table],
    errors: Callable[..., Any],
    pictures: Sequence[Picture],
) -> bytes:
    """Make a self-contained HTML page from the results of a rig's validation.

    Parameters
    ----------
    results : mapping
        In the form described in docs/rigs.md.
    answer : sequence of str
        Sentences for the top of the page.
    tables : sequence of Table
        What to expect first, then the other results.
    errors : callable
        Draws the errors on axes.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    """
    dots = [[each.name, str(len(each.marker)), format_length(each.marker.dot_diameter)] for each in rig.markers]
    body = ReportSection(
        [f"{rig!r}"[4:-1].capitalize() + "."],
        [
            plot(
                partial(draw_rig, rig, direction), f"rig-{side}",
                f"The rig from its {side}: {', '.join(each.name for each in rig.markers)}.",
                f"The rig as seen from its {side}, from far away. Axes are those of the rig frame.",
                (4.4, 4.4),
            )
            for side, direction in sides(rig).items()
        ],
        [Table("Markers", ["marker", "dots", "diameter"], dots)],
    )  # fmt: skip
    measured = ReportSection(tables=list(tables[1:]))
    if results["runs"]:
        caption = "RMS rotation error in the trials by distance, with the bound of all plates in view."
        measured.plots.append(plot(errors, "errors", caption, caption))
    return page_bytes(
        files(__name__.rpartition(".")[0]).joinpath(TEMPLATE).read_text("utf-8"),
        {
            "title": f"{len(rig.markers)} markers with {len(rig)} dots",
            "version": __version__,
            "camera": camera,
            "poses": results["poses"],
            "sections": [
                ("answer", "What to expect", ReportSection(list(answer), tables=[tables[0]])),
                ("rig", "The rig", body),
                ("limits", "What limits it", ReportSection(limit_sentences(results))),
                ("errors", "Errors", measured),
            ],
            "pictures": [(picture, data_uri(picture.png)) for picture in pictures],
        },
    )
