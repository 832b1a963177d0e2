"""What the results of validating a marker and of validating a rig have in common: access by name, checks, and files."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from markergen.errors import InputError, brief
from markergen.files import Written, write_all
from markergen.options import Progress, check_progress
from markergen.presentation.plots import figure_bytes, new_figure
from markergen.presentation.results import SavableResult, StrPath, Targets, json_bytes
from markergen.validation import fail_if
from markergen.validation.views import Picture, ViewSeries, remove_earlier
from markergen.validation.views import pictures as drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


S = TypeVar("S", bound=ViewSeries[Any])


class ValidationResult(SavableResult, Generic[S]):
    """The result of a validation.

    Parameters
    ----------
    results : mapping
        In the form described in docs/validate.md.
    series : ViewSeries
        Marker or rig, camera, poses, optics and error sources of the results.
    written : sequence of Written
        Files that were written together with the results.
    """

    KINDS: ClassVar[Mapping[str, str]] = {
        ".html": "report",
        ".htm": "report",
        ".json": "json",
        ".svg": "plot",
        ".png": "plot",
    }

    def __init__(self, results: Mapping[str, Any], series: S, written: Sequence[Written] = ()) -> None:
        self._results = dict(results)
        self.series, self.written = series, tuple(written)

    @property
    def results(self) -> Mapping[str, Any]:
        """All results as plain JSON values, see docs/validate.md; read-only."""
        return MappingProxyType(self._results)

    @property
    def bound(self) -> Mapping[str, Any]:
        """RMS Cramer-Rao bounds ``rotation_deg`` and ``translation_pct``, also ``by_polar_angle``, ``by_distance``."""
        return MappingProxyType(self._results["bound"])

    @property
    def estimators(self) -> Mapping[str, Any]:
        """Errors in the trials by estimator, such as ``estimators["lm"]["rotation_deg"]["rms"]``; empty for 0 runs."""
        return MappingProxyType(self._results["estimators"])

    @property
    def views(self) -> Mapping[str, Any] | None:
        """Results of the synthetic views; None if there were none."""
        views = self._results["views"]
        return None if views is None else MappingProxyType(views)

    @property
    def budget(self) -> Mapping[str, Any]:
        """RMS pose errors by source, to first order: image, print, camera, total."""
        return MappingProxyType(self._results["budget"])

    @property
    def headline(self) -> Mapping[str, Any]:
        """The error to plan with, such as ``headline["rotation_deg"]``, and what the views say to it."""
        return MappingProxyType(self._results["headline"])

    def check(self, expression: str) -> tuple[bool, str]:
        """Evaluate a condition that must not hold, such as ``estimators.lm.rotation_deg.rms > 0.5``.

        Returns
        -------
        passed : bool
            False if the comparison holds, or if the value does not exist.
        sentence : str
            What was found.

        Raises
        ------
        InputError
            If the expression is malformed, or its path does not lead to a number; the message lists the available keys.
        """
        if not isinstance(expression, str):
            raise InputError("an expression", brief(expression), "write 'estimators.lm.rotation_deg.rms > 0.5'")
        return fail_if.check(expression, self._results)

    def save(
        self,
        *paths: StrPath,
        json: StrPath | None = None,
        report: StrPath | None = None,
        pictures: StrPath | None = None,
        progress: Progress | None = None,
    ) -> list[Written]:
        """Write files by suffix: .html for the report, .json the results, .svg or .png the plot; see `SavableResult`.

        Parameters
        ----------
        json, report : path or None
            Files for the results, under any suffix, and for the report.
        pictures : path or None
            Folder for failed, worst and typical views as .png, replacing those of an earlier run. Raises InputError if
            there are no views.
        progress : callable or None
            Called with the stage, the amount done, and the total.
        """
        check_progress(progress)
        targets = self.targets(paths, pictures, json=json, report=report)
        check_pictures(targets, self.series.count)
        return self.write(targets.checked(), progress)

    def write(self, targets: Targets, progress: Progress | None = None) -> list[Written]:
        """Write files that were sorted and checked before, and the pictures of views that they need."""
        told = progress or (lambda *_: None)
        shown: list[Picture] = []
        if self.views and (targets.pictures is not None or "report" in [kind for kind, _ in targets.files]):
            told("pictures", 0, 1)
            shown = list(drawn(self.series, self.views))
            told("pictures", 1, 1)
        contents = {}
        for kind, path in targets.files:
            if kind == "report":
                told("report", 0, 1)
                contents[path] = self._report(shown)
                told("report", 1, 1)
            else:
                contents[path] = self.to_json() if kind == "json" else figure_bytes(self._figure, path)
        if targets.pictures is not None:
            contents |= {targets.pictures / f"{picture.name}.png": picture.png for picture in shown}
        write_all(contents)
        if targets.pictures is not None:
            remove_earlier(targets.pictures, {path.name for path in contents})
        return [Written(path) for path in contents]

    def save_pictures(self, folder: StrPath) -> list[Written]:
        """Write failed, worst and typical views, see `save`."""
        return self.save(pictures=folder)

    def to_json(self) -> bytes:
        """Return the results as JSON text."""
        return json_bytes(self._results)

    @abstractmethod
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the errors and their bound; None makes a new figure, available as ``ax.figure``."""

    @abstractmethod
    def _report(self, shown: Sequence[Picture]) -> bytes:
        """Return the report as an HTML page, with these pictures."""

    def _figure(self) -> "Figure":
        figure = new_figure()
        self.plot(figure.add_subplot())
        return figure


def check_pictures(targets: Targets, views: int) -> None:
    """Refuse a folder for pictures if there are no views; raises InputError."""
    if targets.pictures is not None and not views:
        raise InputError("views to take", "--views 0", "leave out --pictures, or ask for views")
