"""The report of a rig: one self-contained HTML file, with the same bytes for the same results."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from markergen.model.picture import draw_rig, sides
from markergen.presentation.pages import Section, page
from markergen.presentation.plots import plot
from markergen.presentation.tables import Table
from markergen.units import format_length
from markergen.validation.report import method, sample_views, seen_by
from markergen.validation.report.pose_dome import pose_dome
from markergen.validation.rigs.bounds import Visibility, budget_of
from markergen.validation.tables import limit_sentences
from markergen.validation.views import Picture


def rig_report(
    shown: Visibility,
    results: Mapping[str, Any],
    answer: Sequence[str],
    tables: Sequence[Table],
    errors: Callable[..., Any],
    pictures: Sequence[Picture],
) -> bytes:
    """Make a self-contained HTML page from the results of a rig's validation.

    Parameters
    ----------
    shown : Visibility
        What each pose shows of the rig, with its camera.
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
    rig = shown.series.rig
    dots = [[each.name, str(len(each.marker)), format_length(each.marker.dot_diameter)] for each in rig.markers]
    body = Section(
        [f"{rig!r}"[4:-1].capitalize() + "."],
        [
            plot(
                partial(draw_rig, rig, direction), f"rig-{side}",
                f"The rig from its {side}: {', '.join(each.name for each in rig.markers)}.",
                f"The rig as seen from its {side}, from far away. Axes are those of the rig frame.",
                (4.4, 4.4), "paper",
            )
            for side, direction in sides(rig).items()
        ],
        [Table("Markers", ["marker", "dots", "diameter"], dots)],
        book=("rigs and their file", "rigs.md#rigjson"),
    )  # fmt: skip
    measured = Section(tables=list(tables[1:]))
    if results["runs"]:
        caption = "RMS rotation error in the trials by distance, with the bound of all plates in view."
        measured.plots.append(plot(errors, "errors", caption, caption))
    poses, camera = shown.series.poses, shown.series.camera
    budget = budget_of(shown)
    expected = {"rotation": budget.rotation_deg["total"], "translation": 1e3 * budget.translation["total"]}
    around = pose_dome(
        rig.markers,
        poses,
        {name: np.where(shown.served, values, np.inf) for name, values in expected.items()},
        results["headline"]["source"],
        [f"{count} plate{'s' * (count != 1)} in view" for count in shown.plates.tolist()],
    )
    title = f"{len(rig.markers)} markers with {len(rig)} dots"
    return page(
        "Rig report",
        title,
        [
            ("answer", "What to expect", Section(list(answer), around, [tables[0]])),
            ("limits", "What limits it", Section(limit_sentences(results))),
            ("rig", "The rig", body),
            ("pictures", "Sample views", sample_views(pictures)),
            ("errors", "Errors", measured),
            (
                "method",
                "How it was measured",
                Section(
                    terms=method.RIG,
                    book=("what is measured, and how", "rigs.md#what-markergen-validate-rigjson-measures"),
                ),
            ),
        ],
        f"{title}. {seen_by(camera)}. {len(poses)} poses ({poses.name}), of which {int(shown.served.sum())} show a "
        "plate well enough to find it.",
        "The same rig, options, and seed give the same page.",
    )
