"""Design specs: TOML files, templates, and the spec that a marker.json carries."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.boundary_file import BoundaryFile, built
from markergen.model.camera import LARGEST_SIDE, Camera, Distortion
from markergen.model.findings import brief, findings_of, listed
from markergen.model.holes import parse_dowel, parse_mount
from markergen.model.image_noise import ImageNoise
from markergen.model.recorded_poses import MOST_KEPT, RecordedPoses
from markergen.model.spec import Spec
from markergen.model.substrate import Hole
from markergen.model.substrate_file import SubstrateFile
from markergen.read.outlines import parse_boundary
from markergen.read.poses import settled
from markergen.read.poses.numbers import numbers_of_rows
from markergen.units import parse_length

LARGEST_SPEC = 10_000
"""Characters; one dotted key of ten times as many keeps a TOML reader busy for a minute."""


def _length(value: object) -> float:
    try:
        return parse_length(value if isinstance(value, (str, int, float)) else str(value))
    except InputError as error:
        # pydantic collects ValueErrors with their paths; our own error would end the list at the first.
        raise ValueError(error.args[2]) from None


def _length_or_auto(value: object) -> float | str:
    if value == "auto":
        return "auto"
    try:
        return _length(value)
    except ValueError as error:
        raise ValueError(f"{error}, or auto") from None


def _shape(value: object) -> object:
    """A boundary's table with its lengths in m; what is none is left for the check of the table to say."""
    if isinstance(value, str):
        if not re.match(r"\s*(circle|rect):", value):
            raise ValueError("write rect:0.2x0.1, circle:0.15, or a table with kind and outlines")
        try:
            return parse_boundary(value, origin="file").as_dict()
        except InputError as error:
            raise ValueError(str(error)) from None
    if isinstance(value, Mapping):
        return {"kind": "circle", **{key: item if key == "kind" else _lengths(item) for key, item in value.items()}}
    return value


def _lengths(value: object, levels: int = 3) -> object:
    # Outlines, corners, coordinates; deeper ones are for the check of the table.
    if isinstance(value, list) and levels:
        return [_lengths(item, levels - 1) for item in value]
    try:
        return _length(value) if isinstance(value, str) else value
    except ValueError:
        return value


HOLES = {"mount": parse_mount, "dowel": parse_dowel}
"""Keys of holes that are written as on the command line."""


def _plate(value: object) -> object:
    """A substrate's table with its lengths in m and all its holes one by one; what is unfit is left for its check."""
    if not isinstance(value, Mapping):
        return value
    table = {key: _lengths(item) for key, item in value.items() if key not in HOLES}
    if "outline" in table:
        table["outline"] = _shape(table["outline"])
    written = [asdict(hole) for key in HOLES for hole in _holes(key, value.get(key, []))]
    holes = table.get("holes", [])
    if isinstance(holes, list) and (holes or written):
        table["holes"] = [_hole(hole) for hole in holes] + written
    return table


def _hole(value: object) -> object:
    if not isinstance(value, Mapping):
        return value
    return {key: item if key in ("use", "name") else _lengths(item) for key, item in value.items()}


def _holes(key: str, texts: object) -> list[Hole]:
    every = texts if isinstance(texts, list) else [texts]
    try:
        return [hole for text in every for hole in HOLES[key](text if isinstance(text, str) else brief(text))]
    except InputError as error:
        raise ValueError(f"{key}: {error}") from None


Shape = Annotated[BoundaryFile, BeforeValidator(_shape)]
Plate = Annotated[SubstrateFile, BeforeValidator(_plate)]
Length = Annotated[float, BeforeValidator(_length)]
DotLength = Annotated[float | Literal["auto"], BeforeValidator(_length_or_auto)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Whole = Annotated[int, Field(lt=2**63)]  # TOML's integers have 64 bits
Side = Annotated[int, Field(ge=1, le=LARGEST_SIDE)]

ABSENT: Any = None
"""Stands in for a key that is not given; the defaults are those of `Spec` alone."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Distortion(_Table):
    model: str
    coefficients: list[Finite]

    @model_validator(mode="after")
    def _known(self) -> "_Distortion":
        try:
            Distortion(self.model, tuple(self.coefficients))
        except InputError as error:
            raise ValueError(str(error)) from None
        return self


class _Camera(_Table):
    width: Side
    height: Side
    fx: Finite
    fy: Finite
    cx: Finite
    cy: Finite
    distortion: _Distortion = ABSENT


class _ImageNoise(_Table):
    blur_px: Finite = ABSENT
    noise_grey: Finite = ABSENT
    contrast: Finite = ABSENT


class _Poses(_Table):
    """Poses of a file, as a marker.json carries them."""

    file: Annotated[str, Field(min_length=1, max_length=255)]
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    dropped: Annotated[int, Field(ge=0, lt=2**63)]
    sampled_from: Annotated[int, Field(ge=0, lt=2**63)]
    columns: Literal["tx ty tz qx qy qz qw"]
    rows: Annotated[list[str], Field(min_length=1, max_length=MOST_KEPT)]


def _poses(value: object) -> str | RecordedPoses:
    if isinstance(value, str):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("Input should be a valid string")
    try:
        table = _Poses.model_validate(dict(value))
        numbers = numbers_of_rows(table.rows)
    except ValidationError as error:
        raise ValueError(listed(findings_of(error))) from None
    except InputError as error:
        raise ValueError(str(error)) from None
    file = table.file if table.file.isprintable() else brief(table.file)
    return RecordedPoses.of(numbers, file, table.sha256, table.dropped, table.sampled_from)


class _SpecFile(_Table):
    title: str = ABSENT
    n: Whole = ABSENT
    radius: Length = ABSENT
    boundary: Shape = ABSENT
    keep_outs: list[Shape] = ABSENT
    camera: _Camera = ABSENT
    poses: Annotated[Any, BeforeValidator(_poses)] = ABSENT
    objective: str = ABSENT
    aggregate: str = ABSENT
    coordinates: str = ABSENT
    dot: DotLength | None = ABSENT
    clearance: Length | None = ABSENT
    seed: Whole = ABSENT
    restarts: Whole = ABSENT
    noise_model: str = ABSENT
    image_noise: _ImageNoise = ABSENT
    survive: Whole = ABSENT
    print_sigma: Length = ABSENT
    asymmetric: Finite = ABSENT
    relief: Length = ABSENT
    tag: str = ABSENT
    tag_side: Length = ABSENT
    substrate: Plate = ABSENT

    @field_validator("boundary")
    @classmethod
    def _only_one(cls, boundary: Any, info: ValidationInfo) -> Any:
        if info.data.get("radius") is not None:
            raise ValueError("give either radius or [boundary], not both")
        return boundary


def spec_from_mapping(values: object, name: str = "spec", stored: bool = False) -> Spec:
    """Make a spec of a mapping of plain values; lengths may be text with a unit, what is not given is as in `Spec`.

    `name` is what messages call the source. What a marker.json has `stored` names no other files: they are not read.

    Raises
    ------
    InputError
        If it is not a mapping, keys are unknown or values unfit; all of them are listed, each with its path.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"a table of values in {name}", brief(values), "write for example n = 5 or radius = 0.15")
    try:
        table = _SpecFile.model_validate(dict(values))
    except ValidationError as error:
        raise InputError(f"a valid spec in {name}", listed(findings_of(error)), "correct these places") from None
    given = table.model_dump(exclude_unset=True, exclude={"title", "radius", "poses"})
    if "camera" in given:
        given["camera"] = _camera(table.camera)
    if "image_noise" in given:
        given["image_noise"] = ImageNoise(**given["image_noise"])
    if table.poses is not None:
        given["poses"] = settled(table.poses) if isinstance(table.poses, str) and not stored else table.poses
    if "boundary" in given:
        given["boundary"] = table.boundary.build()
    elif table.radius is not None:
        given["boundary"] = Circle(table.radius)
    if "keep_outs" in given:
        given["keep_outs"] = built(table.keep_outs)
    if "substrate" in given:
        given["substrate"] = table.substrate.build()
        # Markers that were made before outlines from drawings were the plate's may have an edge around one.
        if stored and given["substrate"].edge and not given.get("boundary", Spec.boundary).has_measures:
            given["substrate"] = replace(given["substrate"], edge=None)
    return Spec(**given)


def _camera(table: _Camera) -> Camera:
    values = table.model_dump(exclude={"distortion"})
    if table.distortion is None:
        return Camera(**values)
    return Camera(**values, distortion=Distortion(table.distortion.model, tuple(table.distortion.coefficients)))


def read_template(name: str) -> dict[str, Any]:
    """Values of a template: the name of one that is shipped (see `templates`), or the path of a TOML file.

    Raises
    ------
    InputError
        If there is no such template or the file is not TOML.
    """
    try:
        return tomllib.loads(template_text(name))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"TOML in {name}", str(error), "correct the file") from None
    except (ValueError, RecursionError):
        raise InputError(f"TOML in {name}", "an endless number or endless nesting", "correct the file") from None


def template_text(name: str) -> str:
    """Text of a template, as `read_template` finds it, comments and all."""
    known = templates()
    path = Path(name)
    if path.suffix != ".toml" and name not in known:
        raise InputError("a known template or a .toml file", repr(name), f"known: {', '.join(known)}")
    try:
        with known.get(name, path).open(encoding="utf-8") as file:
            text = file.read(LARGEST_SPEC + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "bytes that are not UTF-8 text"
        raise InputError(f"a readable spec at {path}", str(reason), "check the path") from None
    if len(text) > LARGEST_SPEC:
        raise InputError(f"a spec of at most {LARGEST_SPEC // 1000} kB at {path}", "a larger file", "check the path")
    return text


def templates() -> dict[str, Path]:
    """Shipped templates by name, whether markergen runs from a wheel or from a checkout."""
    package = Path(str(files("markergen")))
    folder = next((place for place in (package / "templates", package.parent / "templates") if place.is_dir()), package)
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
