"""``markergen.rig``: from a shape to a rig and its files."""
# tests: tests/studio/test_look.py

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from markergen.api.arguments import files_among
from markergen.api.export import choices_of
from markergen.defaults import PRINT_SIGMA
from markergen.errors import InputError
from markergen.exporters.saving import check_exports, save, with_record
from markergen.files import Written, write_all
from markergen.files import check_outputs as check_files
from markergen.model.marker import Marker
from markergen.model.rig_shapes import RigShape, rig_shape
from markergen.model.spec import Spec
from markergen.model.tag import parse_tag
from markergen.optimize.design import Design
from markergen.optimize.rig import design_rig
from markergen.options import Progress, check_progress, given, read_as, signature_of
from markergen.options.kinds import File
from markergen.options.rig import RigKeywords
from markergen.read.rig_plates import SUFFIXES, read_plates
from markergen.read.spec_file import spec_from_mapping
from markergen.read.templates import read_template

log = logging.getLogger(__name__)

MEASURES = ("edge", "height", "pitch", "plate", "angle")
SHARED = ("n", "camera", "poses", "print_sigma", "dot", "clearance", "objective", "aggregate", "seed", "restarts")
"""Options of a rig that are also those of a design, with the same meaning."""


def rig(
    shape: str = "",
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
    shape : str
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
        ``found.rig`` is the rig; printing the design shows what the command shows. Warnings are also logged.

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
    >>> found = mg.rig("pair", plate="100mm", n=4, tag="aruco:DICT_4X4_50", poses=poses, restarts=1)
    >>> [(each.name, str(each.marker.tag)) for each in found.rig.markers]
    [('left', 'aruco:DICT_4X4_50:0'), ('right', 'aruco:DICT_4X4_50:1')]
    """
    check_progress(progress)
    request = request_of(shape, options)
    asked, geometry, spec = request.asked, request.made, request.spec
    choices = choices_of(asked)
    paths = with_record(asked["output"], "rig") if asked.get("output") else []
    check_exports(paths, choices, frame="rig")
    results = list(read_as("files", json, "json") or ())
    check_files([*paths, *results], request.inputs)
    log.info("designing a rig of %d plates", len(geometry.faces))
    result = design_rig(geometry, spec, request.tags, request.known, progress)
    for warning in result.warnings:
        log.warning("%s", warning)
    result = replace(result, written=tuple(save(result.rig, paths, choices, request.inputs))) if paths else result
    write_all({path: result.to_json() for path in results})
    return replace(result, written=(*result.written, *map(Written, results)))


rig.__signature__ = signature_of(rig, RigKeywords)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Request:
    """A request, checked before any search: options, shape, markers that are known, spec, tags, and input files."""

    asked: dict[str, Any]
    made: RigShape
    known: dict[int, Marker]
    spec: Spec
    tags: list[str]
    inputs: list[Path]


def request_of(shape: str, options: Mapping[str, Any]) -> Request:
    """Check the options of a rig, and read the files that they name; raises InputError as `rig`."""
    if not isinstance(shape, str):
        raise InputError("a shape as text", type(shape).__name__, 'give such as "cube" or "wall 3x2"')
    asked = given(options, RigKeywords)
    template = asked.pop("template", None)
    if template:
        values = read_template(str(template))
        if "shape" not in values:
            remedy = f"use markergen design --template {template}, or name the shape as well"
            raise InputError("a template of a rig", f"{template}, of one plate", remedy)
        shape = shape or str(values["shape"])
        template_values = {key: value for key, value in values.items() if key not in ("shape", "title")}
        asked = given(template_values, RigKeywords) | asked
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
    spec = spec_from_mapping(values, "the options")
    tags = _tags(asked, len(geometry.faces))
    spec = replace(spec, tag=tags[0], tag_side=asked["tag_size"]) if tags and "tag_size" in asked else spec
    listed = shape if markers or geometry.text == "plates" else None
    return Request(
        asked, geometry, markers, spec, tags, files_among(template, listed, asked.get("camera"), asked.get("poses"))
    )


def _tags(asked: dict[str, Any], count: int) -> list[str]:
    """Tags of the plates, with consecutive ids."""
    if "tag" not in asked:
        if "tag_size" in asked:
            raise InputError("a tag with a tag size", "--tag-size alone", "add --tag, or leave it out")
        return []
    first = parse_tag(asked["tag"], 1.0)
    return [str(replace(first, id=first.id + k)) for k in range(count)]
