"""``markergen design``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from markergen.cli import sheets, solids
from markergen.cli.console import length


def design(
    n: Annotated[int | None, typer.Option("--n", help="Number of control points, 4 to 200. [default: 5]")] = None,
    radius: Annotated[
        float | None,
        typer.Option(parser=length, metavar="LENGTH", help="Of the disk that the dots must lie in. [default: 150mm]"),
    ] = None,
    boundary: Annotated[
        str | None,
        typer.Option(
            metavar="SHAPE|FILE",
            help="Instead of a disk: rect:200mmx100mm, or outlines with their holes from an SVG, DXF or GeoJSON file.",
        ),
    ] = None,
    boundary_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Of drawings that name none: mm, cm, m, in, pt, px.")
    ] = None,
    layer: Annotated[
        str | None, typer.Option(metavar="NAME", help="Layer of the drawing that the boundary is on. [default: all]")
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of the marker frame: center, of the smallest circle around the boundary, or file, where the drawing "
            "has it. [default: center]",
        ),
    ] = None,
    keep_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SHAPE|FILE[#LAYER]",
            help="Where no dot may be: circle:3mm@40mm,-20mm, rect:40mmx40mm, or a drawing, which lies as that of "
            "the boundary; may be repeated.",
        ),
    ] = None,
    template: Annotated[
        str | None, typer.Option(metavar="NAME|FILE", help="Start from a ready-made spec; see markergen templates.")
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: the paper's camera]"
        ),
    ] = None,
    poses: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|CONE|FILE",
            help="From where it is seen: paper, paper-roll, cone:distance=0.4..1m,tilt=0..60,azimuth=-30..30, or a "
            "CSV, JSON, TUM or COLMAP file. [default: paper]",
        ),
    ] = None,
    objective: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="pose, rotation, translation, homography or condition. [default: pose]"),
    ] = None,
    aggregate: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Over the poses: rms, mean, logmean, max or cvar:0.9. [default: the objective's]"
        ),
    ] = None,
    coordinates: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="That condition is written in: unit, metric, pixel, hartley. [default: unit]"
        ),
    ] = None,
    survive: Annotated[
        int | None,
        typer.Option(metavar="K", help="Minimize what is left after the worst loss of K dots, 1 to 3. [default: 0]"),
    ] = None,
    dot: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH|auto",
            help="Dot diameter; auto: the one with the least predicted error, see --print-sigma. "
            "[default: what the camera needs]",
        ),
    ] = None,
    clearance: Annotated[
        float | None,
        typer.Option(parser=length, metavar="LENGTH", help="Smallest gap around dots. [default: a tenth of --dot]"),
    ] = None,
    asymmetric: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="No key ring: the layout itself tells the dots apart, until images are off by so much. [default: 0]",
        ),
    ] = None,
    relief: Annotated[
        float | None,
        typer.Option(
            parser=length, metavar="LENGTH", help="Dots may stand on pillars, up to so high. [default: 0mm, flat]"
        ),
    ] = None,
    tag: Annotated[
        str | None,
        typer.Option(
            metavar="FAMILY:ID",
            help="A square tag in the middle that tells markers and labels apart, such as aruco:DICT_4X4_50:7 or "
            "apriltag:36h11:3. [default: none]",
        ),
    ] = None,
    tag_size: Annotated[
        float | None,
        typer.Option(
            parser=length,
            metavar="LENGTH",
            help="Side of the tag's black square, without its white edge. [default: a third of the radius, or less]",
        ),
    ] = None,
    ids: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="A family of markers of one layout with these ids instead of the tag's own: 0-9, or 0,3,7; on one "
            "sheet, with <stem>-<id>.json for each.",
        ),
    ] = None,
    noise_model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="point: 1 px everywhere; image: what each dot's image tells in each pose. [default: point]",
        ),
    ] = None,
    print_sigma: Annotated[
        float | None,
        typer.Option(
            parser=length,
            metavar="LENGTH",
            help="Error of a printed dot's place along each axis, for --noise-model image and --dot auto. "
            "[default: 0mm]",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Of the random starts; the same seed gives the same bytes. [default: 0]")
    ] = None,
    restarts: Annotated[int | None, typer.Option(min=1, help="Random starts. [default: the objective's]")] = None,
    paper: sheets.Paper = None,
    orientation: sheets.Orientation = None,
    margin: sheets.Margin = None,
    tile: sheets.Tile = True,
    overlap: sheets.Overlap = None,
    dpi: sheets.Dpi = 600,
    colors: sheets.ColorsText = None,
    process: solids.Process = None,
    thickness: solids.Thickness = None,
    edge: solids.Edge = None,
    corner_radius: solids.CornerRadius = None,
    chamfer: solids.Chamfer = None,
    outline: solids.Outline = None,
    mount: solids.Mount = None,
    dowel: solids.Dowel = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="Written by suffix (.pdf .svg .png .dxf .step .stl .json and more, see markergen export); may be "
            "repeated. "
            "[default: marker.pdf, with relief marker.json]",
        ),
    ] = None,
    trace: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Write the way of the search, step by step, as .csv, or plotted as .svg or .png; may be repeated.",
        ),
    ] = None,
) -> None:
    """Find the best layout of control points, and write the marker; <stem>.json always comes with it.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen design --n 8 --boundary plate.dxf --camera camera.yaml --poses flights.csv
      markergen design --n 6 --relief 20mm --mount 4xM4@240mm --dowel 2x4mm@260mm -o marker.step
    """
    from markergen.cli import console
    from markergen.errors import InputError
    from markergen.export import check_outputs, save, with_record
    from markergen.export.family import family_paths, save_family
    from markergen.files import check_outputs as check_files
    from markergen.files import write_all
    from markergen.model.tag import parse_ids
    from markergen.objectives import OBJECTIVES
    from markergen.objectives.survive import hidden_dot_errors
    from markergen.optimize.design import design as find
    from markergen.optimize.family import members
    from markergen.optimize.trace import check_trace_path, trace_bytes
    from markergen.read.cameras import read_camera
    from markergen.read.outlines import drawn_plate, is_drawing, read_room
    from markergen.read.spec_file import read_template, spec_from_mapping

    if radius is not None and boundary is not None:
        raise InputError("a radius or a boundary", "--radius and --boundary", "leave one of them out")
    if boundary is None and (layer is not None or origin is not None):
        raise InputError("--layer and --origin with a drawing", "no --boundary", "give --boundary, or leave them out")
    values = read_template(template) if template else {}
    options: dict[str, Any] = {
        "n": n, "radius": radius, "objective": objective, "aggregate": aggregate, "coordinates": coordinates,
        "poses": poses, "survive": survive, "dot": dot, "clearance": clearance, "asymmetric": asymmetric,
        "relief": relief, "noise_model": noise_model, "print_sigma": print_sigma, "seed": seed, "restarts": restarts,
        "tag": tag, "tag_side": tag_size,
    }  # fmt: skip
    shapes = [*([outline] if outline is not None else []), *(keep_out or ())]
    room, read = read_room(boundary, shapes, boundary_unit, layer, origin or "center")
    plate = solids.plate_values(thickness, edge, corner_radius, chamfer, mount, dowel)
    keep_outs = read[1:] if outline is not None else read
    if outline is not None:
        plate["outline"] = read[0].as_dict()
    if room is not None:
        values.pop("radius", None)
        options["boundary"] = room.as_dict()
    if radius is not None:
        values.pop("boundary", None)
    if keep_outs:
        options["keep_outs"] = [shape.as_dict() for shape in keep_outs]
    if camera is not None:
        options["camera"] = read_camera(camera).as_dict()
    drawn = boundary is not None and is_drawing(boundary)
    if (plate or drawn) and isinstance(before := values.get("substrate", {}), dict):
        options["substrate"] = drawn_plate({**before, **plate}) if drawn else {**before, **plate}
    values.update({key: value for key, value in options.items() if value is not None})
    spec = spec_from_mapping(values, template or "the options")
    if ids is not None and not spec.tag:
        raise InputError("a tag whose ids the markers have", "--ids without --tag", "add --tag aruco:DICT_4X4_50, say")
    numbers = parse_ids(ids, spec.tag.rpartition(":")[0]) if ids is not None else ()
    choices = replace(
        sheets.export_options(paper, orientation, margin, tile, overlap, dpi, colors, compensate=False),
        fabrication=solids.fabrication(process),
    )
    paths = with_record(output or [Path("marker.json" if spec.relief else "marker.pdf")])
    check_outputs(paths, choices, spec)
    targets = family_paths(paths, numbers) if numbers else paths
    for path in trace or []:
        check_trace_path(path)
    given = [camera, *(Path(text) for text in (template, boundary, poses, *shapes) if text)]
    inputs = [path for path in given if path]
    check_files([*targets, *(trace or ())], inputs)

    with console.progress_bar() as progress:
        found = find(spec, progress, traced=bool(trace))
    with console.busy("writing"):
        if numbers:
            written = save_family(members(found.marker, spec, numbers), paths, choices, inputs)
        else:
            written = save(found.marker, paths, choices, inputs)
        unit = OBJECTIVES[spec.objective].unit
        label = f"{spec.objective}, {unit}" if unit else spec.objective
        steps = {path: trace_bytes(found.trace, path.suffix, label) for path in trace or []}
        write_all(steps)
    for warning in found.warnings:
        console.complain(f"markergen: warning: {warning}")
    print(found.summary)
    console.print_criteria(found.criteria, spec.n, found.setting.noise_words)
    if spec.survive:
        console.print_hidden(
            hidden_dot_errors(found.marker.xyz, found.setting, spec.survive), found.setting.noise_words
        )
    console.print_effort(found.seconds)
    console.print_outputs([*written, *((path, ()) for path in steps)])
