"""Spec of a sweep: a design spec with two additional tables, ``[study]`` and ``[grid]``."""

import hashlib
import itertools
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite, prod
from pathlib import Path
from typing import Any

from markergen.defaults import NOISE_PX
from markergen.errors import InputError, among, brief, with_place
from markergen.estimators import ESTIMATORS
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.json_text import in_one_line
from markergen.model.spec import AUTO, Spec
from markergen.optimize.dot_size import choose_dots
from markergen.optimize.problem import check_criteria
from markergen.read.cameras import read_camera
from markergen.read.poses import poses_from
from markergen.read.spec_file import DRAWING, spec_from_mapping
from markergen.read.templates import read_template, shipped_templates
from markergen.studies.cells import canonical_text
from markergen.studies.named import STUDIES

LAYOUTS = ("designed", "ngon", "square", "random")
"""Layout of the control points: designed for the spec, a regular polygon of maximum size, a square, or random. A square
has four control points for any n.
"""

RUNS = 100
"""Default number of noisy trials per pose, of which a sweep has many more than a validation."""

MOST_POINTS_OF_GRID, MOST_RUNS, MOST_NOISE_PX = 10_000, 2000, 1000.0
"""Maximum number of points of a grid, of trials of a pose, and of px of noise."""

MOST_NAME, SHOWN = 200, 200
"""Maximum length of a name, and maximum number of findings in a message."""

_STUDY = ("name", "seed", "runs", "estimators", "noise", "layout")
_OWN = ("noise", "layout")
"""Axes that are not keys of a design spec."""

KEYS = {"radius", *_OWN, *(field.name for field in fields(Spec))}
"""Permitted axes of a grid."""

_TEXT = "the spec"
_INVALID = f"a valid spec in {_TEXT}"
"""Expectation if a key or the form of its value is wrong."""


@dataclass(frozen=True)
class GridPoint:
    """Point of the grid.

    Attributes
    ----------
    axes : mapping
        Value of each axis, as written in the file.
    layout : str
        One of `LAYOUTS`.
    noise_px : float
        Noise of the trials.
    estimators : tuple of str
        Those that support the layout.
    """

    axes: Mapping[str, Any]
    spec: Spec
    layout: str
    noise_px: float
    estimators: tuple[str, ...]


@dataclass(frozen=True)
class Sweep:
    """Sweep that is ready to run.

    Attributes
    ----------
    fixed : mapping
        Values of the keys that are constant, as plain JSON values.
    axes : mapping
        Values of each axis of the grid, as written.
    runs : int
        Trials for each pose.
    points : tuple of GridPoint
        The last axis varies fastest.
    """

    name: str
    fixed: Mapping[str, Any]
    axes: Mapping[str, tuple[Any, ...]]
    runs: int
    points: tuple[GridPoint, ...]

    @property
    def identity(self) -> dict[str, Any]:
        """Identity of the sweep as plain JSON values: everything that determines its results."""
        points = [[point.spec.hash, point.layout, point.noise_px, *point.estimators] for point in self.points]
        return {
            "study": self.name,
            "fixed": self.fixed,
            "axes": {name: list(map(_plain, values)) for name, values in self.axes.items()},
            "runs": self.runs,
            # Includes the content of files at the time of reading, and defaults.
            "points": hashlib.sha256(canonical_text(points).encode()).hexdigest(),
        }


def studies() -> dict[str, Path]:
    """Shipped sweeps by name, in a wheel as well as in a checkout."""
    folder = next(iter(shipped_templates().values())).parent / "studies"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read_sweep(name: str, runs: int | None = None) -> Sweep:
    """Read a sweep: the name of a shipped one (see `studies`), or the path of a TOML file.

    Paths in the file are relative to the current folder, as on the command line. `runs` overrides the value of the
    file.

    Raises
    ------
    InputError
        If there is no such file, or it is not a valid sweep; all unknown keys, invalid values and impossible
        combinations are listed.
    """
    names = studies()
    if not name.endswith(".toml") and name not in names:
        raise InputError("paper, a known study, or a .toml file", repr(name), among(name, [*STUDIES, *names]))
    path = names.get(name, Path(name))
    values = read_template(str(path))
    with with_place(f"in {path}"):
        return sweep_from_mapping(values, path.stem, runs)


def sweep_from_mapping(values: Mapping[str, Any], name: str = "study", runs: int | None = None) -> Sweep:
    """Make a sweep of plain values (see `read_sweep`); `name` is the default for its name."""
    findings: list[str] = []
    fixed = {key: value for key, value in values.items() if key not in ("study", "grid", "title")}
    table = values.get("study", {})
    if runs is not None and isinstance(table, Mapping):
        table = {**table, "runs": runs}
    study = _study(table, findings)
    if "seed" in study and "seed" in fixed:
        findings.append("seed: given twice, in [study] and outside")
    if "seed" in study:
        fixed["seed"] = study["seed"]
    reading = {key: fixed.pop(key) for key in DRAWING if key in fixed}
    fixed = {key: value for key, text in fixed.items() if (value := _fit(key, text, "", findings, reading)) is not None}
    fixed |= {key: study[key] for key in _OWN if key in study}
    axes = _axes(values.get("grid", {}), findings, reading)
    if reading and "boundary" not in values and "boundary" not in axes:
        findings.append(f"{', '.join(reading)}: without a drawing as boundary")
    rooms = {"boundary", "radius"}
    for key in axes:
        if key in fixed or (key in rooms and rooms & set(fixed)):
            findings.append(f"grid.{key}: given outside the grid, too" if key in fixed else f"grid.{key}: {_ROOM}")
    estimators = tuple(study.get("estimators", ()))
    count = prod(map(len, axes.values()))
    if count > MOST_POINTS_OF_GRID:
        findings.append(f"grid: {count} combinations, at most {MOST_POINTS_OF_GRID}")
    points = [] if count > MOST_POINTS_OF_GRID else list(_combinations(axes, fixed, estimators, findings))
    if findings:
        raise InputError("a study that can be run", in_one_line(findings, SHOWN), "correct these places")
    written = {key: tuple(text for text, _ in pairs) for key, pairs in axes.items()}
    return Sweep(study.get("name", name), _plain(fixed), written, study.get("runs", RUNS), tuple(points))


_ROOM = "either radius or boundary, fixed or in the grid, not both"


def _study(table: Any, findings: list[str]) -> dict[str, Any]:
    """Valid entries of the table ``[study]``."""
    if not isinstance(table, Mapping):
        findings.append(f"study: not a table (got {brief(table)})")
        return {}
    study = {}
    for key, value in table.items():
        if key not in _STUDY:
            findings.append(_unknown("study", key, _STUDY, _STUDY))
        elif problem := _wrong(key, value):
            findings.append(f"study.{key}: {problem} (got {brief(value)})")
        else:
            study[key] = value
    return study


def _unknown(table: str, key: str, keys: Iterable[str], listed: Sequence[str]) -> str:
    """Finding for an unknown key of a table, with the nearest of its keys."""
    name = brief(key)[1:-1]
    return f"{table}.{name}: unknown key ({among(name, keys, listed)})"


def _wrong(key: str, value: Any) -> str:
    """Requirement violated by a value of ``[study]``, or of an axis that is no key of a design spec; empty if none."""
    if key == "name":
        fits = isinstance(value, str) and 0 < len(value) <= MOST_NAME and value.isprintable()
        return "" if fits else f"a line of text of at most {MOST_NAME} characters"
    if key == "runs":
        return "" if _is_whole(value, MOST_RUNS) else f"a whole number from 0 to {MOST_RUNS}"
    if key == "seed":
        return "" if _is_whole(value, 2**63 - 1) else "a whole number of 0 or more"
    if key == "noise":
        fits = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= MOST_NOISE_PX
        return "" if fits else f"a number of px above 0, at most {MOST_NOISE_PX:g}"
    if key == "layout":
        return "" if value in LAYOUTS else f"one of {', '.join(LAYOUTS)}"
    is_valid = isinstance(value, list) and all(isinstance(name, str) and name in ESTIMATORS.names() for name in value)
    return "" if is_valid and value else f"a list of {', '.join(ESTIMATORS)}"


def _is_whole(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most


def _axes(table: Any, findings: list[str], reading: Mapping[str, Any]) -> dict[str, list[tuple[Any, Any]]]:
    """Valid values of each axis: as written, and as passed to a spec."""
    if not isinstance(table, Mapping) or not table:
        findings.append("grid: missing; give at least one list, such as n = [4, 5, 6]")
        return {}
    axes = {}
    for key, values in table.items():
        if key not in KEYS and key != "shape":
            findings.append(_unknown("grid", key, KEYS, (*_OWN, "options of a spec, as in markergen design --help")))
            continue
        if not isinstance(values, list) or not values:
            findings.append(f"grid.{key}: not a list of values (got {brief(values)})")
            continue
        pairs, seen = [], set()
        for value in values:
            text = json.dumps(_plain(value), sort_keys=True)
            if text in seen:
                findings.append(f"grid.{key}: {brief(value)} twice")
            elif (fitting := _fit(key, value, "grid.", findings, reading)) is not None:
                pairs.append((value, fitting))
            seen.add(text)
        if pairs:
            axes[key] = pairs
    return axes


def _fit(key: str, value: Any, where: str, findings: list[str], reading: Mapping[str, Any]) -> Any:
    """Value as passed to a spec, drawings read as `reading` says; None, with a finding if it is invalid."""
    if key == "shape":
        findings.append(f"{where}shape: a study compares layouts of one marker; compare rigs by markergen compare")
        return None
    if key in _OWN and where:
        problem = _wrong(key, value)
        if problem:
            findings.append(f"{where}{key}: {problem} (got {brief(value)})")
        return None if problem else value
    try:
        value = _read(key, value, reading)
    except InputError as error:
        findings.append(f"{where}{key}: expected {error.args[0]}, found {error.args[1]}")
        return None
    try:
        spec_from_mapping({key: value}, _TEXT)
    except InputError as error:
        if error.args[0] == _INVALID:
            findings.append(where + error.args[1])
            return None
        # Other keys may resolve an error of `Spec` itself, which is therefore checked again for each combination.
    return value


def _read(key: str, value: Any, reading: Mapping[str, Any]) -> Any:
    """Object named by a text: a calibration file, a drawing, or a file of poses."""
    if key == "camera" and isinstance(value, str):
        return named_camera(value).as_dict()
    if key == "boundary" and isinstance(value, str):
        return spec_from_mapping({key: value, **reading}, _TEXT).boundary.as_dict()
    return value


def named_camera(text: str) -> Camera:
    """Camera named ``paper`` or by a calibration file; ``@2`` after it doubles the pixels in both directions.

    Raises
    ------
    InputError
        If the file cannot be read, or the scale is invalid.
    """
    name, mark, scale = text.rpartition("@")
    if not mark or not re.fullmatch(r"[0-9.]+", scale):
        name, scale = text, "1"
    camera = PAPER_CAMERA if name == "paper" else read_camera(name)
    try:
        factor = float(scale)
    except ValueError:
        factor = 0.0
    if not (isfinite(factor) and factor > 0):
        raise InputError("a scale above 0 after @", repr(text), "write paper@2, for example")
    return camera.scaled(factor)


def _combinations(
    axes: Mapping[str, list[tuple[Any, Any]]],
    fixed: Mapping[str, Any],
    estimators: tuple[str, ...],
    findings: list[str],
) -> Iterator[GridPoint]:
    """Points of the grid; impossible ones become findings, one for each reason."""
    impossible: dict[str, list[str]] = {}
    checked: dict[str, InputError | None] = {}
    for pairs in itertools.product(*axes.values()):
        written = {key: text for key, (text, _) in zip(axes, pairs, strict=True)}
        values = {**fixed, **{key: fit for key, (_, fit) in zip(axes, pairs, strict=True)}}
        layout, noise = values.pop("layout", LAYOUTS[0]), values.pop("noise", NOISE_PX)
        try:
            spec = spec_from_mapping(values, _TEXT)
            yield GridPoint(written, spec, layout, float(noise), _estimators(spec, layout, estimators, checked))
        except InputError as error:
            expected, value, _ = error.args
            problem = value if expected == _INVALID else f"expected {expected}, found {value}"
            where = " ".join(f"{key}={axis_text(value)}" for key, value in written.items()) or "the spec"
            impossible.setdefault(problem, []).append(where)
    for problem, places in impossible.items():
        more = f" and {len(places) - 1} more combinations" if len(places) > 2 else ""
        findings.append(f"{places[0]}{more or ''.join(f' and {place}' for place in places[1:])}: {problem}")


def _estimators(
    spec: Spec, layout: str, estimators: Sequence[str], checked: dict[str, InputError | None]
) -> tuple[str, ...]:
    """Names of the estimators to try at a point of the grid: the given ones, or all that support it.

    What is `checked` is kept, since most points of a grid share their room and poses.

    Raises
    ------
    InputError
        If no pose sees the marker, the dots do not fit, names are unknown, or options are incompatible.
    """
    if spec.n == AUTO and not spec.target:
        raise InputError("numbers of dots, all of one size", "n='auto', of which a pad is made", "list numbers")
    names = [spec.objective, spec.aggregate, spec.coordinates, spec.noise_model, spec.relief]
    _once(checked, canonical_text(["names", *names]), lambda: check_criteria(spec))
    if layout != "designed":
        for name in ("relief", "asymmetric"):
            if getattr(spec, name):
                raise InputError(f"layout='designed' for {name}", f"layout={layout!r}", f"leave out {name}")
    planar = [name for name in estimators if spec.relief and ESTIMATORS[name].planar_only]
    if planar:
        raise InputError("estimators that support relief", ", ".join(planar), "leave them out")
    others = ("objective", "aggregate", "coordinates", "seed", "restarts", "survive", "asymmetric")
    room = canonical_text({key: value for key, value in spec.as_dict().items() if key not in others})
    _once(checked, room, lambda: _check_room(spec))
    every = estimators or ESTIMATORS.names()
    return tuple(dict.fromkeys(name for name in every if not (spec.relief and ESTIMATORS[name].planar_only)))


def _once(checked: dict[str, InputError | None], key: str, check: Callable[[], None]) -> None:
    if key not in checked:
        try:
            check()
            checked[key] = None
        except InputError as error:
            checked[key] = error
    if (refused := checked[key]) is not None:
        raise refused


def _check_room(spec: Spec) -> None:
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    # Finding the best dot size takes an optimization: its cell reports if there is none.
    if spec.dot != "auto":
        choose_dots(spec, poses)


def axis_text(value: Any) -> str:
    """Value of an axis for tables and plots: text as written, JSON for anything other than a single value."""
    return value if isinstance(value, str) else canonical_text(_plain(value))


def _plain(value: Any) -> Any:
    """TOML value as a JSON value; dates, which no key accepts, as text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float | bool) else str(value)
