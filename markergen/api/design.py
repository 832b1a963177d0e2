"""``markergen.design`` and ``markergen.rig``: from options to a marker or rig and its files."""
# tests: tests/api/test_design.py tests/api/test_radius_fit.py tests/studio/test_look.py

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Unpack

from markergen.api.arguments import files_among
from markergen.api.export import choices_of
from markergen.defaults import PRINT_SIGMA
from markergen.drawing.paper import SheetOptions, paper_of_locale
from markergen.drawing.sheet_layout import USUAL, fits, largest_disk, page_room
from markergen.errors import InputError, with_place
from markergen.exporters import RECORD, ExportOptions
from markergen.exporters.saving import check_exports, family_paths, save, save_family, with_record
from markergen.files import Written, write_all
from markergen.files import check_outputs as check_files
from markergen.model.camera import Camera
from markergen.model.goal import parse_goal
from markergen.model.marker import Marker, light_marker
from markergen.model.rig_shapes import RigShape, rig_shape
from markergen.model.sight import coverage
from markergen.model.spec import AUTO, Spec
from markergen.model.tag import parse_ids, parse_tag
from markergen.objectives import OBJECTIVES
from markergen.objectives.autograd import objective_name
from markergen.optimize.constellations import design_pad
from markergen.optimize.design import Design
from markergen.optimize.design import design as find
from markergen.optimize.dot_size import choose_dots, clearance_of, largest_that_leaves_room, needs_scales
from markergen.optimize.ending import current_limit, limited
from markergen.optimize.problem import check_criteria
from markergen.optimize.rig import design_rig
from markergen.optimize.to_marker import members
from markergen.optimize.trace import MOVIES, Movie, check_trace_path, trace_bytes
from markergen.options import Progress, Watch, check_progress, given, read_as, takes
from markergen.options.declarations import OUTSIDE_SPEC, DesignKeywords
from markergen.options.kinds import File
from markergen.options.rig import RigKeywords
from markergen.pool import OneBlasThread
from markergen.presentation.plots import check_figure, figure_bytes, new_figure
from markergen.read.outlines.boundary import PAGE
from markergen.read.poses import poses_from
from markergen.read.poses.conventions import READING
from markergen.read.rig_plates import SUFFIXES, read_plates
from markergen.read.spec_file import OPTIONS, spec_from_mapping, spec_of
from markergen.read.templates import read_template

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)

Make = Callable[..., Spec]
"""Spec of a marker by the radius of its room, or the width and height, in mm."""

ROOMS = ("radius", "boundary", "boundary_unit", "layer", "ignore_open", "template", "points", "target")
"""Options that say how large a marker is, or belong to others that do."""

MEASURES = ("edge", "height", "pitch", "plate", "angle", "thickness")
SHARED = (
    "n",
    "camera",
    "image_size",
    "poses",
    *READING,
    "print_sigma",
    "dot",
    "clearance",
    "objective",
    "aggregate",
    "seed",
    "restarts",
)
"""Options of a rig that are also those of a design, with the same meaning."""


@takes(DesignKeywords)
@OneBlasThread()
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
    return _fulfilled(request_of(options), json, progress, watch)


@takes(RigKeywords)
@OneBlasThread()
def rig(
    shape: str | Path = "",
    *,
    progress: Progress | None = None,
    json: File | None = None,
    **options: Unpack[RigKeywords],
) -> Design:
    """Design a body with a marker on every face, for the pose from all dots in view.

    Each plate's layout minimizes the error of the joint pose T_camera_rig, given the dots of the others in view. Where
    the plates have no tags, their layouts differ so that no pose of the camera confuses them.

    Parameters
    ----------
    shape : str or path
        ``cube``, ``prism:6``, ``wall 3x2`` or ``pair``, or a list of plates, ``plates.toml``, ``.json`` or ``.csv``;
        see docs/rigs.md. Empty takes that of the template.
    progress : callable, optional
        Called with a stage, the amount done, and the total.
    json : path, optional
        File for what the command shows: plates, expected errors, warnings and files.
    **options
        As on the command line, ``markergen rig --help``, with underscores: ``edge="80mm"``.

    Returns
    -------
    Design
        ``design.rig`` is the rig; printing the design shows what the command shows. Warnings are also logged.

    Raises
    ------
    InputError
        If the shape or an option is unknown or invalid, the dots do not fit, no pose sees one of the plates, or a file
        cannot be used.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> poses = "cone:distance=0.3..0.8m,tilt=0..60,count=30"
    >>> design = mg.rig("pair", plate="100mm", n=4, tag="aruco:DICT_4X4_50", poses=poses, restarts=1)
    >>> [(plate.name, str(plate.marker.tag)) for plate in design.rig.plates]
    [('left', 'aruco:DICT_4X4_50:0'), ('right', 'aruco:DICT_4X4_50:1')]
    """
    check_progress(progress)
    return _fulfilled(rig_request_of(shape, options), json, progress)


def _fulfilled(request: "Request", json: File | None, progress: Progress | None, watch: Watch | None = None) -> Design:
    """Design what is requested, and write it; files are checked before the search and written after it."""
    paths, is_rig = request.paths, request.shape is not None
    targets = family_paths(paths, request.ids) if request.ids else paths
    frame, count = "rig" if is_rig else "marker", max(len(request.ids), 1)
    check_exports(paths, request.choices, None if is_rig else request.spec, frame, count)
    for path in request.traces:
        check_trace_path(path)
    for path in request.coverages:
        check_figure(path)
    results = list(read_as("files", json, "json") or ())
    check_files([*targets, *request.traces, *request.coverages, *results], request.inputs)
    replaced = {path: marker for path in paths if (marker := _present(path))}
    if request.shape:
        log.info("designing a rig of %d plates", len(request.shape.faces))
    else:
        log.info("designing %s control points in a %s", request.spec.n or "the best number of", request.spec.boundary)
    limit = current_limit()
    limit.at = min(limit.at, monotonic() + request.seconds)
    with limited(limit):
        result = request.find(progress, watch)
        if (
            paths or results or request.spec.points
        ):  # Dots that were placed have the same record with and without files.
            result = result.certified(progress)
    for warning in result.warnings:
        log.warning("%s", warning)
    if request.ids:
        result = replace(result, family=members(result.marker, spec_of(result.marker) or result.spec, request.ids))
    if progress and (paths or request.traces or request.coverages or results):
        progress("writing", 0, 1)
    written: list[Written] = []
    if paths:
        # All files are checked again, and none is written unless all can be made.
        files = (
            save_family(result.family, paths, request.choices, request.inputs)
            if request.ids
            else save(result.body, paths, request.choices, request.inputs)
        )
        written = [
            file._replace(notes=(f"It replaces another marker: {replaced[file.path]!r}.", *file.notes))
            if file.path in replaced and (is_rig or replaced[file.path].spec_hash != result.marker.spec_hash)
            else file
            for file in files
        ]
    lead, *more = parse_goal(request.spec.objective).terms
    unit = ", ".join(filter(None, (request.spec.objective, "" if more else OBJECTIVES[lead[1]].unit)))
    movie = Movie(result.trace, result.setting, result.dots.diameter, unit)
    steps = {
        path: (movie.svg() if suffix == ".svg" else movie.mp4())
        if suffix in MOVIES
        else trace_bytes(result.trace, suffix, unit)
        for path in request.traces
        for suffix in [path.suffix.lower()]
    }
    steps |= {path: figure_bytes(lambda: _coverage(result), path) for path in request.coverages}
    result = replace(result, written=(*written, *map(Written, steps)))
    write_all(steps | {path: result.to_json() for path in results})
    return replace(result, written=(*result.written, *map(Written, results)))


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
    """A request, checked before any search.

    Attributes
    ----------
    spec : Spec
        Of the smallest radius to try if it is to fit; of all plates of a rig.
    find : callable
        Makes the design, from `progress` and `watch`.
    choices : ExportOptions
    paths, traces, coverages : sequence of Path
        Files to write.
    inputs : list of Path
        Files that are read, which no output may replace.
    ids : tuple of int
        Those of a family.
    seconds : float
        Longest time to search.
    shape : RigShape or None
        Plates of a rig; None for a marker.
    """

    spec: Spec
    find: Callable[[Progress | None, Watch | None], Design]
    choices: ExportOptions
    paths: list[Path]
    inputs: list[Path]
    traces: tuple[Path, ...] = ()
    coverages: tuple[Path, ...] = ()
    ids: tuple[int, ...] = ()
    seconds: float = inf
    shape: RigShape | None = None


def request_of(options: Mapping[str, Any]) -> Request:
    """Check the options of a design, and read the files that they name; raises InputError as `design`."""
    asked = given(options, DesignKeywords)
    if "paper" in asked and asked.keys().isdisjoint(ROOMS):
        asked["boundary"] = PAGE
    if "radius" in asked and "boundary" in asked:
        raise InputError("a radius or a boundary", "--radius and --boundary", "leave one of them out")
    if asked.get("restarts") == 0:  # In a spec, 0 stands for the objective's default.
        raise InputError("restarts of 1 or more", "--restarts 0", "give a positive number, or leave it out")
    template, seconds, output, traces, coverages = (asked.pop(name, None) for name in OUTSIDE_SPEC)
    if "objective" in asked:
        asked["objective"] = objective_name(asked["objective"])
    values = read_template(str(template)) if template else {}
    source, place = _source(template, asked)
    if "shape" in values:
        raise InputError("a template of one plate", f"{template}, of a rig", f"use markergen rig --template {template}")
    # Each of them defines the available room, so the one that is given replaces the template's.
    for option, alternative in (("radius", "boundary"), ("boundary", "radius")):
        if option in asked:
            values.pop(alternative, None)
    values |= {name: list(value) if isinstance(value, tuple) else value for name, value in asked.items()}
    fit, page = values.get("radius") == "fit", str(values.get("boundary")) == PAGE
    if fit and values.get("target"):
        raise InputError("a length for the radius", "--radius fit with --target", "give --radius 90mm, for example")
    if fit or page:
        values = {"paper": USUAL.name, **values}
        if hasattr(values.get("camera"), "read"):  # An open file can be read only once.
            values["camera"] = Camera.load(values["camera"])
    # An export has a gap, too, around inlays.
    names = [name for name in DesignKeywords.__annotations__ if name in values and name != "gap"]
    sheet = given({name: values[name] for name in names}, DesignKeywords, str(template))
    with with_place(place):
        choices = choices_of(sheet)
    if page:
        values = {name: value for name, value in values.items() if name != "boundary"}

    @cache
    def make(*room: int) -> Spec:
        named = {"radius": f"{room[0]}mm"} if fit else {"boundary": "rect:{}mmx{}mm".format(*room)} if page else {}
        with with_place(place):
            return spec_from_mapping(values | named, source)

    limits = radius_limits(make, choices.sheet) if fit else None
    spec = make(limits[0]) if limits else make(*_held_by_page(make, choices.sheet)) if page else make()
    if fit and spec.relief:
        raise InputError("a length for the radius of a marker with relief", "--radius fit", "sheets hold flat ones")
    with with_place(place):
        check_criteria(spec)
    ids = values.get("ids")
    if ids is not None and not spec.tag:
        raise InputError("a tag for the ids", "--ids without --tag", "add --tag aruco:DICT_4X4_50, say")

    def find(progress: Progress | None, watch: Watch | None) -> Design:
        def designed(spec: Spec) -> Design:
            return _find(spec, progress, bool(traces), watch)

        result = largest_that_fits(make, limits, choices.sheet, designed) if limits else designed(spec)
        return replace(result, body=light_marker(result.marker)) if choices.sheet.colors.inverted else result

    return Request(
        spec,
        find,
        choices,
        with_record(output) if output else [],
        files_among(template, *_named_in(values)),
        traces or (),
        coverages or (),
        parse_ids(ids, spec.tag.rpartition(":")[0]) if ids is not None else (),
        seconds or inf,
    )


def rig_request_of(shape: str | Path, options: Mapping[str, Any]) -> Request:
    """Check the options of a rig, and read the files that they name; raises InputError as `rig`."""
    shape = str(shape) if isinstance(shape, Path) else shape
    if not isinstance(shape, str):
        raise InputError("a shape as text", type(shape).__name__, 'give such as "cube" or "wall 3x2"')
    asked = given(options, RigKeywords)
    if "objective" in asked:
        asked["objective"] = objective_name(asked["objective"])
    template = asked.pop("template", None)
    source, place = _source(template, asked)
    if template:
        values = read_template(str(template))
        if "shape" not in values:
            remedy = f"use markergen design --template {template}, or name the shape as well"
            raise InputError("a template of a rig", f"{template}, of one plate", remedy)
        shape = shape or str(values["shape"])
        template_values = {key: value for key, value in values.items() if key not in ("shape", "title")}
        asked = given(template_values, RigKeywords, str(template)) | asked
    if not shape:
        remedy = "write cube, or --template with a name of markergen templates"
        raise InputError("a shape or a template", "neither", remedy)
    measures: dict[str, Any] = {name: asked[name] for name in (*MEASURES, "without") if name in asked}
    markers: dict[int, Marker] = {}
    if shape.lower().endswith(SUFFIXES):
        if measures:
            raise InputError("the measures of plates in their list", f"--{next(iter(measures))}", "leave it out")
        geometry, markers = read_plates(Path(shape))
    else:
        geometry = rig_shape(shape, **measures)
    values = {"poses": geometry.poses, "noise_model": "image", "print_sigma": PRINT_SIGMA, "n": 6}
    values |= {name: asked[name] for name in SHARED if name in asked}
    with with_place(place):
        spec = replace(spec_from_mapping(values, source), substrate=geometry.substrate)
        check_criteria(spec)
        tags = _tags(asked, len(geometry.faces))
    spec = replace(spec, tag=tags[0], tag_side=asked["tag_size"]) if tags and "tag_size" in asked else spec
    listed = shape if markers or geometry.text == "plates" else None
    return Request(
        spec,
        lambda progress, _: design_rig(geometry, spec, tags, markers, progress),
        choices_of(asked),
        with_record(asked["output"], "rig") if asked.get("output") else [],
        files_among(template, listed, *(asked.get(key) for key in ("camera", "poses", "camera_in_body"))),
        seconds=asked.get("time", inf),
        shape=geometry,
    )


def _source(template: File | None, asked: Mapping[str, Any]) -> tuple[str, str]:
    """Return where the values of a request are from, and with a template where in messages; the latter else empty."""
    if not template:
        return OPTIONS, ""
    source = f"{template} or the options" if asked.keys() - OUTSIDE_SPEC else str(template)
    return source, f"in {source}"


def _tags(asked: dict[str, Any], count: int) -> list[str]:
    """Tags of the plates, with consecutive ids."""
    if "tag" not in asked:
        if "tag_size" in asked:
            raise InputError("a tag with a tag size", "--tag-size alone", "add --tag, or leave it out")
        return []
    first = parse_tag(asked["tag"], 1.0)
    return [str(replace(first, id=first.id + k)) for k in range(count)]


def with_page(options: Mapping[str, Any], environment: Mapping[str, str]) -> dict[str, Any]:
    """Return options with the paper in the printer, A4 or letter by the locale, if they name neither room nor paper."""
    if any(options.get(name) is not None for name in ROOMS):
        return dict(options)
    return {**options, "paper": options.get("paper") or paper_of_locale(environment)}


def _held_by_page(make: Make, sheet: SheetOptions) -> tuple[int, int]:
    """Width and height in mm of a room that fits whatever the layout, as the first of `radius_limits`."""
    room = page_room(sheet)
    while room > (held := page_room(sheet, _beyond(make(*room)))):
        room = held
    return room


def radius_limits(make: Make, sheet: SheetOptions) -> tuple[int, int]:
    """Radii in mm: one that fits whatever the layout, and the largest whose outline alone fits.

    They differ only if quiet zones, which may extend into the margin, reach beyond it.

    Raises
    ------
    InputError
        If no page holds a marker with these dots, or as `choose_dots` does.
    """
    most = radius = largest_disk(sheet)
    while radius and radius > (held := largest_disk(sheet, _beyond(make(radius)))):
        radius = held
    if not radius:
        raise InputError(
            "a paper that holds the marker with its quiet zones and rulers", str(sheet.paper), "use larger paper"
        )
    return radius, most


def largest_that_fits(
    make: Make, limits: tuple[int, int], sheet: SheetOptions, find: Callable[[Spec], Design]
) -> Design:
    """Design of the largest radius within the limits that one page holds, by bisection from the top.

    Raises
    ------
    InputError
        If holes beyond the disk do not fit on the page.
    """
    low, high = limits
    best: Design | None = None
    radius = high
    while low < high:
        result = find(make(radius))
        if fits(result.marker, sheet):
            low, best = radius, result
        else:
            high = radius - 1
        radius = (low + high + 1) // 2
    result = best or find(make(low))
    if result.marker.dot_diameter and not fits(result.marker, sheet):
        raise InputError(
            f"a marker that a page of {sheet.paper} holds",
            "holes beyond its disk",
            "use larger paper, or move the holes",
        )
    return result


def _beyond(spec: Spec) -> float:
    """Maximum distance in mm of a quiet zone from the disk, which dots touch but for their clearance.

    The fewest of `--n auto` would have the largest dots.
    """
    spec = replace(spec, n=4, target="") if spec.n == AUTO else spec
    if spec.dot == "auto":
        diameter = largest_that_leaves_room(spec)
        clearance = clearance_of(spec, diameter)
    else:
        size = choose_dots(spec, poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief))
        diameter, clearance = size.diameter, size.clearance
    return max(0.0, 1e3 * (diameter / 2 - clearance))


def _named_in(values: Mapping[str, Any]) -> list[Any]:
    """Return all values that may name an input file, from options or from the template."""
    plate = values.get("substrate")
    keys = ("camera", "camera_covariance", "poses", "camera_in_body", "boundary", "outline")
    named = [values.get(key) for key in keys]
    named += [plate.get("outline")] if isinstance(plate, Mapping) else []
    for key in ("keep_out", "keep_outs"):
        several = values.get(key)
        named += several if isinstance(several, list) else [several]
    return named
