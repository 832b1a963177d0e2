"""``markergen.inspect``: what a file holds, how it was read, what is odd about it; and the same in another format."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

import numpy as np

from markergen.api.arguments import as_path
from markergen.api.shipped import template_plan
from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.files import Written, check_outputs, write_all
from markergen.geometry.contour import Contour, area, box
from markergen.geometry.outlines import polygons_of
from markergen.model.body_json import load_marker_or_rig
from markergen.model.boundary import middle_of
from markergen.model.camera import NO_DISTORTION, Camera
from markergen.model.recorded_poses import RecordedPoses
from markergen.model.rig_shapes import corners
from markergen.options import settle, takes
from markergen.options.inspection import InspectKeywords
from markergen.options.kinds import File, Files
from markergen.presentation.plots import FAINT, INK, SERIES, axes_of
from markergen.presentation.results import SavableResult, files_as_json, json_bytes, plain
from markergen.presentation.tables import Table
from markergen.read.cameras import CAMERA_FORMATS, load_camera, sized, sized_document
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.cameras.files import camera_bytes
from markergen.read.dot_tables import read_layout
from markergen.read.formats import recognized, written
from markergen.read.kinds import kinds_of
from markergen.read.outlines.boundary import outline_reading
from markergen.read.outlines.formats import OUTLINE_FORMATS
from markergen.read.poses import AS_WRITTEN, POSE_FORMATS, pose_reading, stated_convention
from markergen.read.poses.conventions import READING
from markergen.read.remarks import collected_remarks, remark
from markergen.read.templates import read_template
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEEPEST = np.deg2rad(80)
"""Largest angle in rad off the axis of the lines in the picture of a camera."""

UNUSED = "not used of "
"""How remarks on what a reader did not use begin."""


@dataclass(frozen=True)
class Facts:
    """What a file holds of one kind.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    rows : mapping
        Text by what it is, for people.
    values : mapping
        The same for programs.
    draw : callable
        Draws it on axes of matplotlib.
    convert : callable or None
        Makes the content of a file of another format from its path, after the path was checked; None if none is known.
    """

    kind: str
    rows: Mapping[str, str]
    values: Mapping[str, Any]
    draw: Callable[["Axes"], object]
    convert: Callable[[Path], bytes] | None = None


class Inspection(SavableResult):
    """What is in a file; ``print(inspection)`` shows what the command prints.

    Attributes
    ----------
    file : str
    facts : tuple of Facts
        Of every kind that the file is of; nerf's transforms.json has a camera and poses.
    remarks : tuple of str
        What was not used of the file, and what is odd about it.

    Examples
    --------
    >>> import markergen as mg
    >>> mg.Camera(640, 480, 800, 800, 320, 240).save("camera.yaml")
    >>> mg.inspect("camera.yaml").facts[0].values["field_of_view_deg"]
    {'horizontal': 43.6, 'vertical': 33.4, 'diagonal': 53.1}
    """

    KINDS: ClassVar[Mapping[str, str]] = {".json": "json", ".svg": "plot", ".png": "plot"}

    def __init__(
        self, file: str, facts: Sequence[Facts], remarks: Sequence[str], written: Sequence[Written] = ()
    ) -> None:
        self.file, self.facts, self.remarks, self.written = file, tuple(facts), tuple(remarks), tuple(written)

    def parts(self) -> list[str | Table]:
        """See `Result.parts`."""
        tables = [Table(f"{self.file}: {facts.kind}", ("", ""), list(facts.rows.items())) for facts in self.facts]
        return [*tables, *self.remarks]

    def to_json(self) -> bytes:
        """Return the facts of each kind by its name, what was not used, warnings and files."""
        values: dict[str, Any] = {"file": self.file, **{facts.kind: facts.values for facts in self.facts}}
        values["unused"] = [line for line in self.remarks if line.startswith(UNUSED)]
        values["warnings"] = [line for line in self.remarks if not line.startswith(UNUSED)]
        return json_bytes(plain(values | {"files": files_as_json(self.written)}))

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the file's first kind, on given axes or new ones."""
        axes = axes_of(ax)
        self.facts[0].draw(axes)
        axes.set_title(f"{self.file}: {self.facts[0].kind}")
        return axes

    def __repr__(self) -> str:
        return f"<Inspection of {self.file}: {', '.join(facts.kind for facts in self.facts)}>"


@takes(InspectKeywords)
def inspect(
    file: File,
    *,
    to: File | None = None,
    save: Files = (),
    json: File | None = None,
    plot: File | None = None,
    **options: Unpack[InspectKeywords],
) -> Inspection:
    """Return what a camera, poses, an outline, a marker, a rig or a spec holds, and how it was read.

    Parameters
    ----------
    file : str or path
    to : str or path, optional
        File to write the camera, poses or outline to, in the format of its ending.
    save : path or list of paths
        Files to write, by suffix: .json for the facts, .svg or .png for a picture.
    json, plot : path or None
        Files for the facts and for the picture.
    **options
        As on the command line, ``markergen inspect --help``, with underscores.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError
        If the file cannot be read, or the target's format cannot hold what is in it, such as a lens or a covariance.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import markergen as mg
    >>> mg.Camera(640, 480, 800, 800, 320, 240).save("camera.yaml")
    >>> mg.inspect("camera.yaml", to="cameras.txt")
    <Inspection of camera.yaml: camera>
    """
    asked = settle(options, InspectKeywords)
    path = as_path(file, "a file to inspect")
    target = None if to is None else Path(to)
    targets = Inspection.targets(save, json=json, plot=plot)
    check_outputs([name for _, name in targets.files] + ([target] if target else []), [path])
    with collected_remarks() as remarks:
        kinds = [asked["kind"]] if asked["kind"] else kinds_of(path)
        if unknown := [kind for kind in kinds if kind not in INSPECTORS]:
            raise InputError("a known --kind", brief(unknown[0]), among(unknown[0], INSPECTORS))
        for option, kind in KIND_OF_OPTION.items():
            if asked[option] not in (None, False) and kind not in kinds:
                flag = option.replace("_", "-")
                remedy = f"leave out --{flag}, or give --kind {kind}"
                raise InputError(f"a file of kind {kind} for --{flag}", f"kind {' and '.join(kinds)}", remedy)
        facts = [INSPECTORS[kind](path, asked) for kind in kinds]
    inspection = Inspection(path.name, facts, remarks)
    contents = {} if target is None else {target: _converted(facts, target)}
    contents |= {name: inspection.content(kind, name) for kind, name in targets.files if kind == "plot"}
    inspection.written = tuple(map(Written, contents))
    results = {name: inspection.to_json() for kind, name in targets.files if kind == "json"}
    write_all(contents | results)
    inspection.written += tuple(map(Written, results))
    return inspection


def _converted(facts: Sequence[Facts], target: Path) -> bytes:
    contents = list[bytes]()
    problem = InputError("a camera, poses or an outline to convert", f"a {facts[0].kind}", "leave out --to")
    for part in facts:
        try:
            contents += [part.convert(target)] if part.convert else []
        except InputError as error:
            problem = error
    if len(contents) > 1:
        kinds = " or ".join(f"--kind {part.kind}" for part in facts)
        raise InputError("one kind to convert", f"{len(contents)} for {target.name}", f"give {kinds}")
    if not contents:
        raise problem
    return contents[0]


# --- Cameras ----------------------------------------------------------------------------------------------------------


def _camera(path: Path, asked: Mapping[str, Any]) -> Facts:
    source = sized(path, asked["image_size"])
    camera = load_camera(source)
    covariance = camera_covariance(None, source, camera)
    off = np.array([camera.cx, camera.cy]) - (np.array([camera.width, camera.height]) - 1) / 2
    lens = camera.distortion
    coefficients = dict(zip(lens.names, lens.coefficients, strict=True))
    view = {name: float(np.rad2deg(angle)) for name, angle in camera.fields_of_view.items()}
    # How far the lens moves what is seen in each corner of the image.
    right, low = camera.width - 0.5, camera.height - 0.5
    corners_px = np.array([[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]])
    moved = np.linalg.norm(camera.ideal.to_pixels(camera.from_pixels(corners_px)) - corners_px, axis=-1)
    sigma = None if covariance is None else dict(zip(camera.parameter_names, np.sqrt(np.diag(covariance)), strict=True))
    share = np.hypot(*off) / np.hypot(camera.width, camera.height)
    values = {
        "format": recognized(CAMERA_FORMATS, sized_document(source)[0]),
        **camera.as_dict(),
        "field_of_view_deg": {name: round(angle, 1) for name, angle in view.items()},
        "corner_distortion_px": [round(value, 2) for value in moved.tolist()],
        "sigma": sigma,
    }
    rows = {
        "format": str(values["format"]),
        "image": f"{camera.width} x {camera.height} px",
        "focal lengths": f"fx {camera.fx:.7g}, fy {camera.fy:.7g} px",
        "principal point": f"cx {camera.cx:.7g}, cy {camera.cy:.7g} px, "
        f"{100 * share:.1f} % of the diagonal off the center",
        "lens": f"{lens.model}: {', '.join(f'{k} {v:.6g}' for k, v in coefficients.items())}"
        if coefficients
        else "none",
        "field of view": f"{_degrees(view['horizontal'])} x {_degrees(view['vertical'])}, "
        f"diagonal {_degrees(view['diagonal'])}",
        "distortion at corners": f"up to {np.nanmax(moved):.1f} px" if np.isfinite(moved).any() else "beyond the lens",
        "standard deviations": "none" if sigma is None else ", ".join(f"{k} {v:.3g}" for k, v in sigma.items()),
    }
    return Facts(
        "camera", rows, values, partial(_draw_camera, camera), partial(camera_bytes, camera, covariance=covariance)
    )


def _degrees(angle: float) -> str:
    return f"{angle:.1f} deg" if np.isfinite(angle) else "beyond the lens"


def _draw_camera(camera: Camera, axes: "Axes") -> None:
    """Lines of equal angle as the lens bends them, and straight ones without it."""
    ends = camera.from_pixels(np.array([[-0.5, -0.5], [camera.width - 0.5, camera.height - 0.5]]))
    half = min(STEEPEST, np.arctan(1.2 * np.nanmax(np.abs(ends)))) if np.isfinite(ends).all() else STEEPEST
    steps, fine = np.tan(np.linspace(-half, half, 13)), np.tan(np.linspace(-half, half, 400))
    upright = [np.column_stack([np.full_like(fine, step), fine]) for step in steps]
    ideal = [] if camera.distortion == NO_DISTORTION or half == STEEPEST else [(camera.ideal, FAINT, 0.8)]
    for model, color, width in [*ideal, (camera, INK, 1.0)]:
        for line in upright + [line[:, ::-1] for line in upright]:
            axes.plot(*model.to_pixels(line).T, color=color, linewidth=width)
    axes.plot([camera.cx], [camera.cy], **{**SERIES[1], "linestyle": "none"})
    axes.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="x, px", ylabel="y, px")


# --- Poses ------------------------------------------------------------------------------------------------------------


def _poses(path: Path, asked: Mapping[str, Any]) -> Facts:
    poses, form, frame, axes = pose_reading(path, stated_convention(asked) or AS_WRITTEN)
    if doubt := poses.plausibility():
        remark(f"{path.name}: {doubt}")
    spans = {"distance": (poses.distance, ".4g", "m"), "tilt": (poses.polar_angle_deg, ".1f", "deg")}
    front = int(np.count_nonzero(poses.cos_tilt > 0))
    values = {
        "format": form,
        "count": len(poses),
        "frame": frame,
        "axes": axes,
        **{
            f"{name}_{unit}": {"min": span.min(), "median": np.median(span), "max": span.max()}
            for name, (span, _, unit) in spans.items()
        },
        "from_the_front": front,
    }
    rows = {
        "format": form,
        "poses": f"{len(poses)}, {front} of them in front of the marker",
        "read as": f"{frame}, axes of {axes}{f', in {unit}' if (unit := asked.get('poses_unit')) else ''}",
        **{
            name: f"{span.min():{form}} to {span.max():{form}} {unit}, median {np.median(span):{form}} {unit}"
            for name, (span, form, unit) in spans.items()
        },
    }
    return Facts(
        "poses",
        rows,
        values,
        partial(_draw_poses, poses),
        partial(written, POSE_FORMATS, "a file of poses", poses.numbers),
    )


def _draw_poses(poses: RecordedPoses, axes: "Axes") -> None:
    """Cameras from the side, by distance from the normal and height above the marker, with their lines of sight."""
    every = max(1, len(poses) // 300)
    rotation, translation = poses.rotation[::every], poses.translation[::every]
    centers = -np.einsum("pji,pj->pi", rotation, translation)
    # Within the plane of the normal and the camera's center, x is away from the normal.
    away = centers[:, :2] / np.maximum(np.hypot(*centers[:, :2].T), 1e-12)[:, None]
    sight = rotation[:, 2] * (0.15 * np.median(np.linalg.norm(translation, axis=-1)))
    x = np.sum(centers[:, :2] * away, axis=-1)
    u = np.sum(sight[:, :2] * away, axis=-1)
    axes.quiver(x, centers[:, 2], u, sight[:, 2], angles="xy", scale_units="xy", scale=1, width=0.002, color=FAINT)
    axes.plot(x, centers[:, 2], **{**SERIES[0], "linestyle": "none", "markersize": 3})
    axes.plot([0], [0], **{**SERIES[1], "linestyle": "none"})
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="distance of the camera from the marker's normal, m", ylabel="height above the marker, m")


# --- Outlines ---------------------------------------------------------------------------------------------------------


def _outline(path: Path, asked: Mapping[str, Any]) -> Facts:
    options = asked["boundary_unit"], asked["layer"], bool(asked["ignore_open"])
    contours, form, scale = outline_reading(path, *options)
    boxes = np.array([box(contour) for contour in contours])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    outer = sum(area(contour) > 0 for contour in contours)
    sides = [side for contour in contours for side in contour.sides]
    arcs, total = sum(1 for side in sides if side[2]), sum(map(area, contours))
    center = middle_of(contours).tolist()
    values = {
        "format": form,
        "unit_mm": scale * 1e3,
        "size_m": (high - low).tolist(),
        "low_m": low.tolist(),
        "center_m": center,
        "area_m2": total,
        "outlines": int(outer),
        "holes": len(contours) - int(outer),
        "lines": len(sides) - arcs,
        "arcs": arcs,
    }
    width, height = (format_length(float(side)) for side in high - low)
    placed = " and ".join(f"{axis} {format_length(round(value, 7))}" for axis, value in zip("xy", center, strict=True))
    rows = {
        "format": form,
        "unit": f"{scale * 1e3:.7g} mm",
        "size": f"{width} x {height}, from ({format_length(float(low[0]))}, {format_length(float(low[1]))})",
        "origin": f"of a marker at {placed} of the drawing; --origin file keeps the drawing's",
        "outlines": f"{outer}, with {len(contours) - outer} hole{'s' * (len(contours) - outer != 1)}",
        "sides": f"{len(sides) - arcs} lines, {arcs} arcs",
        "area": f"{total * 1e6:.7g} mm^2",
    }
    return Facts(
        "outline",
        rows,
        values,
        partial(_draw_outline, contours),
        partial(written, OUTLINE_FORMATS, "an outline", contours),
    )


def _draw_outline(contours: Sequence[Contour], axes: "Axes") -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    rings = [np.concatenate([ring, ring[:1]]) * 1e3 for ring in polygons_of(contours)]
    axes.add_patch(PathPatch(Curve.make_compound_path(*map(Curve, rings)), facecolor=FAINT, edgecolor=INK))
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")


# --- Markers, rigs, specs, points -------------------------------------------------------------------------------------


def _body(kind: str, path: Path, asked: Mapping[str, Any]) -> Facts:
    del asked
    body = load_marker_or_rig(path)
    plates = body.plates
    diameters = sorted({2 * radius for radius in body.radii.tolist()})
    tags = {plate.name: str(plate.marker.tag) for plate in plates if plate.marker.tag}
    values = {
        "dots": len(body.dots),
        "diameters_m": diameters,
        "radius_m": body.radius,
        "plates": {plate.name: repr(plate.marker) for plate in plates},
        "tags": tags,
    }
    sizes = ", ".join(map(format_length, diameters[:6]))
    rows = {
        "dots": f"{len(body.dots)} of {sizes}",
        "size": f"within {format_length(float(f'{body.radius:.4g}'))} of the origin",
        **{plate.name: str(plate.marker) for plate in plates},
        "tags": ", ".join(tags.values()) or "none",
    }
    return Facts(kind, rows, values, body.plot)


def _spec(path: Path, asked: Mapping[str, Any]) -> Facts:
    del asked
    values = read_template(str(path))
    spec, _, shape = template_plan(str(path))
    rows, boundary = {key: brief(value) for key, value in values.items()}, spec.boundary
    points = np.concatenate([*map(corners, shape.faces)]) if shape else boundary.rim(64)
    return Facts("spec", rows, {"options": values, "boundary": str(boundary)}, partial(_draw_dots, points))


def _points(path: Path, asked: Mapping[str, Any]) -> Facts:
    del asked
    points = np.array(read_layout(path), dtype=float)
    low, high = points.min(axis=0), points.max(axis=0)
    rows = {"points": str(len(points)), "size": " x ".join(format_length(float(side)) for side in high - low)}
    return Facts("points", rows, {"count": len(points), "points_m": points.tolist()}, partial(_draw_dots, points))


def _draw_dots(points: Array, axes: "Axes") -> None:
    axes.plot(*(points[:, :2].T * 1e3), **{**SERIES[0], "linestyle": "none"})
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x, mm", ylabel="y, mm")


INSPECTORS: dict[str, Callable[[Path, Mapping[str, Any]], Facts]] = {
    "marker": partial(_body, "marker"),
    "rig": partial(_body, "rig"),
    "spec": _spec,
    "camera": _camera,
    "poses": _poses,
    "outline": _outline,
    "points": _points,
}
"""Functions that read the facts of a file of a kind."""

KIND_OF_OPTION = {
    "image_size": "camera",
    **dict.fromkeys(READING, "poses"),
    **dict.fromkeys(("boundary_unit", "layer", "ignore_open"), "outline"),
}
"""Kind of file that an option says how to read."""
