"""The report: one HTML file that holds all it shows, the same bytes from the same results."""

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from markergen import __version__
from markergen.estimators.budget import PoseBudget
from markergen.model.marker import Marker
from markergen.objectives import Setting
from markergen.presentation.pages import data_uri, page_bytes
from markergen.validation.report import measured, overview
from markergen.validation.report.subject import Subject
from markergen.validation.views import Picture

TEMPLATE = "report.html.j2"


def html_report(
    results: dict[str, Any],
    marker: Marker,
    setting: Setting,
    pictures: Sequence[Picture] = (),
    budget: PoseBudget | None = None,
) -> bytes:
    """Make one self-contained HTML page of the results of a validation.

    Parameters
    ----------
    results : dict
        In the form that docs/validate.md describes. A part that is missing or null leaves its section out, with a
        sentence how to get it.
    marker : Marker
    setting : Setting
        Camera and poses of the results; their order decides what ``pose`` means in the samples.
    pictures : sequence of Picture
        Sample views, worst cases, failures; shown in this order.
    budget : PoseBudget or None
        Covariances (P, 6, 6) of the setting's poses by source. With it the report says what to expect of the whole
        budget, without it of image noise alone.

    Returns
    -------
    bytes
        UTF-8; no scripts, no dates, nothing loaded from elsewhere. What comes from files is escaped.
    """
    # A part that is null is one that is missing.
    present = {key: part for key, part in results.items() if part is not None}
    subject = Subject(present, marker, setting, budget)
    camera, poses = setting.camera, setting.poses
    return page_bytes(
        files(__name__).joinpath(TEMPLATE).read_text("utf-8"),
        {
            "title": overview.title(marker),
            "version": __version__,
            "camera": camera,
            "poses": poses,
            "answer": overview.answer(subject),
            "limits": overview.limits(subject),
            "marker": overview.the_marker(subject),
            "labels": overview.labels(subject),
            "origin": overview.origin(marker),
            "provenance": overview.provenance(marker),
            "pose_space": overview.pose_space(subject),
            "trials": measured.trials(subject),
            "views": measured.views(subject),
            "ellipses": measured.ellipses(subject),
            "comparison": overview.comparison(subject),
            "pictures": [(picture, data_uri(picture.png)) for picture in pictures],
            "advice": overview.size_advice(subject),
            "command": overview.command(subject),
        },
    )
