"""Design specs: TOML files, templates, and the spec that a marker.json carries."""

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.spec import Spec
from markergen.units import parse_length


def _length(value: object) -> float:
    try:
        return parse_length(value if isinstance(value, (str, int, float)) else str(value))
    except InputError as error:
        # pydantic collects ValueErrors with their paths; our own error would end the list at the first.
        raise ValueError(str(error)) from None


Length = Annotated[float, BeforeValidator(_length)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Boundary(_Table):
    kind: str = "circle"
    radius: Length


class _Camera(_Table):
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class _SpecFile(_Table):
    title: str = ""
    n: int = 5
    radius: Length | None = None
    boundary: _Boundary | None = None
    camera: _Camera | None = None
    poses: str = "paper"
    objective: str = "pose"
    aggregate: str = ""
    coordinates: str = "unit"
    dot: Length | None = None
    clearance: Length | None = None
    seed: int = 0
    restarts: int = 0


def spec_from_mapping(values: Mapping[str, Any], name: str = "spec") -> Spec:
    """Make a spec of plain values; lengths may be text with a unit. `name` is what messages call the source.

    Raises
    ------
    InputError
        If keys are unknown or values unfit; all of them are listed, each with its path.
    """
    try:
        table = _SpecFile.model_validate(dict(values))
    except ValidationError as error:
        findings = "; ".join(f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors())
        raise InputError(f"a valid spec in {name}", findings, "correct these places") from None
    fields = table.model_dump(exclude={"title", "radius", "boundary", "camera"})
    radius = table.boundary.radius if table.boundary else None
    radius = table.radius if table.radius is not None else radius
    camera = Camera(**table.camera.model_dump()) if table.camera else PAPER_CAMERA
    return Spec(camera=camera, **fields) if radius is None else Spec(boundary=Circle(radius), camera=camera, **fields)


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


def template_text(name: str) -> str:
    """Text of a template, as `read_template` finds it, comments and all."""
    known = templates()
    path = Path(name)
    if path.suffix != ".toml" and name not in known:
        raise InputError("a known template or a .toml file", repr(name), f"known: {', '.join(known)}")
    try:
        return known.get(name, path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "bytes that are not UTF-8 text"
        raise InputError(f"a readable spec at {path}", str(reason), "check the path") from None


def templates() -> dict[str, Path]:
    """Shipped templates by name, whether markergen runs from a wheel or from a checkout."""
    package = Path(str(files("markergen")))
    folder = next((place for place in (package / "templates", package.parent / "templates") if place.is_dir()), package)
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
