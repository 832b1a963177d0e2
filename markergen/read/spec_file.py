"""Design specs: TOML files, templates, and the spec stored in a marker.json."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from functools import partial
from os import PathLike
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    model_validator,
)

from markergen.defaults import PRINT_SIGMA_TEXT
from markergen.errors import InputError, brief
from markergen.model.boundary import Boundary, Circle
from markergen.model.camera import LARGEST_SIDE, Camera, Distortion
from markergen.model.json_text import findings_of, in_one_line, refusal_in
from markergen.model.marker import Marker
from markergen.model.recorded_poses import MOST_KEPT, RecordedPoses
from markergen.model.shape_file import BoundaryFile, SubstrateFile, built
from markergen.model.spec import AUTO, ImageNoise, Spec
from markergen.model.substrate import Hole, parse_dowel, parse_mount
from markergen.options import declared
from markergen.options.declarations import OUTSIDE_SPEC, DesignKeywords
from markergen.options.shared import PlateKeywords
from markergen.read.cameras import load_camera, sized
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.dot_tables import is_table, parsed_layout, read_layout
from markergen.read.outlines.boundary import drawn_plate, is_drawing, parse_boundary, read_room
from markergen.read.poses import poses_as_stated, poses_from, settled_poses
from markergen.read.poses.conventions import READING
from markergen.read.poses.rows import numbers_of_rows
from markergen.units import SMALLEST_LENGTH, format_length, parse_length, parse_settings


@contextmanager
def _as_findings(prefix: str = "") -> Iterator[None]:
    """Raise InputErrors as ValueErrors, which pydantic collects with their paths; an InputError would stop it."""
    try:
        yield
    except InputError as error:
        raise ValueError(f"{prefix}{error}") from None


def _length(value: object) -> float:
    try:
        return parse_length(value if isinstance(value, (str, int, float)) else str(value))
    except InputError as error:
        raise ValueError(error.args[2]) from None


def _sized(value: Any, info: ValidationInfo) -> Any:
    """Refuse sizes below 1 um; standard deviations may be as small as they like."""
    if isinstance(value, float) and 0 < abs(value) < SMALLEST_LENGTH and "sigma" not in str(info.field_name):
        raise ValueError("give a length of 1 um to 1 km")
    return value


def _length_or_auto(value: object) -> float | str:
    if value == "auto":
        return "auto"
    try:
        return _length(value)
    except ValueError as error:
        raise ValueError(f"{error}, or auto") from None


def _radius(value: object) -> float:
    if value == "fit":
        raise ValueError("fit is for markergen design, which has a paper: give a length")
    return _length(value)


def _shape(value: object, origin: str = "file") -> object:
    """Boundary table with its lengths in m; unfit values are left for the table's own validation."""
    if isinstance(value, str):
        if not re.match(r"\s*(circle|rect):", value):
            raise ValueError("write rect:0.2x0.1, circle:0.15, or a table with kind and outlines")
        with _as_findings():
            return parse_boundary(value, origin=origin).as_dict()
    if isinstance(value, Mapping):
        return {"kind": "circle", **_lengths(value)}
    return value


def _lengths(value: Any, levels: int = 3) -> Any:
    """Values with all texts that are lengths in m, but for those that name something."""
    if isinstance(value, Mapping):
        return {key: item if key in ("kind", "use", "name") else _lengths(item) for key, item in value.items()}
    # Levels of outlines, corners and coordinates; deeper nesting is left for the table's validation.
    if isinstance(value, list) and levels:
        return [_lengths(item, levels - 1) for item in value]
    try:
        return _length(value) if isinstance(value, str) else value
    except ValueError:
        return value


HOLES = {"mount": parse_mount, "dowel": parse_dowel}
"""Keys of holes written as on the command line."""


def _plate(value: object) -> object:
    """Substrate table with its lengths in m and its holes listed one by one; unfit values are left for validation."""
    if not isinstance(value, Mapping):
        return value
    table = _lengths({key: item for key, item in value.items() if key not in HOLES})
    if "outline" in table:
        table["outline"] = _shape(value["outline"])
    written = [asdict(hole) for key in HOLES for hole in _holes(key, value.get(key, []))]
    holes = table.get("holes", [])
    if isinstance(holes, list) and (holes or written):
        table["holes"] = holes + written
    return table


def _holes(key: str, texts: object) -> list[Hole]:
    every = texts if isinstance(texts, list) else [texts]
    with _as_findings(f"{key}: "):
        return [hole for text in every for hole in HOLES[key](text if isinstance(text, str) else brief(text))]


def _quality(value: object) -> object:
    """Image quality, from text as on the command line or a table as it is."""
    if not isinstance(value, str):
        return value
    with _as_findings():
        return parse_settings(value, ImageNoiseTable.model_fields, "an image quality")


Shape = Annotated[BoundaryFile, BeforeValidator(_shape)]
Room = Annotated[BoundaryFile, BeforeValidator(partial(_shape, origin="center"))]
Plate = Annotated[SubstrateFile, BeforeValidator(_plate)]
Length = Annotated[float, BeforeValidator(_length), AfterValidator(_sized)]
DotLength = Annotated[float | Literal["auto"], BeforeValidator(_length_or_auto), AfterValidator(_sized)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Whole = Annotated[int, Field(lt=2**63)]  # TOML's integers have 64 bits
Side = Annotated[int, Field(ge=1, le=LARGEST_SIDE)]

OPTIONS = "the options"
"""Name of a spec that is typed, whose only error needs no place."""

ABSENT: Any = None
"""Placeholder for a key that is not given; defaults are defined by `Spec` alone."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Distortion(_Table):
    model: str
    coefficients: list[Finite]

    @model_validator(mode="after")
    def _known(self) -> "_Distortion":
        with _as_findings():
            Distortion(self.model, tuple(self.coefficients))
        return self


class CameraTable(_Table):
    """A camera, in px."""

    width: Side
    height: Side
    fx: Finite
    fy: Finite
    cx: Finite
    cy: Finite
    distortion: _Distortion = ABSENT


class ImageNoiseTable(_Table):
    """The image that the noise model ``image`` describes."""

    blur_px: Finite = ABSENT
    noise_grey: Finite = ABSENT
    contrast: Finite = ABSENT


class _Poses(_Table):
    """Poses of a file, as stored in a marker.json."""

    file: Annotated[str, Field(min_length=1, max_length=255)]
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    dropped: Annotated[int, Field(ge=0, lt=2**63)]
    sampled_from: Annotated[int, Field(ge=0, lt=2**63)]
    columns: Literal["tx ty tz qx qy qz qw"]
    rows: Annotated[list[str], Field(min_length=1, max_length=MOST_KEPT)]


def stated_poses(value: object) -> str | RecordedPoses:
    """Return poses as a spec states them, from any form; raises ValueError if it is none."""
    if isinstance(value, str | RecordedPoses):
        return value
    if isinstance(value, PathLike):
        return str(value)
    if not isinstance(value, Mapping):
        poses = poses_from(value)
        return poses if isinstance(poses, RecordedPoses) else RecordedPoses.from_distribution(poses)
    try:
        table = _Poses.model_validate(dict(value))
    except ValidationError as error:
        raise ValueError(in_one_line(findings_of(error))) from None
    with _as_findings():
        numbers = numbers_of_rows(table.rows)
    file = table.file if table.file.isprintable() else brief(table.file)
    return RecordedPoses.of(numbers, file, table.sha256, table.dropped, table.sampled_from)


def _only_one(boundary: Any, info: ValidationInfo) -> Any:
    if info.data.get("radius") is not None:
        raise ValueError("give either radius or [boundary], not both")
    return boundary


STORED = {"keep_out": "keep_outs", "tag_size": "tag_side"}
"""Names in a spec of options that are called differently."""

PLATE = declared(PlateKeywords)
DRAWING = ("boundary_unit", "layer", "origin", "ignore_open")
"""Options for reading a drawing, which a spec does not keep."""

_FILED: dict[str, Any] = {
    "int": Whole,
    "int or auto": Whole,
    "float": Finite,
    "str": str,
    "objective": str,
    "file": str,
    "bool": bool,
    "length": Length,
    "length or auto": DotLength | None,
    "length or fit": Annotated[float, BeforeValidator(_radius)],
    "shape": Shape,
    "shapes": list[Shape],
    "covariance": Any,
    "camera": CameraTable,
    "poses": Annotated[Any, BeforeValidator(stated_poses)],
    "settings": Annotated[ImageNoiseTable, BeforeValidator(_quality)],
    "layout": Annotated[Any, BeforeValidator(parsed_layout)],
}
"""Type of each kind of option, once the files that it names have been read."""

_DECLARED: dict[str, Any] = {
    STORED.get(name, name): (_FILED[option.kind], ABSENT)
    for name, option in declared(DesignKeywords).items()
    if name not in (*OUTSIDE_SPEC, *PLATE)
} | {"boundary": (Annotated[Room, AfterValidator(_only_one)], ABSENT), "clearance": (Length | None, ABSENT)}
_SpecFile: Any = create_model("_SpecFile", __base__=_Table, title=(str, ABSENT), substrate=(Plate, ABSENT), **_DECLARED)
_KEPT = {field.name for field in fields(Spec)}
_BUILT = {"boundary", "camera", "keep_outs", "substrate"}
"""Keys whose tables are built into what a spec holds."""


def spec_of(marker: Marker) -> Spec | None:
    """Return the spec that a marker was designed with; None if its file has none.

    Raises InputError if the stored value is not a valid spec.
    """
    stored = marker.provenance.get("spec")
    return None if stored is None else spec_from_mapping(stored, "provenance.spec", stored=True)


def _option_refusal(error: Any) -> InputError | None:
    """What an option of the plate is to be, or what a validator says of any other; None if that is nothing."""
    limits = {"greater_than_equal": ("ge", "from"), "greater_than": ("gt", "above"), "less_than_equal": ("le", "up to")}
    if error["loc"][0] != "substrate" or error["type"] not in limits:
        return refusal_in(error)
    key, word = limits[error["type"]]
    option, limit = str(error["loc"][-1]).replace("_", "-"), format_length(float(error["ctx"][key]))
    remedy = "give a length such as 3mm, or leave it out"
    return InputError(f"a --{option} {word} {limit}", format_length(float(error["input"])), remedy)


def spec_from_mapping(values: object, name: str = "spec", stored: bool = False) -> Spec:
    """Make a spec from a mapping of plain values; lengths may be text with a unit, and `Spec` defines the defaults.

    The keys are the options of a design; those of the plate may also be in a table ``substrate``. Options that a spec
    does not keep, such as the paper, are checked and dropped. `name` is the name of the source in messages. If
    `stored`, as in a marker.json, the values name no other files, and none is read.

    Raises InputError if it is not a mapping, has unknown keys or invalid values; all of them are listed, each with its
    path.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"a table of values in {name}", brief(values), "write for example n = 5 or radius = 0.15")
    plain = _in_spec_terms(dict(values))
    if not stored and isinstance(plain.get("image_size"), str):
        plain["camera"] = sized(plain.get("camera"), plain.pop("image_size"))
    count, calibration = plain.get("n"), plain.get("camera")
    if count == "auto":
        del plain["n"]
    try:
        table = _SpecFile.model_validate(plain if stored else _with_files_read(plain))
    except ValidationError as error:
        refusal = _option_refusal(error.errors()[0]) if name == OPTIONS and error.error_count() == 1 else None
        findings = findings_of(error, lambda place: _SpecFile.model_fields if len(place) == 1 else ())
        raise refusal or InputError(f"a valid spec in {name}", in_one_line(findings), "correct these places") from None
    if not stored and table.print_sigma == 0:
        # In a spec, 0 is what is searched for if nothing is given, and the usual print is then planned with.
        remedy = f"leave it out for {PRINT_SIGMA_TEXT}, or write a length such as 0.005mm: nothing is printed exactly"
        raise InputError("a print error above 0", f"--print-sigma {plain['print_sigma']}", remedy)
    # Tables are built below. A dump of their unions of shapes has warned in a calibration from a film.
    plain_values = table.model_dump(exclude_unset=True, exclude={"poses", *_BUILT})
    options = {key: value for key, value in plain_values.items() if key in _KEPT}
    built_keys = _BUILT & table.model_fields_set
    if "camera" in built_keys:
        pinhole, lens = table.camera.model_dump(exclude={"distortion"}), table.camera.distortion
        distortion = Distortion() if lens is None else Distortion(lens.model, tuple(lens.coefficients))
        options["camera"] = Camera(**pinhole, distortion=distortion)
    if options.get("n") == AUTO:
        raise InputError(f"at least 4 control points in {name}", f"n={AUTO}", "give 4 or more, or auto")
    if count == "auto" or (count is None and "target" in options):
        options["n"] = AUTO
    if options.get("points") and count is None:
        options["n"] = len(options["points"])
    # Other designs do not depend on it.
    planned = not stored and (options.get("n") == AUTO or "target" in options)
    if planned or options.get("camera_covariance") is not None:
        measured = calibration if planned else None
        covariance = camera_covariance(options.get("camera_covariance"), measured, options.get("camera", Spec.camera))
        options["camera_covariance"] = None if covariance is None else tuple(map(tuple, covariance.tolist()))
    if "image_noise" in options:
        options["image_noise"] = ImageNoise(**options["image_noise"])
    if table.poses is not None:
        options["poses"] = settled_poses(table.poses) if isinstance(table.poses, str) and not stored else table.poses
    if "boundary" in built_keys:
        options["boundary"] = table.boundary.build()
    elif table.radius is not None:
        options["boundary"] = Circle(table.radius)
    if "keep_outs" in built_keys:
        options["keep_outs"] = built(table.keep_outs)
    if "substrate" in built_keys:
        options["substrate"] = table.substrate.build()
        # In older markers an outline from a drawing was not yet the plate's, and may have an edge.
        if stored and options["substrate"].edge and not options.get("boundary", Spec.boundary).has_measures:
            options["substrate"] = replace(options["substrate"], edge=None)
    return Spec(**options)


def _in_spec_terms(values: dict[Any, Any]) -> dict[Any, Any]:
    """Rename options to the keys of a spec, and move those of the plate into its table."""
    plate = {key: values.pop(key) for key in PLATE if key in values}
    before = values.get("substrate", {})
    if plate and isinstance(before, Mapping):
        values["substrate"] = {**before, **plate}
    return {STORED.get(key, key): value for key, value in values.items()}


def _with_files_read(values: dict[Any, Any]) -> dict[Any, Any]:
    """Replace paths of drawings and calibrations by their contents, and objects by plain values."""
    # Validation reports other types.
    if all(isinstance(values.get(key), (bool if key == "ignore_open" else str) | None) for key in DRAWING):
        values = {key: value for key, value in (values | _rooms(values)).items() if key not in DRAWING}
    if all(isinstance(values.get(key), str | PathLike | None) for key in READING):  # As above.
        poses = poses_as_stated(values.get("poses"), values)
        values = {key: poses if key == "poses" else value for key, value in values.items() if key not in READING}
    if is_table(values.get("points")):
        values["points"] = read_layout(values["points"])
    camera = values.get("camera")
    if isinstance(camera, Camera):
        values["camera"] = camera.as_dict()
    elif isinstance(camera, Mapping):
        # A spec's own table is validated with better messages than the contents of a calibration file.
        if "fx" not in camera and not camera.keys() <= CameraTable.model_fields.keys():
            values["camera"] = load_camera(camera).as_dict()
    elif isinstance(camera, str | PathLike) or hasattr(camera, "read"):
        values["camera"] = load_camera(camera).as_dict()
    return values


def _rooms(values: Mapping[Any, Any]) -> dict[str, Any]:
    """Boundary, keep-outs and plate outline as tables, where they are given as drawings or objects."""
    plate = values.get("substrate", {})
    outline = plate.get("outline") if isinstance(plate, Mapping) else None
    keep_outs = values.get("keep_outs", [])
    keep_outs = keep_outs if isinstance(keep_outs, list | tuple) else [keep_outs]
    boundary, unit, layer, origin, ignore_open = (values.get(key) for key in ("boundary", *DRAWING))
    if boundary is None and (layer is not None or origin is not None):
        raise InputError("--layer and --origin with a drawing", "no --boundary", "give --boundary, or leave them out")
    room = _drawn(boundary)
    if room is None and isinstance(boundary, str) and layer is not None:
        parse_boundary(boundary, layer=layer)  # Raises: a shape has no layers.
    drawn = [text for shape in (outline, *keep_outs) if (text := _drawn(shape)) is not None]
    area, shapes = read_room(room, drawn, unit, layer, origin or "center", bool(ignore_open))
    drawings = iter(shapes)
    outline, *keep_outs = (shape if _drawn(shape) is None else next(drawings) for shape in (outline, *keep_outs))
    rooms: dict[str, Any] = {}
    if boundary is not None:
        rooms["boundary"] = _table_of(area or boundary)
    if keep_outs:
        rooms["keep_outs"] = [_table_of(shape) for shape in keep_outs]
    if isinstance(plate, Mapping):
        table = plate if outline is None else {**plate, "outline": _table_of(outline)}
        rooms["substrate"] = table if room is None else drawn_plate(table)
    return rooms


def _drawn(shape: Any) -> str | None:
    """Path of a drawing, with its layer; None for shapes given as text, tables and objects."""
    text = str(shape) if isinstance(shape, PathLike) else shape
    return text if isinstance(text, str) and text.strip() and is_drawing(text.rpartition("#")[0] or text) else None


def _table_of(shape: Any) -> Any:
    return shape.as_dict() if isinstance(shape, Boundary) else shape
