"""All options, each declared once: name, type, unit, default, help and group.

The command-line options and their help, the keys of a spec file and their JSON Schema, and the keyword arguments of
`markergen.design`, `export`, `validate` and the others are all generated from these tables; a new option is a new
line. Each table is a ``TypedDict``, so type checkers know the keywords, too.
"""
# tests: tests/options/test_declared.py tests/options/test_reading.py

from typing import Annotated, TypedDict

from markergen.defaults import BLUR_PX, DARK, LIGHT, NOISE_GREY, NOISE_PX, PRINT_SIGMA_TEXT, RUNS, VIEWS
from markergen.options import DOTS, ERRORS, FILES, IMAGES, LAYOUT, RUN, SEARCH, SHEET, SOLID, TRIALS, VIEW, Option
from markergen.options.kinds import (
    Covariance,
    File,
    Files,
    IntOrAuto,
    Layout,
    Length,
    LengthOrAuto,
    LengthOrFit,
    ObjectiveLike,
    Poses,
    Settings,
    Shape,
    Shapes,
    Texts,
)
from markergen.options.shared import (
    Aggregate,
    BoundaryUnit,
    Calibrated,
    Camera,
    CameraInBody,
    IgnoreOpen,
    ImageSize,
    Layer,
    MadeKeywords,
    PlateKeywords,
    PosesAxes,
    PosesFrame,
    PosesUnit,
    Printed,
    ProcessKeyword,
    Restarts,
    Scaled,
    Seed,
    SheetKeywords,
    Time,
    Workers,
)


class DesignKeywords(SheetKeywords, ProcessKeyword, PlateKeywords, total=False):
    """Options of a design."""

    n: Annotated[
        IntOrAuto,
        Option(
            LAYOUT,
            "Number of control points, 4 to 200; auto is the fewest whose whole predicted error is within 5 % of the "
            "least, with --dot auto unless given.",
            5,
            metavar="N|auto",
        ),
    ]
    points: Annotated[
        Layout,
        Option(
            LAYOUT,
            "Dots to take as they are, instead of a search: centers in the marker frame, the key ring first; or a CSV "
            "file with the columns x, y and for a relief z, each with a unit as in x_mm.",
            metavar="X,Y;...|FILE.csv",
        ),
    ]
    target: Annotated[
        str,
        Option(
            LAYOUT,
            "Smallest disk within --radius, or else the boundary, and fewest dots with this RMS error at a distance, "
            "such as 0.1deg@1.5m or 1mm@1.5m.",
            metavar="ERROR@LENGTH",
        ),
    ]
    radius: Annotated[
        LengthOrFit,
        Option(
            LAYOUT,
            "Radius of a disk that contains all dots; fit: the largest that a page of --paper (default A4) holds.",
            "150mm",
            otherwise="the room is the page of --paper, or in the printer; in specs, and in Python without it, 150mm",
            metavar="LENGTH|fit",
        ),
    ]
    boundary: Annotated[
        Shape,
        Option(
            LAYOUT,
            "Instead of a disk: rect:200mmx100mm, page for all that a page of --paper holds, or outlines with holes "
            "from an SVG, DXF, GeoJSON or KiCad file.",
            metavar="SHAPE|FILE",
        ),
    ]
    boundary_unit: BoundaryUnit
    layer: Layer
    ignore_open: IgnoreOpen
    origin: Annotated[
        str,
        Option(
            LAYOUT,
            "Origin of the marker frame: center, of the smallest circle around the boundary, or file, that of the "
            "drawing.",
            "center",
            metavar="NAME",
        ),
    ]
    keep_out: Annotated[
        Shapes,
        Option(
            LAYOUT,
            "Region without dots: circle:3mm@40mm,-20mm, rect:40mmx40mm, or a drawing in the coordinates of the "
            "boundary's; may be repeated.",
            metavar="SHAPE|FILE[#LAYER]",
            aliases=("keep_outs",),
        ),
    ]
    relief: Annotated[Length, Option(LAYOUT, "Maximum height of the pillars that dots may stand on.", "0mm")]
    template: Annotated[
        File, Option(LAYOUT, "Start from a ready-made spec; see markergen templates.", metavar="NAME|FILE")
    ]
    camera: Camera
    image_size: ImageSize
    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "Camera poses: paper, paper-roll, cone:distance=0.4..1m,tilt=0..60,azimuth=-30..30, "
            "view:distance=0.4..1m,tilt=0..60, or a file of poses.",
            "paper",
            metavar="NAME|CONE|FILE",
        ),
    ]
    poses_frame: PosesFrame
    poses_axes: PosesAxes
    poses_unit: PosesUnit
    camera_in_body: CameraInBody
    noise_model: Annotated[
        str,
        Option(
            VIEW,
            "point: 1 px for every dot; image: predicted from the image of each dot in each pose.",
            otherwise="point; image with --print-sigma, --dot auto, --n auto and --target",
            metavar="NAME",
        ),
    ]
    image_noise: Annotated[
        Settings,
        Option(
            VIEW,
            "Image quality that --noise-model image and the size of the dots count on: standard deviations of the "
            "blur, px, and of the noise, grey levels, and these between dot and ground.",
            otherwise=f"blur_px={BLUR_PX:g},noise_grey={NOISE_GREY:g},contrast={LIGHT - DARK}",
            metavar="NAME=VALUE,...",
        ),
    ]
    print_sigma: Annotated[
        Length,
        Option(
            VIEW,
            "Standard deviation of a printed dot's position along each axis.",
            otherwise=f"{PRINT_SIGMA_TEXT} in the error to plan with, and in the search with --n auto and --target",
        ),
    ]
    scale_sigma: Annotated[
        float,
        Option(
            VIEW,
            "Standard deviation of the print's scale along x and y, for --n auto and --target: 0.001 is 0.1 %.",
            0,
            metavar="SHARE",
        ),
    ]
    camera_covariance: Annotated[
        Covariance,
        Option(
            VIEW,
            "Covariance of the camera's parameters for --n auto and --target, as for markergen validate.",
            otherwise="that in the camera's file, or an exact calibration",
            metavar="FILE",
        ),
    ]
    dot: Annotated[
        LengthOrAuto,
        Option(
            DOTS,
            "Dot diameter; auto minimizes the predicted error, see --print-sigma.",
            otherwise="as large as the camera needs",
            metavar="LENGTH|auto",
        ),
    ]
    clearance: Annotated[Length, Option(DOTS, "Smallest gap around dots.", otherwise="a tenth of --dot")]
    gap: Annotated[
        Length,
        Option(
            DOTS,
            "Smallest gap between dots, if larger than --clearance.",
            otherwise="--clearance, or what keeps images of dots apart, without --dot; 2 px with --n auto and --target",
        ),
    ]
    asymmetric: Annotated[
        float,
        Option(
            DOTS,
            "No key ring: the layout itself identifies the dots, as long as image errors stay below this.",
            0,
            metavar="PX",
        ),
    ]
    tag: Annotated[
        str,
        Option(
            DOTS,
            "A square tag in the middle that identifies the marker and its dots, such as aruco:DICT_4X4_50:7 or "
            "apriltag:36h11:3.",
            otherwise="none",
            metavar="FAMILY:ID",
        ),
    ]
    tag_size: Annotated[
        Length,
        Option(
            DOTS,
            "Side of the tag's black square, without its white edge.",
            otherwise="a third of the radius, or less",
            aliases=("tag_side",),
        ),
    ]
    ids: Annotated[
        str,
        Option(
            DOTS,
            "A family of markers with one layout and these ids instead of the tag's own: 0-9, or 0,3,7; on pages of "
            "one .pdf, with <stem>-<id>.json for each.",
            metavar="LIST",
        ),
    ]
    objective: Annotated[
        ObjectiveLike,
        Option(
            SEARCH,
            "What to minimize: pose, rotation, translation, homography, condition, or blunder, the largest error of a "
            "dot that no test notices; or a weighted sum, each relative to the regular n-gon's: 'pose + 0.5 rotation'; "
            "or with bounds: 'pose, rotation <= 1.05 ngon', 'pose, blunder <= 2mm'.",
            "pose",
            metavar="NAME",
        ),
    ]
    aggregate: Aggregate
    coordinates: Annotated[
        str,
        Option(
            SEARCH, "Coordinates for the objective condition: unit, metric, pixel, hartley.", "unit", metavar="NAME"
        ),
    ]
    survive: Annotated[
        int,
        Option(SEARCH, "Minimize the error after the worst loss of K dots, 1 to 3.", 0, metavar="K"),
    ]
    seed: Seed
    restarts: Restarts
    time: Time
    output: Annotated[
        Files,
        Option(
            FILES,
            "Output file; its suffix selects the format (.pdf .svg .png .dxf .step .stl .json and more, see markergen "
            "export); may be repeated.",
            otherwise="marker.pdf, with relief marker.json",
            metavar="PATH",
            flags="-o --output",
        ),
    ]
    trace: Annotated[
        Files,
        Option(
            FILES,
            "Write the steps of the search as .csv, as a plot .png, or as a movie .svg or .mp4; may be repeated.",
            metavar="FILE",
        ),
    ]
    coverage: Annotated[
        Files, Option(FILES, "Draw how many dots each pose sees, as .svg or .png; may be repeated.", metavar="FILE")
    ]


OUTSIDE_SPEC = ("template", "time", "output", "trace", "coverage")
"""Design options that a spec file does not have."""


class ExportKeywords(SheetKeywords, MadeKeywords, PlateKeywords, total=False):
    """Options of an export."""

    net: Annotated[
        bool,
        Option(
            SHEET,
            "Of a rig's body, a paper net with flaps, to fold and glue, on one page.",
            False,
            flags="--net",
        ),
    ]
    compensate: Annotated[
        bool,
        Option(
            SHEET,
            "Draw a rescaled marker so that the measured printer prints it as designed.",
            False,
            flags="--compensate",
        ),
    ]
    tolerance: Annotated[Length, Option(SOLID, "Maximum distance of a mesh from the true surface.", "5um")]
    material: Annotated[str, Option(SOLID, "Material in the drawing.", otherwise="to fill in", metavar="TEXT")]
    general_tolerance: Annotated[str, Option(SOLID, "General tolerances.", "ISO 2768-mK", metavar="TEXT")]
    datum: Annotated[
        str,
        Option(
            SOLID,
            "Datums in the drawing: holes by their names there, edge or rim, such as A=face,B=H1,C=H6.",
            otherwise="holes that locate, a bore and a hole, or edges",
            metavar="TEXT",
        ),
    ]
    hole: Annotated[
        Texts,
        Option(
            SOLID,
            "Tolerance classes of holes by their names in the drawing: H1:H7,H6:H7; may be repeated.",
            otherwise="H7 for dowels and drawn holes that are datums of a milled plate",
            metavar="TEXT",
        ),
    ]
    boundary_unit: BoundaryUnit
    ignore_open: IgnoreOpen


class ValidateKeywords(TypedDict, total=False):
    """Options of a validation, besides the marker and the camera."""

    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "paper, paper-roll, cone:tilt=0..60,distance=0.4..1m, view:distance=0.4..1m, or a file of poses.",
            otherwise="the poses of the design",
            metavar="NAME|CONE|FILE",
        ),
    ]
    poses_frame: PosesFrame
    poses_axes: PosesAxes
    poses_unit: PosesUnit
    camera_in_body: CameraInBody
    image_size: ImageSize
    runs: Annotated[int, Option(TRIALS, "Noisy trials for each pose; 0 gives the bounds alone.", RUNS)]
    noise: Annotated[
        float,
        Option(
            TRIALS,
            "Standard deviation on every image coordinate of the trials; what to plan with has the noise of images.",
            NOISE_PX,
            metavar="PX",
        ),
    ]
    trials_for_all: Annotated[
        bool,
        Option(TRIALS, "Run trials for the n-gon, square and random layouts, too.", False, flags="--trials-for-all"),
    ]
    views: Annotated[
        int,
        Option(IMAGES, "Synthetic images to find the marker in.", otherwise=f"{VIEWS}; 0 for bare points", metavar="N"),
    ]
    optics: Annotated[
        str, Option(IMAGES, "Optics of the views, such as blur_px=1.5,noise_grey=4.", metavar="KEY=VALUE,...")
    ]
    background: Annotated[
        str, Option(IMAGES, "Background of the marker: plain, clutter or photo.", "plain", metavar="NAME")
    ]
    hide: Annotated[int, Option(IMAGES, "Number of dots covered in each view.", 0)]
    stress: Annotated[
        bool,
        Option(IMAGES, "Repeat the views with blur, noise, low light, a hidden dot, clutter.", False, flags="--stress"),
    ]
    print_sigma: Printed
    scale_sigma: Scaled
    camera_covariance: Calibrated
    seed: Annotated[int, Option(RUN, "Seed for the noise; the same seed gives the same results.", 0)]
    workers: Workers


class VerifyKeywords(MadeKeywords, PlateKeywords, total=False):
    """Options of a verification, besides the marker and the files; those of solids are what a file was made with."""

    tolerance: Annotated[
        Length,
        Option(RUN, "Maximum deviation.", otherwise="20 um; a quarter of a pixel in a coarse PNG"),
    ]
    boundary_unit: BoundaryUnit
    ignore_open: IgnoreOpen
    unit: Annotated[str, Option(RUN, "Unit of a DXF that does not say it: mm, cm, m, in.", metavar="UNIT")]


class DetectorKeywords(TypedDict, total=False):
    """Options of a detector, besides the markers and the camera."""

    camera_covariance: Calibrated
    print_sigma: Printed
    scale_sigma: Scaled
    symmetric: Annotated[
        str,
        Option(RUN, "none, or any: of a layout with rotational symmetry, take any labeling.", "none", metavar="NAME"),
    ]
    smallest: Annotated[
        float,
        Option(
            RUN,
            "Diameter of the smallest dots to look for; large images take less time with larger ones.",
            0,
            metavar="PX",
        ),
    ]


class DetectKeywords(DetectorKeywords, total=False):
    """Options of a detection in images, videos and cameras."""

    deadline: Annotated[
        float, Option(RUN, "Seconds for one image, after which no further search is begun.", metavar="SECONDS")
    ]
    workers: Workers
    window: Annotated[
        bool,
        Option(
            RUN,
            "Show a video or camera with its detections; q or Esc ends it.",
            otherwise="where there is a display, unless --overlay is given",
            flags="--window/--no-window",
        ),
    ]
    smooth: Annotated[
        str,
        Option(
            RUN,
            "Filter the poses of a video over time, for a motion with accelerations of A m/s^2 and B rad/s^2, such as "
            "2,10.",
            metavar="A,B",
        ),
    ]
    readout: Annotated[
        str,
        Option(
            RUN,
            "Time from the first row of a frame to the last, of a rolling shutter: filtered poses are corrected by "
            "their velocities.",
            metavar="DURATION",
        ),
    ]


NEAR = "200, 150, 100, 50 or 20mm, if within 5 %"


class RescaleKeywords(TypedDict, total=False):
    """Measurements of a print, for rescaling."""

    measured_x: Annotated[Length, Option(ERRORS, "Measured length of the ruler along x.")]
    measured_y: Annotated[Length, Option(ERRORS, "Measured length of the ruler along y.", otherwise="as along x")]
    nominal_x: Annotated[Length, Option(ERRORS, "Length printed beside the ruler along x.", otherwise=NEAR)]
    nominal_y: Annotated[Length, Option(ERRORS, "Length printed beside the ruler along y.", otherwise=NEAR)]
    also: Annotated[
        Texts,
        Option(ERRORS, "Rulers of one marker of a rig, such as '+x=198.6mm,199.1mm'.", metavar="NAME=X[,Y]"),
    ]
    measured_points: Annotated[
        File,
        Option(
            ERRORS,
            "Measured dots: id,x,y[,sigma | ,sx,sy[,rho]]; meters, or units as in x_mm.",
            metavar="CSV",
        ),
    ]
    force: Annotated[bool, Option(ERRORS, "Accept a print that is 5 % off or more.", False, flags="--force")]
