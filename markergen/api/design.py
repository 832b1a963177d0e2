"""``markergen.design``: from options to a marker and its files."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from markergen.api.arguments import files_among
from markergen.api.export import choices_of
from markergen.api.radius_fit import largest_that_fits, radius_limits
from markergen.drawing.sheet_layout import USUAL
from markergen.errors import InputError
from markergen.exporters import RECORD, ExportOptions
from markergen.exporters.saving import check_exports, family_paths, save, save_family, with_record
from markergen.files import Written, write_all
from markergen.files import check_outputs as check_files
from markergen.model.camera import Camera
from markergen.model.goal import parse_goal
from markergen.model.marker import Marker, light_marker
from markergen.model.sight import coverage
from markergen.model.spec import AUTO, Spec
from markergen.model.tag import parse_ids
from markergen.objectives import OBJECTIVES
from markergen.optimize.constellations import design_pad
from markergen.optimize.design import Design
from markergen.optimize.design import design as find
from markergen.optimize.dot_size import needs_scales
from markergen.optimize.to_marker import members
from markergen.optimize.trace import check_trace_path, trace_bytes
from markergen.options import Progress, Watch, check_progress, given, read_as, signature_of
from markergen.options.declarations import OUTSIDE_FILES, DesignKeywords
from markergen.options.kinds import File
from markergen.presentation.plots import check_figure, figure_bytes, new_figure
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping, spec_of
from markergen.read.templates import read_template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)


def design(
    *,
    progress: Progress | None = None,
    watch: Watch | None = None,
    json: File | None = None,
    **options: Unpack[DesignKeywords],
) -> Design:
    """Find the layout of control points that gives the most accurate pose, and write it to files if asked to.

    Parameters
    ----------
    progress : callable, optional
        Called with a stage, the amount done, and the total.
    watch : callable, optional
        Called a few times a second with a stage, the best layout so far, an array (n, 2 or 3) in m, and its value,
        while dots of one size are placed. What it or `progress` raises ends the search.
    json : path, optional
        File for what the command shows: value, lower bound, criteria, warnings and files.
    **options
        As on the command line, ``markergen design --help``, with underscores. Lengths are in m, or text with a unit;
        ``boundary``, ``keep_out`` and ``outline`` may be boundaries, ``camera`` a `Camera`, ``poses`` a distribution;
        ``output``, ``trace`` and ``coverage`` are one path or several, checked before the search and written after it.

    Returns
    -------
    Design
        ``design.marker`` is the marker; printing the design shows what the command shows. Warnings are also logged.

    Raises
    ------
    InputError
        If an option is unknown or invalid, the dots do not fit, no pose sees the marker, or a file cannot be used.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> found = mg.design(n=4, radius="100mm", dot="20mm", restarts=4)
    >>> len(found.marker), found.warnings
    (4, ())
    """
    check_progress(progress)
    check_progress(watch, "a stage, a layout, and its value")
    request = request_of(options)
    paths = request.paths
    targets = family_paths(paths, request.ids) if request.ids else paths
    check_exports(paths, request.choices, request.spec)
    for path in request.traces:
        check_trace_path(path)
    for path in request.coverages:
        check_figure(path)
    results = list(read_as("files", json, "json") or ())
    check_files([*targets, *request.traces, *request.coverages, *results], request.inputs)
    others = {path: marker for path in paths if (marker := _present(path))}
    log.info("designing %s control points in a %s", request.spec.n or "the best number of", request.spec.boundary)
    spec, result = request.find(lambda spec: _find(spec, progress, bool(request.traces), watch))
    if request.choices.sheet.colors.inverted:
        result = replace(result, body=light_marker(result.marker))
    for warning in result.warnings:
        log.warning("%s", warning)
    if request.ids:
        result = replace(result, family=members(result.marker, spec_of(result.marker) or spec, request.ids))
    if results:
        result.certify(progress)
    if progress and (paths or request.traces or request.coverages or results):
        progress("writing", 0, 1)
    written = []
    if paths:
        # All files are checked again, and none is written unless all can be made.
        write = save_family if request.ids else save
        written = [
            file._replace(notes=(*file.notes, f"It replaces another marker: {others[file.path]!r}."))
            if file.path in others and others[file.path].spec_hash != result.marker.spec_hash
            else file
            for file in write(result.markers, paths, request.choices, request.inputs)
        ]
    steps = {path: trace_bytes(result.trace, path.suffix, _label(spec)) for path in request.traces}
    steps |= {path: figure_bytes(lambda: _coverage(result), path) for path in request.coverages}
    result = replace(result, written=(*written, *map(Written, steps)))
    write_all(steps | {path: result.to_json() for path in results})
    return replace(result, written=(*result.written, *map(Written, results)))


design.__signature__ = signature_of(design, DesignKeywords)  # type: ignore[attr-defined]


def _present(path: Path) -> Marker | None:
    """Marker that is in a file to be written; refuses to replace one that was measured."""
    try:
        marker = Marker.load(path) if path.suffix == RECORD and path.is_file() else None
    except (InputError, OSError):  # Something else, which an output may replace.
        return None
    if marker and (marker.places_measured or marker.print_scale != (1.0, 1.0)):
        raise InputError(f"a {path.name} that may be replaced", f"a print's measurements in {path}", "name another -o")
    return marker


def _coverage(result: Design) -> "Figure":
    """What all poses of the spec see of the marker, those that were left out as well."""
    figure = new_figure((6.4, 3.6))
    coverage(result.marker, result.setting.camera, poses_from(result.spec.poses)).plot(figure.add_subplot())
    return figure


def _find(spec: Spec, progress: Progress | None, traced: bool, watch: Watch | None) -> Design:
    """Design with dots of several sizes where one size cannot serve all poses, and the number of dots is open."""
    if spec.n == AUTO and needs_scales(spec, poses_from(spec.poses)):
        if traced:
            raise InputError("dots of one size to trace", "--trace with poses from near to far", "leave it out")
        try:
            return design_pad(spec, progress)
        except InputError as error:
            log.info("dots of one size, for want of room for several: %s", error)
    return find(spec, progress, traced, watch)


@dataclass(frozen=True)
class Request:
    """A request, checked before any search: specs by radius in mm if it is to fit, the ids of a family, and files."""

    make: Callable[[int], Spec]
    limits: tuple[int, int] | None
    ids: tuple[int, ...]
    choices: ExportOptions
    paths: list[Path]
    traces: tuple[Path, ...]
    coverages: tuple[Path, ...]
    inputs: list[Path]

    @property
    def spec(self) -> Spec:
        """The spec; of the smallest radius to try if it is to fit."""
        return self.make(self.limits[0] if self.limits else 0)

    def find(self, find: Callable[[Spec], Design]) -> tuple[Spec, Design]:
        """Spec and its design by a function."""
        if self.limits:
            return largest_that_fits(self.make, self.limits, self.choices.sheet, find)
        return self.spec, find(self.spec)


def request_of(options: Mapping[str, Any]) -> Request:
    """Check the options of a design, and read the files that they name; raises InputError as `design`."""
    asked = given(options, DesignKeywords)
    if "radius" in asked and "boundary" in asked:
        raise InputError("a radius or a boundary", "--radius and --boundary", "leave one of them out")
    if asked.get("restarts") == 0:  # In a spec, 0 stands for the objective's default.
        raise InputError("restarts of 1 or more", "--restarts 0", "give a positive number, or leave it out")
    template, output, traces, coverages = (asked.pop(name, None) for name in OUTSIDE_FILES)
    values = read_template(str(template)) if template else {}
    if "shape" in values:
        raise InputError("a template of one plate", f"{template}, of a rig", f"use markergen rig --template {template}")
    # Each of them defines the available room, so the one that is given replaces the template's.
    for option, alternative in (("radius", "boundary"), ("boundary", "radius")):
        if option in asked:
            values.pop(alternative, None)
    values |= {name: list(value) if isinstance(value, tuple) else value for name, value in asked.items()}
    fit = values.get("radius") == "fit"
    if fit and values.get("target"):
        raise InputError("a length for the radius", "--radius fit with --target", "give --radius 90mm, for example")
    if fit:
        values = {"paper": USUAL.name, **values}
        if hasattr(values.get("camera"), "read"):  # An open file can be read only once.
            values["camera"] = Camera.load(values["camera"])
    sheet = given({name: values[name] for name in DesignKeywords.__annotations__ if name in values}, DesignKeywords)
    choices = choices_of(sheet)

    @cache
    def make(radius: int) -> Spec:
        mapping = {**values, "radius": f"{radius}mm"} if fit else values
        return spec_from_mapping(mapping, str(template or "the options"))

    limits = radius_limits(make, choices.sheet) if fit else None
    spec = make(limits[0] if limits else 0)
    if fit and spec.relief:
        raise InputError("a length for the radius of a marker with relief", "--radius fit", "sheets hold flat ones")
    ids = values.get("ids")
    if ids is not None and not spec.tag:
        raise InputError("a tag for the ids", "--ids without --tag", "add --tag aruco:DICT_4X4_50, say")
    return Request(
        make,
        limits,
        parse_ids(ids, spec.tag.rpartition(":")[0]) if ids is not None else (),
        choices,
        with_record(output) if output else [],
        traces or (),
        coverages or (),
        files_among(template, *_named_in(values)),
    )


def _named_in(values: Mapping[str, Any]) -> list[Any]:
    """Return all values that may name an input file, from options or from the template."""
    plate = values.get("substrate")
    named = [values.get(key) for key in ("camera", "camera_covariance", "poses", "boundary", "outline")]
    named += [plate.get("outline")] if isinstance(plate, Mapping) else []
    for key in ("keep_out", "keep_outs"):
        several = values.get(key)
        named += several if isinstance(several, list) else [several]
    return named


def _label(spec: Spec) -> str:
    goal = parse_goal(spec.objective)
    unit = OBJECTIVES[goal.lead].unit if len(goal.terms) == 1 else ""
    return f"{spec.objective}, {unit}" if unit else spec.objective
