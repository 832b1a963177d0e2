"""The report: one self-contained HTML file, with the same bytes for the same results."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from markergen.estimators.budget import PoseBudget
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.picture import draw_rig, sides
from markergen.model.rig import Rig
from markergen.objectives import Setting
from markergen.presentation.pages import Section, page, picture
from markergen.presentation.plots import plot
from markergen.presentation.tables import Table
from markergen.units import format_length
from markergen.validation import headline, tables
from markergen.validation.bounds import budget_of
from markergen.validation.report import measured, method, overview, pose_dome
from markergen.validation.report.subject import Subject
from markergen.validation.views import Picture, SyntheticViews


def html_report(
    results: dict[str, Any],
    marker: Marker,
    setting: Setting,
    pictures: Sequence[Picture] = (),
    budget: PoseBudget | None = None,
) -> bytes:
    """Make a self-contained HTML page from the results of a validation.

    Parameters
    ----------
    results : dict
        In the form described in docs/validate.md. A missing or null part omits its section, with a sentence on how to
        obtain it.
    marker : Marker
    setting : Setting
        Camera and poses of the results; their order defines the ``pose`` indices of the samples.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    budget : PoseBudget or None
        Covariances (P, 6, 6) of the setting's poses by source. With it the report predicts errors for the whole budget,
        without it for image noise alone.

    Returns
    -------
    bytes
        UTF-8 without dates or external resources; its only script is the dome of poses. Text from files is escaped.
    """
    # Null parts count as missing.
    present = {key: part for key, part in results.items() if part is not None}
    subject = Subject(present, marker, setting, budget)
    poses = setting.poses
    left_out = f", {poses.dropped} more do not see the whole marker" if poses.dropped else ""
    errors = Section(
        parts=[
            ("With noisy image points", measured.trials(subject)),
            ("In rendered images", measured.views(subject)),
        ]
    )
    return page(
        "Marker report",
        overview.title(marker),
        [
            ("answer", "What to expect", overview.answer(subject)),
            ("limits", "What limits it", overview.limits(subject)),
            ("marker", "The marker", overview.the_marker(subject)),
            ("labels", "Telling the dots apart", overview.labels(subject)),
            ("pictures", "Sample views", sample_views(pictures)),
            ("errors", "Errors", errors),
            ("ellipses", "Error ellipses", measured.ellipses(subject)),
            ("beside", "Beside other layouts", overview.comparison(subject)),
            ("size", "Size of the dots", overview.size_advice(subject)),
            (
                "method",
                "How it was measured",
                Section(
                    terms=method.MARKER,
                    parts=[
                        ("To repeat it, with your files for names in capitals", Section(text=overview.command(subject)))
                    ],
                    book=("what is measured, and how", "validate.md"),
                ),
            ),
        ],
        f"{overview.title(marker)}. {seen_by(setting.camera)}. {len(poses)} poses ({poses.name}{left_out}).",
        "The same marker, options, and seed give the same page.",
    )


def rig_report(
    series: SyntheticViews[Rig],
    results: Mapping[str, Any],
    errors: Callable[..., Any],
    pictures: Sequence[Picture] = (),
) -> bytes:
    """Make a self-contained HTML page from the results of a rig's validation.

    Parameters
    ----------
    series : SyntheticViews
        Rig, camera, poses and error sources of the results.
    results : mapping
        In the form described in docs/rigs.md.
    errors : callable
        Draws the errors on axes.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    """
    rig, in_view, (expected, *measured) = series.marker, series.coverage, tables.of(results)
    dots = [[plate.name, str(len(plate.marker)), format_length(plate.marker.dot_diameter)] for plate in rig.plates]
    body = Section(
        [f"{rig!r}"[4:-1].capitalize() + "."],
        [
            plot(
                partial(draw_rig, rig, direction), f"rig-{side}",
                f"The rig from its {side}: {', '.join(plate.name for plate in rig.plates)}.",
                f"The rig as seen from its {side}, from far away. Axes are those of the rig frame.",
                (4.4, 4.4), "paper",
            )
            for side, direction in sides(rig).items()
        ],
        [Table("Markers", ["marker", "dots", "diameter"], dots)],
        book=("rigs and their file", "rigs.md#rigjson"),
    )  # fmt: skip
    section = Section(tables=measured)
    if results["runs"]:
        caption = "RMS rotation error in the trials by distance, with the bound of all plates in view."
        section.plots.append(plot(errors, "errors", caption, caption))
    poses, budget = series.poses, budget_of(series)
    whole = {"rotation": budget.rotation_deg["total"], "translation": 1e3 * budget.translation["total"]}
    around = pose_dome.pose_dome(
        rig.plates,
        poses,
        {name: np.where(in_view.served, values, np.inf) for name, values in whole.items()},
        results["headline"]["source"],
        [f"{count} plate{'s' * (count != 1)} in view" for count in in_view.plates.tolist()],
    )
    title = f"{len(rig.plates)} markers with {len(rig)} dots"
    return page(
        "Rig report",
        title,
        [
            ("answer", "What to expect", Section(headline.verdict(results), around, [expected])),
            ("limits", "What limits it", Section(tables.limit_sentences(results))),
            ("rig", "The rig", body),
            ("pictures", "Sample views", sample_views(pictures)),
            ("errors", "Errors", section),
            (
                "method",
                "How it was measured",
                Section(
                    terms=method.RIG,
                    book=("what is measured, and how", "rigs.md#what-markergen-validate-rigjson-measures"),
                ),
            ),
        ],
        f"{title}. {seen_by(series.camera)}. {len(poses)} poses ({poses.name}), of which {int(in_view.served.sum())} "
        "show a plate well enough to find it.",
        "The same rig, options, and seed give the same page.",
    )


def seen_by(camera: Camera) -> str:
    """Describe the camera of a report."""
    lens = f", {camera.distortion.model} lens" if camera.distortion.coefficients else ""
    size = f"{camera.width} x {camera.height} px"
    return f"Camera {size}, focal lengths {camera.fx:g} and {camera.fy:g} px{lens}"


def sample_views(pictures: Sequence[Picture]) -> Section:
    """Rendered views in their order."""
    plots = [picture(image.title, image.caption, image.png) for image in pictures]
    missing = "" if plots else "No pictures were made; markergen validate makes them with --views 100."
    return Section(plots=plots, missing=missing, book=("how views are made", "validate.md#views"))
