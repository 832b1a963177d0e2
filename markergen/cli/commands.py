"""The commands: each declares its arguments, calls its library function, and prints the result."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from markergen import __version__
from markergen.cli import console
from markergen.cli.options import GroupedCommand, Rows, with_options
from markergen.cli.studio import studio
from markergen.options import VIEW
from markergen.options.calibration import CalibrateKeywords
from markergen.options.declarations import (
    CompareKeywords,
    DesignKeywords,
    DetectKeywords,
    ExportKeywords,
    RescaleKeywords,
    ValidateKeywords,
    VerifyKeywords,
)
from markergen.options.rig import RigKeywords
from markergen.options.study import StudyKeywords

Json = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as JSON; - is standard output.")
]
Report = Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write everything as one HTML page.")]

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def _version(wanted: bool) -> None:
    if wanted:
        print("markergen", __version__)
        raise typer.Exit


@app.callback(context_settings={"help_option_names": ["--help", "-h"]})
def markergen(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Design fiducial markers: the layout of control points that gives the most accurate pose, printed at true size,
    made as solids, and proved.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen validate marker.json
      markergen export marker.json -o marker.step
      markergen detect photos/ --marker marker.json --camera camera.yaml

    Lengths are meters, or carry a unit: 0.15, 150mm, 6in. Add --quiet to see
    nothing but errors, and --debug for the traceback of one.
    """


@app.command(cls=GroupedCommand)
@with_options(DesignKeywords)
def design(json: Json = None, **options: Any) -> None:
    """Find the best layout of control points, and write the marker; <stem>.json always comes with it.

    \b
    Example:
      markergen design --n 5 --radius 0.15 -o marker.pdf
      markergen design --n 8 --boundary plate.dxf --camera camera.yaml --poses flights.csv
      markergen design --n 6 --relief 20mm --mount 4xM4@240mm --dowel 2x4mm@260mm -o marker.step
    """
    from markergen.api.design import design as find

    options.setdefault("output", [Path("marker.json" if options.get("relief") else "marker.pdf")])
    with console.progress_bar() as progress:
        found = find(progress=progress, json=console.file_of(json), **options)
        if console.is_shown(json):
            found.certify(progress)
    console.print_found(found, json)


def _rig_suffixes() -> list[tuple[str, str]]:
    from markergen.exporters import RIG_EXPORTERS, catalog

    return [(" ".join(suffixes), words) for suffixes, words in catalog(RIG_EXPORTERS)]


def _shapes() -> list[tuple[str, str]]:
    from markergen.model.rig_shapes import FORMS, SHAPE_HELP

    return list(zip(FORMS, SHAPE_HELP, strict=True))


@app.command(cls=GroupedCommand)
@with_options(RigKeywords, listed={"Shapes": _shapes, "Suffixes for a rig": _rig_suffixes})
def rig(
    shape: Annotated[
        list[str] | None, typer.Argument(metavar="[SHAPE]", help="One of those above; or that of the --template.")
    ] = None,
    json: Json = None,
    **options: Any,
) -> None:
    """Design a body with a marker on every face, for one pose from all dots in view; <stem>.json always comes with it.

    \b
    Example:
      markergen rig cube --edge 80mm --n 6 -o cube.json
      markergen rig prism:6 --edge 60mm --height 80mm --without -z -o prism.json
      markergen rig wall 3x2 --pitch 0.5m --tag aruco:DICT_4X4_50 -o wall.json
      markergen rig --template cube -o cube.json -o cube.pdf
    """
    from markergen.api.rig import rig as find

    options.setdefault("output", [Path("rig.json")])
    with console.progress_bar() as progress:
        found = find(" ".join(shape or ()), progress=progress, json=console.file_of(json), **options)
    console.print_found(found, json)


@app.command(cls=GroupedCommand)
@with_options(ValidateKeywords)
def validate(
    marker: Annotated[
        Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design; or a rig.json.")
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: the camera of the design]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    report: Report = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write failed, worst and typical views as PNG.")
    ] = None,
    json: Json = None,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(metavar="EXPR", help="Exit with 1 if this holds, e.g. 'estimators.lm.rotation_deg.rms > 0.5'."),
    ] = None,
    **options: Any,
) -> None:
    """Prove a marker: homography and pose errors of every estimator over all poses with their bounds, then detection
    in synthetic views, and what limits the accuracy: image, print, or calibration.

    \b
    Example:
      markergen validate marker.json --report report.html --fail-if 'estimators.lm.rotation_deg.rms > 1'
    """
    from markergen.api.validate import validate as prove
    from markergen.validation.fail_if import parse

    for expression in fail_if or []:
        parse(expression)
    files: dict[str, Any] = {"json": console.file_of(json), "report": report, "pictures": pictures}
    with console.progress_bar() as progress:
        found = prove(marker, camera, progress=progress, **files, **options)
    console.print_found(found, json)
    verdicts = [found.check(expression) for expression in fail_if or []]
    for passed, said in verdicts:
        (console.note if passed else console.complain)(f"{'passed' if passed else 'FAILED'}: {said}")
    if not all(passed for passed, _ in verdicts):
        raise typer.Exit(console.FAILED)


def _processes() -> list[tuple[str, str]]:
    from markergen.model.fabrication import PROCESSES

    return [(name, PROCESSES[name].summary or PROCESSES[name].label) for name in PROCESSES]


def _suffixes() -> list[tuple[str, str]]:
    from markergen.exporters import catalog

    return [(" ".join(suffixes), words) for suffixes, words in catalog()]


@app.command(cls=GroupedCommand)
@with_options(
    ExportKeywords, listed={"Suffixes": _suffixes, "Processes": _processes, "Suffixes for a rig.json": _rig_suffixes}
)
def export(
    marker: Annotated[
        list[Path],
        typer.Argument(
            metavar="MARKER.JSON",
            help="As written by markergen design; several go on the same sheets of a .pdf. Or one rig.json.",
        ),
    ],
    output: Annotated[
        list[Path],
        typer.Option(
            "-o", "--output", metavar="PATH", help="Output file; its suffix selects the format; may be repeated."
        ),
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Write a marker at true size: a sheet to print, a drawing or solid to make, or configuration for detectors.

    \b
    Example:
      markergen export marker.json -o marker.step -o marker.svg
      markergen export marker.json -o marker.png --dpi 300 -o board.opencv.yaml
      markergen export marker.json -o cut.pdf --colors black,cut:CutContour
      markergen export marker.json -o marker.3mf --thickness 4mm --chamfer 0.5mm --mount 4xM3c@120mm
      markergen export marker.json -o marker.step -o marker.fab.pdf --process cnc --fit press --tool 3mm

    Options of the plate, from --thickness to --dowel, override marker.json.
    """
    from markergen.api.export import export as write
    from markergen.presentation.results import Files

    with console.busy("writing"):
        written = write(marker, *output, json=console.file_of(json), **options)
    console.print_found(Files(written), json)


@app.command(cls=GroupedCommand)
@with_options(DetectKeywords)
def detect(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGE...",
            help="Image files, folders of them, or patterns such as '*.png'; or one video, camera number such as 0, "
            "stream such as rtsp://..., or GStreamer pipeline.",
        ),
    ],
    marker: Annotated[
        list[Path], typer.Option(metavar="MARKER.JSON", help="Marker or rig to look for; may be repeated.")
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: none: pixels and homography]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the detections as JSON, of a video a line for each frame; - is standard output."
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(metavar="DIR|FILE.mp4", help="Write each image here, or the video, with its detections drawn in."),
    ] = None,
    **options: Any,
) -> None:
    """Find markers in images or a video: dot centers and pose T_camera_marker, with covariance, and homography.

    Status 1 if any image or frame has no marker, 2 if any image cannot be used; the others are processed regardless.

    \b
    Example:
      markergen detect photos/ --marker marker.json --camera camera.yaml --json found.json --overlay seen
      markergen detect walk.mp4 --marker marker.json --camera camera.yaml --json found.jsonl --overlay seen.mp4
      markergen detect 0 --marker marker.json --camera camera.yaml --json - | jq .markers[0].pose
    """
    from markergen.detect import kernel
    from markergen.detect.batch import detect_files
    from markergen.detect.video import detect_video
    from markergen.read.videos import is_video

    # While the progress bar is shown, it replaces the stream.
    stdout = sys.stdout
    to_stdout = console.is_stdout(json)
    options.update(json=stdout if to_stdout else json, overlay=overlay, warn=console.note)
    # Lines for people must not mix with data.
    options["tell"] = console.note if to_stdout else console.tell
    found: Any
    if any(map(is_video, images)):
        with nullcontext() if to_stdout and stdout.isatty() else console.status_line("waiting for a frame") as show:
            found = detect_video(images, marker, camera, show=show, **options)
    else:
        with console.progress_bar() as progress:
            found = detect_files(images, marker, camera, progress=progress, **options)
    if missing := kernel.missing():
        console.note(f"markergen: note: {missing}")
    raise typer.Exit(found.status)


def _contestants() -> Rows:
    from markergen.validation.contestants import listed

    return listed()


@app.command(cls=GroupedCommand)
@with_options(CompareKeywords, listed={"Contestants": _contestants})
def compare(
    contestants: Annotated[
        list[str],
        typer.Argument(metavar="A B...", help="In the forms above; one alone is compared with nine of them."),
    ],
    json: Json = None,
    plot: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the errors: .svg or .png.")] = None,
    **options: Any,
) -> None:
    """Compare markers with each other and with square tags and boards: same room, poses, optics and noise.

    \b
    Example:
      markergen compare marker.json
      markergen compare marker.json aruco:DICT_4X4_50:7 charuco:6x6 --views 400 --plot compare.svg
    """
    from markergen.api.compare import compare as run

    with console.progress_bar() as progress:
        found = run(*contestants, json=console.file_of(json), plot=plot, progress=progress, **options)
    console.print_found(found, json)


@app.command(cls=GroupedCommand)
@with_options(VerifyKeywords)
def verify(
    marker: Annotated[Path, typer.Argument(metavar="MARKER.JSON", help="Marker or rig that the files should contain.")],
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Sheets, solids and configurations, read by suffix.")
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Read files back with independent readers, and compare every dot with marker.json.

    The dots are aligned with the marker's by the best rotation and translation, never by a scale: dots that are scaled,
    mirrored, missing or from another marker are reported as such. In solids of a rig.json, its markers' places
    count too. Status 1 if a file is wrong, 2 if one cannot be used.

    \b
    Example:
      markergen verify marker.json marker.pdf marker.svg marker.png
      markergen verify marker.json marker.step marker.3mf marker.glb
      markergen verify rig.json cube.step cube.3mf cube.mjcf.xml
    """
    from markergen.api.verify import verify as read_back

    found = read_back(marker, *files, json=console.file_of(json), **options)
    console.print_found(found, json, found.findings())
    for error in filter(None, (check.error for check in found)):
        console.complain(f"markergen: error: {error}")
    if not found.usable:
        raise typer.Exit(console.UNUSABLE)
    if not found.passed:
        raise typer.Exit(console.FAILED)


@app.command(cls=GroupedCommand)
@with_options(RescaleKeywords)
def rescale(
    marker: Annotated[
        Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design; or a rig.json.")
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="PATH", help="The marker.json of this print; may be the same file."),
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Correct a marker for a print that came out at another size, by its rulers or by its dots.

    detect and validate then use the dot positions of the print.

    \b
    Example:
      markergen rescale marker.json --measured-x 198.6mm --measured-y 199.1mm -o printed.json
      markergen rescale marker.json --measured-points dots.csv -o printed.json
      markergen rescale rig.json --measured-x 99.4mm --also "+z=99.7mm" -o printed.json
    """
    from markergen.api.rescale import rescale as correct

    console.print_found(correct(marker, output, json=console.file_of(json), **options), json, ())


@app.command(cls=GroupedCommand)
@with_options(CalibrateKeywords)
def calibrate(
    marker: Annotated[
        Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design; or a rig.json.")
    ],
    photos: Annotated[
        list[str], typer.Argument(metavar="PHOTO...", help="Image files, folders of them, or patterns such as '*.jpg'.")
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: estimated from the photos, too]",
            rich_help_panel=VIEW,
        ),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="measured.json: the marker or rig as printed; camera.yaml: the camera; may be repeated.",
        ),
    ] = None,
    report: Report = None,
    json: Json = None,
    **options: Any,
) -> None:
    """Measure a print by ten to forty photographs of it: every dot's x, y and z with their joint covariance, and the
    camera if it is unknown.

    detect and validate then use the dots of the print. docs/calibrate.md says how to take the photographs. Status 1 if
    left-out photographs do not confirm what was measured, or it is no better than the design: the files are written.

    \b
    Example:
      markergen calibrate marker.json photos/ --camera camera.yaml -o measured.json --report calibration.html
      markergen calibrate marker.json photos/ --measured 0-2=244.1mm -o measured.json -o camera.yaml
      markergen calibrate marker.json photos/ --geometry nominal -o camera.yaml
      markergen calibrate cube.json photos/ --camera camera.yaml -o measured-cube.json
    """
    from markergen.api.calibrate import calibrate as measure

    with console.progress_bar() as progress:
        found = measure(
            marker, photos, camera, save=output or (), report=report, json=console.file_of(json),
            progress=progress, **options,
        )  # fmt: skip
    console.print_found(found, json)
    if said := found.closing(console.is_stdout(json)):
        (console.note if found.to_use else console.complain)(said)
    if not found.to_use:
        raise typer.Exit(console.FAILED)


@app.command(cls=GroupedCommand)
@with_options(StudyKeywords)
def study(
    what: Annotated[
        str,
        typer.Argument(
            metavar="paper|NAME|SPEC.toml",
            help="paper: the claims of the paper, measured. Otherwise a sweep: a TOML file with [study] and [grid], or "
            "one that is shipped: layouts.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for tables, figures and finished cells.")
    ],
    json: Json = None,
    **options: Any,
) -> None:
    """Reproduce the paper, or run any grid of designs, as one tidy table with figures and a page.

    The results do not depend on the number of workers or on where they run. After an interruption, --resume
    continues.

    \b
    Example:
      markergen study paper --scale 0.01 -o paper
      markergen study layouts -o layouts
      markergen study sweep.toml -o sweep --scheduler tcp://10.0.0.1:8786
    """
    from markergen.api.study import study as run

    try:
        with console.cells_progress() as progress:
            found = run(what, output, progress=progress, announce=console.note, json=console.file_of(json), **options)
    except KeyboardInterrupt:
        console.complain(f"markergen: finished cells remain in {output}; continue with the same command and --resume")
        raise
    console.print_found(found, json, ())


@app.command(cls=GroupedCommand)
def templates(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Print this template, to be edited.")] = None,
    json: Json = None,
) -> None:
    """List the ready-made specs with sizes, cameras and distances, or print one.

    \b
    Example:
      markergen templates desk-a4 > my.toml
      markergen design --template my.toml -o marker.pdf
    """
    from markergen.api.templates import overview
    from markergen.read.templates import template_text

    if name:
        print(template_text(name), end="")
        return
    console.print_found(overview(console.file_of(json)), json)


app.command(cls=GroupedCommand)(studio)
