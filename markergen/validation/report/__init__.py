"""The report: one self-contained HTML file, with the same bytes for the same results."""

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
        UTF-8 without scripts, dates or external resources. Text from files is escaped.
    """
    # Null parts count as missing.
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
