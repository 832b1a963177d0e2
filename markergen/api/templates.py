"""Shipped templates with what they are for, how large they are, and from where they are seen."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from markergen.api.design import request_of, rig_request_of
from markergen.exporters import ExportOptions
from markergen.files import Written
from markergen.model.goal import parse_goal
from markergen.model.rig_shapes import RigShape, corners
from markergen.model.spec import AUTO, Spec
from markergen.objectives import OBJECTIVES
from markergen.presentation.results import SavableResult, json_bytes
from markergen.presentation.tables import Table
from markergen.read.poses import poses_from
from markergen.read.spec_file import spec_from_mapping
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
    targets.check([])
    result = Overview(templates=tuple(map(_template, shipped_templates())))
    return replace(result, written=tuple(result.write(targets)))


def template_plan(name: str) -> tuple[Spec, ExportOptions, RigShape | None]:
    """Spec, choices of sheets and plates of a template, as its command takes it; raises InputError."""
    of_rig = "shape" in read_template(name)
    request = rig_request_of("", {"template": name}) if of_rig else request_of({"template": name})
    for criterion in parse_goal(request.spec.objective).names:
        OBJECTIVES[criterion]
    return request.spec, request.choices, request.shape


def _template(name: str) -> Template:
    values = read_template(name)
    if "shape" in values:
        request = rig_request_of("", {"template": name})
        faces = request.shape.faces if request.shape else ()
        spec, plates, room = request.spec, len(faces), np.concatenate([*map(corners, faces)])
    else:
        spec, plates = spec_from_mapping(values, name), 1
        room = np.concatenate(spec.boundary.outlines())
    away = poses_from(spec.poses).distance
    return Template(
        name,
        str(values.get("title", "")),
        "rig" if "shape" in values else "design",
        tuple(round(float(side), 6) for side in np.ptp(room, axis=0) if side > 1e-9),
        None if spec.n == AUTO else plates * spec.n,
        (spec.camera.width, spec.camera.height),
        (round(float(away.min()), 3), round(float(away.max()), 3)),
    )
