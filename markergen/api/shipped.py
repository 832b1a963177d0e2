"""Shipped templates, with sizes and distances; examples and notebooks, and copies of all of them to begin with."""
# tests: tests/api/test_templates.py tests/api/test_example.py

import re
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from markergen.api.design import request_of, rig_request_of
from markergen.errors import InputError, OutputError, among
from markergen.exporters import ExportOptions
from markergen.files import Written, folders_for, shipped_folder, write_all
from markergen.model.goal import parse_goal
from markergen.model.rig_shapes import RigShape, corners
from markergen.model.spec import AUTO, Spec
from markergen.objectives import OBJECTIVES
from markergen.presentation.results import Files, SavableResult, json_bytes
from markergen.presentation.tables import Table
from markergen.read.poses import poses_from
from markergen.read.templates import read_template, shipped_templates


@dataclass(frozen=True)
class Template:
    """A template, in the terms of a reader who chooses one.

    Attributes
    ----------
    command : str
        ``design``, or ``rig`` for several plates.
    size : tuple of float
        Width and height of the room for dots, or of what the plates of a rig fill, and its depth, in m.
    dots : int or None
        Number of dots, of all plates; None if the search chooses it.
    camera : tuple of int
        Width and height of the image in px.
    distances : tuple of float
        Of the nearest and the farthest pose, in m.
    """

    name: str
    title: str
    command: str
    size: tuple[float, ...]
    dots: int | None
    camera: tuple[int, int]
    distances: tuple[float, float]


@dataclass(frozen=True)
class Overview(SavableResult):
    """The shipped templates, by name."""

    templates: tuple[Template, ...] = ()
    written: tuple[Written, ...] = ()

    def parts(self) -> list[str | Table]:
        """Return the table of all, and how to use one."""
        rows = [
            [
                template.name,
                template.title,
                " x ".join(f"{1e3 * side:.4g}" for side in template.size),
                str(template.dots or "auto"),
                "x".join(map(str, template.camera)),
                "{:.2g} to {:.2g}".format(*template.distances),
            ]
            for template in self.templates
        ]
        rigs = ", ".join(template.name for template in self.templates if template.command == "rig")
        return [
            Table("Templates", ["name", "for", "size mm", "dots", "camera px", "distance m"], rows),
            "Use: markergen design --template desk-a4 -o marker.pdf. Edit: markergen templates desk-a4 > my.toml",
            f"Several plates ({rigs}): markergen rig --template cube -o cube.pdf",
        ]

    def to_json(self) -> bytes:
        """Return a list of tables with the attributes of `Template`."""
        return json_bytes([asdict(template) for template in self.templates])


def overview(json: object = None) -> Overview:
    """Return all shipped templates, and write them as JSON.

    Raises
    ------
    InputError
        If the path cannot be written to.

    Examples
    --------
    >>> [(each.command, each.dots, each.distances) for each in overview().templates if each.name == "paper-disk"]
    [('design', 5, (0.6, 1.5))]
    """
    targets = Overview.targets(json=json)
    targets.check()
    return Overview(templates=tuple(map(_template, shipped_templates()))).saved(targets)


def template_plan(name: str) -> tuple[Spec, ExportOptions, RigShape | None]:
    """Spec, choices of sheets and plates of a template, as its command takes it; raises InputError."""
    of_rig = "shape" in read_template(name)
    request = rig_request_of("", {"template": name}) if of_rig else request_of({"template": name})
    for criterion in parse_goal(request.spec.objective).names:
        OBJECTIVES[criterion]
    return request.spec, request.choices, request.shape


def _template(name: str) -> Template:
    values, (spec, _, shape) = read_template(name), template_plan(name)
    room = np.concatenate([*map(corners, shape.faces)] if shape else spec.boundary.outlines())
    away = poses_from(spec.poses).distance
    return Template(
        name,
        str(values.get("title", "")),
        "rig" if shape else "design",
        tuple(round(float(side), 6) for side in np.ptp(room, axis=0) if side > 1e-9),
        None if spec.n == AUTO else (len(shape.faces) if shape else 1) * spec.n,
        (spec.camera.width, spec.camera.height),
        (round(float(away.min()), 3), round(float(away.max()), 3)),
    )


def examples() -> dict[str, Path]:
    """Return all that can be copied, by name: scripts, notebooks, folders of packages, and templates."""
    folder = shipped_folder("examples")
    packages = [path.parent for name in ("package.xml", "pyproject.toml") for path in folder.glob(f"*/{name}")]
    paths = [*folder.glob("*.py"), *folder.glob("notebooks/*.ipynb"), *packages]
    return {path.stem: path for path in sorted(paths)} | shipped_templates()


def summary_of(path: Path) -> str:
    """Return the first sentence that an example says of itself, in its docstring, comment, heading or README."""
    text = (path / "README.md" if path.is_dir() else path).read_text(encoding="utf-8")
    first = re.search(r'^(?:"""|# | *"# )?([A-Z][^\n"]{9,}?)(?:[.:;] |\.?$|\.?\\n)', text, re.MULTILINE)
    return first[1] if first else ""


def copied_example(name: str, folder: str | Path = ".") -> Files:
    """Copy an example into a folder, where nothing of its name may be.

    Raises
    ------
    InputError
        If there is no such example.
    OutputError
        If it is there already, or cannot be written.
    """
    paths = examples()
    if name not in paths:
        raise InputError("a known example", repr(name), among(name, sorted(paths)))
    source, target = paths[name], Path(folder) / paths[name].name
    if target.exists():
        raise OutputError(f"expected nothing at {target}, found it there; remove it, or copy to another folder")
    files = [path for path in sorted(source.rglob("*")) if path.is_file()] if source.is_dir() else [source]
    contents = {
        target / path.relative_to(source): path.read_bytes() for path in files if "__pycache__" not in path.parts
    }
    with folders_for(contents):
        write_all(contents)
    return Files(list(map(Written, contents)))
