"""The result of a validation: to print, draw, save, check and process."""
# tests: tests/api/test_validate.py tests/validation/test_result.py

import math
import operator
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from markergen.errors import InputError, brief
from markergen.files import Written, write_all
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.objectives import Setting
from markergen.options import Progress, check_progress
from markergen.presentation.plots import axes_of
from markergen.presentation.results import SavableResult, StrPath, Targets, json_bytes
from markergen.presentation.tables import Table, data_frame, number
from markergen.validation import tables
from markergen.validation.bounds import budget_of
from markergen.validation.metrics import STATISTICS
from markergen.validation.report import html_report, rig_report
from markergen.validation.report.plots import errors_over
from markergen.validation.sentences import (
    agreement,
    detail_sentences,
    detection_sentence,
    limit_sentences,
    plan_sentences,
)
from markergen.validation.setting import setting_for
from markergen.validation.view_records import DETECTOR
from markergen.validation.views import Picture, SyntheticViews, remove_earlier
from markergen.validation.views import pictures as drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

OPERATORS = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le}

_EXPRESSION = re.compile(r"\s*([^\s<>=]+)\s*(>=|<=|>|<)\s*([^\s<>=]+)\s*")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def parse_condition(expression: str) -> tuple[str, str, str]:
    """Split an expression into path, comparison and text of the number; raises InputError if it is malformed."""
    match = _EXPRESSION.fullmatch(expression)
    if match is None or not _NUMBER.fullmatch(match[3]):
        raise InputError(
            "a path, one of > >= < <=, and a number",
            repr(expression),
            "write for example 'estimators.lm.rotation_deg.rms > 0.5'",
        )
    return match[1], match[2], match[3]


def check_condition(expression: str, results: Mapping[str, Any]) -> tuple[bool, str]:
    """Evaluate a condition that must not hold: a path into the results, one of > >= < <=, and a number.

    Parameters
    ----------
    expression : str
        The parts of the path are joined by dots; a key that contains dots is written as it is.
    results : mapping
        Plain JSON values.

    Returns
    -------
    passed : bool
        False if the comparison holds, or if there is no value because nothing was detected.
    message : str
        Value found and comparison, one line.

    Raises
    ------
    InputError
        If the expression is malformed or its path does not lead to a number; the message lists the available keys.

    Examples
    --------
    >>> check_condition("bound.by_polar_angle.17.5 > 0.5", {"bound": {"by_polar_angle": {"17.5": 0.61}}})
    (False, 'bound.by_polar_angle.17.5 = 0.61 > 0.5')
    """
    path, sign, limit = parse_condition(expression)
    value = _number(path, results)
    if value is None:
        return False, f"{path} has no value in this run, so it is not known to be within {limit}"
    holds = OPERATORS[sign](value, float(limit))
    relation = sign if holds else {">": "<=", ">=": "<", "<": ">=", "<=": ">"}[sign]
    return not holds, f"{path} = {value:.6g} {relation} {limit}"


def _number(path: str, results: Mapping[str, Any]) -> float | None:
    value, reached, rest = _follow(results, path)
    where = f"under {reached!r}" if reached else "in the results"
    children = _children(value)
    if children:
        problem = repr(rest) if rest else "a group"
        raise InputError(f"a path to a number {where}", problem, f"known there: {', '.join(children)}")
    if rest and (value is None or value == {}):
        raise InputError(f"results under {reached!r}", "none in this run", "ask for them with --runs or --views")
    if rest:
        raise InputError(f"a group {where}", f"no {rest!r} in it: {value!r} is a value", f"end the path at {reached!r}")
    if value is None and "." not in path:
        raise InputError(f"results under {path!r}", "none in this run", "ask for them with --runs or --views")
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"a number at {path!r}", repr(value), "choose a path that leads to a number")
    return value


def _follow(value: Any, path: str) -> tuple[Any, str, str]:
    """Follow a path as far as possible; return the value there, the path to it, and the rest of the path.

    Since keys may contain dots, every key that starts the path is tried, and the longest match taken; of two complete
    matches, the one that ends at a value.
    """
    ways = [(value, "", path)]
    for key, child in _children(value).items():
        if path == key:
            ways.append((child, key, ""))
        elif path.startswith(key + "."):
            child_value, reached, rest = _follow(child, path[len(key) + 1 :])
            ways.append((child_value, f"{key}.{reached}" if reached else key, rest))
    return min(ways, key=lambda way: (len(way[2]), len(_children(way[0])) > 0))


def _children(value: Any) -> dict[str, Any]:
    if isinstance(value, Mapping):
        return {str(key): child for key, child in value.items()}
    if isinstance(value, list):
        return {str(index): child for index, child in enumerate(value)}
    return {}


class Validation(SavableResult):
    """The result of `markergen.validate`.

    ``print(validation)`` shows what the command prints. It can be pickled, and keeps no images: those for a report or a
    folder of pictures are rendered again, identically.

    Parameters
    ----------
    results : mapping
        Return value of `validation.validate`, in the form described in docs/validate.md, of a rig in docs/rigs.md.
    series : SyntheticViews
        Marker or rig, camera, poses, optics and error sources of the results.
    written : sequence of Written
        Files that were written together with the results.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, dot="30mm", restarts=2).marker
    >>> validation = mg.validate(marker, poses="cone:count=20", runs=0, views=0)
    >>> 0 < validation.bound["rotation_deg"] < 1
    True
    >>> print(validation.views)
    None

    Of a rig, all plates in view are compared with the best of them alone:

    >>> marker = mg.design(n=5, boundary="rect:80mmx80mm", restarts=2).marker
    >>> upright, side = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    >>> faces = mg.Plate("+z", marker, upright, [0, 0, 0.04]), mg.Plate("+x", marker, side, [0.04, 0, 0])
    >>> poses = "cone:tilt=40..50,azimuth=0,distance=0.3,count=10"
    >>> validation = mg.validate(mg.Rig(faces), poses=poses, runs=0, views=0)
    >>> both = validation.headline["by_plates"]["2"]
    >>> both["rotation_deg"] < both["alone"]["rotation_deg"]
    True
    """

    KINDS: ClassVar[Mapping[str, str]] = {
        ".html": "report",
        ".htm": "report",
        ".json": "json",
        ".svg": "plot",
        ".png": "plot",
    }

    def __init__(
        self, results: Mapping[str, Any], series: SyntheticViews[Any], written: Sequence[Written] = ()
    ) -> None:
        self._results = dict(results)
        self.series, self.written = series, tuple(written)

    @property
    def marker(self) -> Marker | Rig:
        """The marker that was validated, or the rig."""
        return self.series.marker

    @property
    def setting(self) -> Setting:
        """Camera, and the poses that see the entire marker; of a rig, all poses, with the dots that each shows."""
        return setting_for(self.marker, self.series.camera, self.series.poses)

    @property
    def results(self) -> Mapping[str, Any]:
        """All results as plain JSON values, see docs/validate.md; read-only."""
        return MappingProxyType(self._results)

    @property
    def bound(self) -> Mapping[str, Any]:
        """RMS Cramer-Rao bounds ``rotation_deg`` and ``translation_pct``, also ``by_polar_angle``, ``by_distance``.

        Those of a rig are ``by_plates`` in view instead of ``by_polar_angle``.
        """
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
        return check_condition(expression, self._results)

    def save(self, *paths: StrPath, progress: Progress | None = None, **named: Any) -> list[Written]:
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
        targets = self.targets(paths, **named)
        check_pictures(targets, self.series.count)
        return self.write(targets.checked(), progress)

    def write(self, targets: Targets, progress: Progress | None = None) -> list[Written]:
        """Write files that were sorted and checked before, and the pictures of views that they need."""
        report = progress or (lambda *_: None)
        images: list[Picture] = []
        if self.views and (targets.pictures is not None or "report" in [kind for kind, _ in targets.files]):
            report("pictures", 0, 1)
            images = list(drawn(self.series, self.views))
            report("pictures", 1, 1)
        contents = {}
        for kind, path in targets.files:
            if kind == "report":
                report("report", 0, 1)
                contents[path] = self._report(images)
                report("report", 1, 1)
            else:
                contents[path] = self.content(kind, path)
        if targets.pictures is not None:
            contents |= {targets.pictures / f"{picture.name}.png": picture.png for picture in images}
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

    @property
    def nees(self) -> Mapping[str, Any] | None:
        """Normalized estimation error squared of LM, 6 on average if the covariances are right; None for 0 runs."""
        nees = self._results["nees"]
        return None if nees is None else MappingProxyType(nees)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with one row per estimator and polar angle, and one over all poses.

        Its columns are ``source`` (``trials`` or ``views``; ``bound`` if there are neither), ``estimator``,
        ``polar_angle_deg`` (a text: an angle, a bin such as ``30..40``, or ``all``; of a rig ``plates``, the number of
        plates in view), mean, std, rms, median, p95 and max of ``rotation_deg`` and ``translation_pct`` (as in
        ``rotation_deg_rms``), each with its ``bound``, ``efficiency``, ``flip_rate`` and ``failure_rate``. Undefined
        values are missing.

        Raises
        ------
        MissingLibraryError
            If pandas is not installed.
        """
        column, groups = ("plates", "by_plates") if self._is_rig else ("polar_angle_deg", "by_polar_angle")
        rows = []
        for name, estimator in self.estimators.items():
            for group, row in {"all": estimator, **estimator[groups]}.items():
                bound = row["bound"] if self._is_rig else self.bound if group == "all" else self.bound[groups][group]
                rows.append({"source": "trials", "estimator": name, column: group, **_columns(row, bound)})
        views = self.views or {"estimators": {}, groups: {}}
        for name in views.get("estimators", (DETECTOR,)):
            for group, row in {"all": views, **views[groups]}.items():
                measured = row["estimators"][name] if "estimators" in row else row
                rows.append({"source": "views", "estimator": name, column: group, **_columns(measured, {})})
        for group, bound in {"all": self.bound, **self.bound[groups]}.items() if not rows else ():
            rows.append({"source": "bound", "estimator": None, column: group, **_columns({}, bound)})
        return data_frame(rows)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the RMS rotation error of each estimator over the polar angle, with the bound beneath.

        Of a rig: of all plates in view and of the best alone, over the distance.

        The errors are those of the trials, or, if there were none, of the synthetic views.

        Parameters
        ----------
        ax : matplotlib axes or None
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        ax = axes_of(ax)
        groups, label = ("by_distance", "distance, m") if self._is_rig else ("by_polar_angle", "tilt, deg")
        titles = tables.RIG_TITLES if self._is_rig else {}
        measured = {titles.get(name, name): _rotation(row[groups]) for name, row in self.estimators.items()}
        if self.views and not measured and not self._is_rig:
            views = self.views[groups]
            for name in self.views["estimators"]:
                measured[name] = _rotation({group: row["estimators"][name] for group, row in views.items()})
        errors_over(measured, _rotation(self.bound[groups]), ax)
        ax.set_xlabel(label)
        ax.set_ylabel("rotation error, deg")
        return ax

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results = self._results
        plan, *more = plan_sentences(results)
        # The verdict last, where a terminal still shows it.
        return [tables.conditions(results), *tables.result_tables(results), *detail_sentences(results), *more, plan]

    def brief(self) -> list[str | Table]:
        """See `Result.brief`: the verdict, what the views show, and what limits it."""
        results, views = self._results, self._results["views"]
        plan = plan_sentences(results)
        if not self._is_rig:
            compared = results["headline"]["views"]
            plan = [*plan[:2], *([detection_sentence(views)] if views else [])]
            plan += agreement(compared) if compared and compared["disagreements"] else []
        return [*plan, *limit_sentences(results)]

    def __repr__(self) -> str:
        results, views = self._results, self._results["views"]
        plan, poses = results["headline"], f"{results['poses']['count']} poses"
        if self._is_rig:
            parts = [f"{len(self.marker.plates)} markers", poses]
        else:
            parts = [f"{len(self.marker)} dots", f"{poses} x {results['runs']} runs"]
        if views:
            parts.append(f"{views['detected']} of {views['count']} views found")
        parts.append(f"plan with {number(plan['rotation_deg'])} deg {number(plan['translation_mm'])} mm")
        if not self._is_rig:
            if views and plan["views"]["disagreements"]:
                parts.append("the views disagree")
            measured = {"bound": self.bound, **{name: _rms(row) for name, row in self.estimators.items()}}
            parts += [
                f"{name} {number(row['rotation_deg'])} deg {number(row['translation_pct'])} %"
                for name, row in measured.items()
            ]
        return f"<Validation: {', '.join(parts)}>"

    @property
    def _is_rig(self) -> bool:
        return "rig" in self._results

    def _report(self, images: Sequence[Picture]) -> bytes:
        if self._is_rig:
            return rig_report(self.series, self._results, self.plot, images)
        budget = budget_of(self.series, self._results["noise_px"])
        return html_report(self._results, self.series.marker, self.setting, images, budget)


def _rotation(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {group: row["rotation_deg"] for group, row in rows.items()}


def _rms(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: row[key]["rms"] for key in ("rotation_deg", "translation_pct")}


def _columns(row: Mapping[str, Any], bound: Mapping[str, Any]) -> dict[str, Any]:
    columns: dict[str, Any] = {}
    for key in ("rotation_deg", "translation_pct"):
        columns |= {f"{key}_{name}": row.get(key, {}).get(name) for name in ("count", *STATISTICS)}
        columns[f"{key}_bound"] = bound.get(key)
    return columns | {key: row.get(key) for key in ("efficiency", "flip_rate", "failure_rate")}


def check_pictures(targets: Targets, views: int) -> None:
    """Refuse a folder for pictures if there are no views; raises InputError."""
    if targets.pictures is not None and not views:
        raise InputError("views to take", "--views 0", "leave out --pictures, or ask for views")
