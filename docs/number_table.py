"""Numbers of README and docs, and the commands that give them."""

from collections.abc import Callable, Sequence
from itertools import starmap

from docs.numbers import Block, Command, Entry, Number

README, CALIBRATE, CHOOSING, COMPARISON = "README.md", "docs/calibrate.md", "docs/choosing.md", "docs/comparison.md"
DESIGN, DETECT, ERROR, HANDEYE = "docs/design.md", "docs/detect.md", "docs/error.md", "docs/handeye.md"
OBJECTIONS, PAPER, RESULTS, RIGS = "docs/objections.md", "docs/paper.md", "docs/results.md", "docs/rigs.md"
THEORY, VALIDATE = "docs/theory.md", "docs/validate.md"

THIS, NGON = "this marker @ # @ @ @", "regular ...-gon @ # @ @ @"
POSE, POSE_NGON = "this marker # @ @ @ @", "regular ...-gon # @ @ @ @"


def _design(options: str, seconds: float) -> Command:
    room = "" if "--paper" in options else "--radius 0.15 "
    return Command(f"markergen design {room}{options} --details -o marker.json", seconds)


FOUR, FIVE, SIX, EIGHT = (_design(f"--n {n}", 4) for n in (4, 5, 6, 8))
HOMOGRAPHY = _design("--n 4 --objective homography", 5)
CONDITION = _design("--n 6 --objective condition", 10)
VALIDATED = Command(f"{FIVE.line} && markergen validate marker.json --runs 2 --views 0 --details", 8)
RELIEF_20, RELIEF_50 = (
    _design(f"--n 6 --dot 0 --clearance 0 --relief {height}mm --objective rotation", 8) for height in (20, 50)
)
ONE_SIDED = [Command(f"python examples/one_sided_camera.py {n}", 10) for n in range(4, 9)]
EPNP, DOT_BOUND = Command("python -m benchmarks.epnp", 4), Command("python -m benchmarks.dot_bound", 1)
SPEED = Command("python -m benchmarks.detection --only sizes --sizes 640x480", 120)
IN_ROOMS = Command(
    "python -m benchmarks.shapes --beside pose rotation translation homography --shapes disk rectangle L flange "
    "--n 5 10 20 60 --starts 0",
    900,
)
ROOMS = ("disk", "rectangle", "L")
IN_VIEWS = "python -m benchmarks.dot_count --rooms {} --cameras {} --views 100"
COUNTED = {
    (room, camera): Command(IN_VIEWS.format(room, camera), 150) for camera in ("paper", "hd", "lens") for room in ROOMS
}
RIVALS = {
    room: Command(
        f"{IN_VIEWS.format(room, 'paper')} --rivals circles:5x5 circles:7x7 circles:9x9 checkerboard:9x9 charuco:5x5 "
        "aruco:DICT_4X4_50 apriltag:36h11 pupil:36h11 stag:HD21",
        1800,
    )
    for room in ROOMS
}
BESIDE_AUTO = f"{IN_VIEWS.format(' '.join(ROOMS), 'paper')} --rivals"
CLOSEST = Command("python -m benchmarks.dot_count --rooms disk --cameras paper --views 400 --rivals circles:9x9", 200)
CONTESTANTS = {
    "auto dots": "`--n auto`",
    "5 dots": "5 dots",
    "circles:5x5": "5 x 5 circles",
    "circles:7x7": "7 x 7 circles",
    "circles:9x9": "9 x 9 circles",
    "checkerboard:9x9": "checkerboard of 9 x 9 squares",
    "charuco:5x5": "ChArUco 5 x 5",
    "aruco:DICT_4X4_50": "ArUco 4x4",
    "apriltag:36h11": "AprilTag 36h11, OpenCV",
    "pupil:36h11": "AprilTag 36h11, AprilTag 3",
    "stag:HD21": "STag HD21",
}
"""Rows of the table of rivals by their names in the command's output, in its order."""
RANGES = Command("python -m benchmarks.ranges", 240)
CALIBRATED = Command("python -m benchmarks.calibration", 900)
HAND_EYE = Command("python -m benchmarks.handeye", 200)
STEREO = Command("python -m benchmarks.stereo", 60)
LENSES = Command("python -m benchmarks.lens_claims --sets 1000", 1200)
RIG_BENCH = Command("python -m benchmarks.rigs", 900)
BLURRED = Command("python -m benchmarks.detection_quality blurred", 60)
COVERAGE = Command("python -m benchmarks.detection_quality coverage", 1200)
SMALL = Command("python -m benchmarks.detection_quality small", 60)
COMPARED = Command(f"{FIVE.line} && markergen compare marker.json", 1200)
FMAC = Command(
    "python -c \"from markergen.comparison.fmac import CAMERA; CAMERA.save('webcam.yaml')\" && "
    "markergen design --boundary rect:50mmx50mm --n auto --camera webcam.yaml "
    "--poses view:distance=0.5..1.5m,tilt=0..60,margin=0% -o ours.json && "
    "markergen compare ours.json aruco:DICT_4X4_50 pupil:36h11 stag:HD21 --protocol fmac --views 10000 --parts parts "
    "--plot fmac.png",
    10000,
)
MISPRINTED = Command(
    "markergen design --n 5 --radius 0.15 -o five.json && markergen design --n auto --radius 0.15 -o many.json && "
    "markergen compare five.json many.json circles:7x7 "
    "charuco:5x5 checkerboard:9x9 aruco:DICT_4X4_50 apriltag:36h11 --print-sigma 0.1mm --views 100",
    500,
)
FIGURES = {
    CHOOSING: Command("python -m docs.figures choosing -o .", 260),
    ERROR: Command("python -m docs.figures error -o .", 180),
    HANDEYE: Command("python -m docs.figures handeye -o .", 3),
    THEORY: Command("python -m docs.figures theory -o .", 20),
}
STUDY = "markergen study paper -o paper"
STUDIED = Command(f"{STUDY} && cat paper/claims.md paper/joint.csv paper/claims.csv", 2200)


SIDED = "--n 5 --dot 10mm --poses cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,roll=0"
SIDED_POSE, SIDED_LOOSE, SIDED_TIGHT = (
    _design(f"{SIDED} --objective '{objective}'", seconds)
    for objective, seconds in (("pose", 4), ("pose, rotation <= 1.05 ngon", 20), ("pose, rotation <= ngon", 30))
)


def _sided(row: str, command: Command, output: str = "this marker # # @ # @") -> Number:
    return Number(
        DESIGN, f"| {row} | # | # | # |", "markergen design --n 5 --radius 0.15 --dot 10mm", [(command, output)]
    )


def _in_three_rooms() -> Number:
    """Errors and shares of the views in which rivals are found, in three rooms."""
    rows = " ".join(f"| {row} | # deg, # % | # deg, # % | # deg, # % |" for row in CONTESTANTS.values())
    return Number(
        DESIGN,
        f"| paper | {' | '.join(ROOMS)} | |---|---|---|---| {rows}",
        BESIDE_AUTO,
        [(RIVALS[room], f"{name} #/@ # @ to @") for name in CONTESTANTS for room in ROOMS],
        lambda *results: [value for k in range(0, len(results), 2) for value in (results[k + 1], results[k])],
    )


def _counted(room: str, camera: str) -> Number:
    command, errors = COUNTED[room, camera], "# | # | # | # | # | #"
    sources = [(command, f"{room} {camera} # # @ # # @"), (command, f"{room} {camera} 5 @ @ # # @")]
    return Number(
        DESIGN, f"| {room}, {camera} | {errors} |", IN_VIEWS.format(" ".join(ROOMS), "paper hd lens"), sources
    )


def _in_room(room: str, n: int) -> Sequence[Number]:
    """Designs beside regular layouts and above the lower bound, which depends on the machine as times do."""
    rows = [f"{room} {n} {objective} rms" for objective in ("pose", "rotation", "translation", "homography")]
    place, named = f"| {room}, {n} |", "python -m benchmarks.shapes --beside"
    return (
        Number(
            DESIGN,
            f"{place} {'#, @ % | ' * 4}@ |",
            named,
            [(IN_ROOMS, f"{row} # ... @ @") for row in rows],
        ),
        Number(
            DESIGN,
            f"{place} {'@, # % | ' * 4}@ |",
            named,
            [(IN_ROOMS, f"{row} @ ... # @") for row in rows],
            lambda *bounds: [100 * (bound - 1) for bound in bounds],
            factor=2.0,
        ),
        Number(
            DESIGN,
            f"{place} {'@, @ % | ' * 4}# |",
            named,
            [(IN_ROOMS, f"{row} @ ... @ #") for row in rows],
            lambda *seconds: [sum(seconds)],
            factor=3.0,
        ),
    )


def _ranged(row: str) -> Number:
    output = f"| {row} | 0.3 to 10 | # | # | # | @ | # | # |"
    return Number(DESIGN, f"| {row} | # | # | # | # | # |", RANGES.line, [(RANGES, output)])


PLAN = (
    "Plan with # deg and # mm at up to @ m, scale and calibration exact; "
    "measure the marker with twenty photographs (markergen calibrate): # deg"
)


def _planned(options: str, seconds: float) -> Number:
    command = f"markergen design --paper A4{options}"
    return Number(
        README, f"| `{command}` | # deg, # mm | # deg |", command, [(_design(f"--paper A4{options}", seconds), PLAN)]
    )


def _table_row(n: int, command: Command) -> Number:
    # With four dots the square is the regular polygon, whose row has it.
    output = f"{THIS} {NGON} ... random, median @ # @ @ @"
    return Number(RESULTS, f"| {n} | # | # | # |", "markergen design --n 5 --radius 0.15", [(command, output)])


def _asymmetric() -> Number:
    return Number(
        DESIGN,
        "That costs little: # % of the pose error for 5 dots, # % for 6, # % for 8",
        "markergen design --n 5 --radius 0.15",
        [
            source
            for n, command in ((5, FIVE), (6, SIX), (8, EIGHT))
            for source in ((_design(f"--n {n} --asymmetric 3", 60), POSE), (command, POSE))
        ],
        lambda a5, b5, a6, b6, a8, b8: [100 * (a5 / b5 - 1), 100 * (a6 / b6 - 1), 100 * (a8 / b8 - 1)],
    )


def _cube(row: str, label: str, time: str = "@") -> Number:
    """Errors of a cube's pose; processor times are those of one machine."""
    place = f"| {row} | # | # | #, # | # | {time} |"
    return Number(RIGS, place, "python -m benchmarks.rigs", [(RIG_BENCH, f"{label} @ # # # # @ @ #")])


def _speed(row: str, label: str) -> Number:
    """Processor time and errors of a detector, on other machines and before other photographs."""
    return Number(
        DETECT,
        f"| {row} | # | #, # |",
        "python -m benchmarks.detection",
        [(SPEED, f"{label} @ @ @ # # #")],
        lambda median, most, milliseconds: [milliseconds, median, most],
        factor=3.0,
    )


def _pattern(row: str, label: str) -> Number:
    """Bound of a contestant's pattern."""
    return Number(COMPARISON, f"| {row} | # |", "markergen compare marker.json", [(COMPARED, f"{label} @ cm2 #")])


def _set(phrase: str, seconds: int) -> Number:
    """Errors of a contestant with settings that are named."""
    command = Command(f"python -m benchmarks.setting {phrase}", seconds)
    sources = [(command, "detector # of 100, rms #, median #")]
    row = f"| `{command.line}` | # | # | # |"
    return Number(OBJECTIONS, row, command.line, sources, lambda finding, rms, median: [rms, median, finding])


def _fitted(phrase: str, seconds: int) -> Number:
    """Errors of a contestant with settings that are named, and after the same refiner for all."""
    command = Command(f"python -m benchmarks.setting {phrase} --fit", seconds)
    sources = [(command, f"{part} @ of 100, rms #, median @") for part in ("detector", "fit")]
    return Number(OBJECTIONS, f"| `{command.line}` | # | # |", command.line, sources)


def _beside(row: str, label: str, command: Command) -> Number:
    """Errors and share of views of a contestant on the page of other tools."""
    return Number(
        COMPARISON,
        f"| {row} | # (# to #) | # | # % |",
        command.line.rpartition(" && ")[2],
        [(command, f"{label} # % # #–# #")],
        lambda result, rms, low, high, median: [rms, low, high, median, result],
    )


def _calibrated(row: str, case: str) -> Number:
    sources = [(CALIBRATED, f"{n} 20 {case}: # +- @ deg, @ mm") for n in (5, 24)]
    return Number(CALIBRATE, f"| {row} | # deg | # deg |", CALIBRATED.line, sources)


def _hand_eye(camera: str, mounting: str, place: str) -> Number:
    label = {"exact": "exact", "covariance": "with its covariance", "unknown": "unknown"}[camera]
    row = f"| {label} | {mounting} | # mm | # deg | # | # |"
    return Number(HANDEYE, row, HAND_EYE.line, [(HAND_EYE, f"{place}, camera {camera} # # # #")])


def _all_found() -> Number:
    """Smallest dots of which all markers are found, with a key ring and without."""
    sizes = (2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0)

    def least(results: Sequence[float]) -> float:
        return next(size for k, size in enumerate(sizes) if min(results[k:]) == 100)

    return Number(
        DETECT,
        "all found from # px on, those without from # px",
        SMALL.line,
        [(SMALL, f"{size:.1f} px, {kind} 50 #") for kind in ("ring", "no ring") for size in sizes],
        lambda *results: [least(results[: len(sizes)]), least(results[len(sizes) :])],
    )


MACHINES = 1.05
"""Share by which a number of the study of the paper may differ: rounding of the linear algebra of a machine decides in
which of equally good optima a few descents end."""


def _paper(place: str, tests: Sequence[str], compute: Callable[..., Sequence[float]] | None = None) -> Number:
    """Place with values of single tests, each a claim with its setting and what it measures."""
    rows = [(STUDIED, f'{test.rpartition(",")[0]},"{test.rpartition(",")[2].replace(";", ",")}",#') for test in tests]
    return Number(PAPER, place, STUDY, rows, compute, MACHINES)


def _ippe(noise: str, numbers: Sequence[int], at: str = "") -> list[str]:
    return [f"IPPE equals LM,metric,{noise},rotation_deg; ippe over lm; n = {n}{at}" for n in numbers]


POSE_ERRORS = ("rotation_deg", "translation_pct")


def _poor(coordinates: str, layouts: str) -> list[str]:
    test = f"good start,{coordinates},4,rotation_deg; lm from poor starts over lm from the dlt; {layouts} layouts"
    return [f"{test}; n = {n}" for n in range(4, 9)]


def _extremes(*values: float) -> Sequence[float]:
    return [min(values), max(values)]


def _percents(*shares: float) -> Sequence[float]:
    return [100 * share for share in _extremes(*shares)]


def _middle(*values: float) -> Sequence[float]:
    return [sum(_extremes(*values)) / 2]


MEASURED: Sequence[Entry] = (
    *(_planned(options, seconds) for options, seconds in (("", 4), (" --n 20", 12), (" --camera phone", 10))),
    Number(
        README,
        "| `markergen design --radius 0.15`, on A2 | # deg, # mm | # deg |",
        "markergen design --radius 0.15",
        [(FIVE, PLAN)],
    ),
    _table_row(4, FOUR),
    _table_row(5, FIVE),
    _table_row(8, EIGHT),
    Number(
        RESULTS,
        "the homography's error of four dots is # px if the square has its corners on the diagonals, and # px if",
        "`--objective homography`",
        [(HOMOGRAPHY, "this marker @ @ @ # @ regular 4-gon @ @ @ # @")],
    ),
    Number(
        RESULTS,
        "from six dots on, c(A) is smaller with one of them in the middle, # instead of #",
        "`--objective condition`",
        [(CONDITION, "this marker @ @ @ @ # regular 6-gon @ @ @ @ #")],
    ),
    Number(
        RESULTS,
        "the expected displacement is # to # % below that of the polygon",
        "python examples/one_sided_camera.py",
        [(command, "mm, # % less") for command in ONE_SIDED],
        lambda *less: [min(less), max(less)],
    ),
    Number(
        RESULTS,
        "rotation is # to # % worse than the polygon's",
        "python examples/one_sided_camera.py",
        [(command, "rotation: # times") for command in ONE_SIDED],
        lambda *times: [100 * (min(times) - 1), 100 * (max(times) - 1)],
    ),
    Number(
        RESULTS,
        "the homography # to # times as far off",
        "python examples/one_sided_camera.py",
        [(command, "homography: # times") for command in ONE_SIDED],
        lambda *times: [min(times), max(times)],
    ),
    Number(
        RESULTS,
        "A print error of @ mm costs # deg, the noise of the image #. A calibration off by @ px in fx and fy and @ px "
        "in the principal point costs more: the error is # times as large with both",
        "`validate marker.json`",
        [
            (VALIDATED, "rotation, deg # # @ @"),
            (VALIDATED, "would err # and @ times as much"),
        ],
        lambda image, print_, times: [print_, image, times],
    ),
    Number(
        RESULTS,
        "lower the rotation bound of six control points from # deg to # or # deg",
        "--relief 50mm --objective rotation",
        [(RELIEF_20, "this marker @ # @ - - best without relief @ #"), (RELIEF_50, "this marker @ # @ - -")],
        lambda low, flat, high: [flat, low, high],
    ),
    *(
        _pattern(row, label)
        for row, label in (
            ("5 designed dots", "marker.json"),
            ("5 x 5 circles", "circles:5x5"),
            ("ArUco 4x4", "aruco:DICT_4X4_50"),
            ("AprilTag 36h11", "apriltag:36h11"),
            ("checkerboard of 9 x 9", "checkerboard:9x9"),
            ("ChArUco 5x5", "charuco:5x5"),
        )
    ),
    Number(
        COMPARISON,
        "reaches the bound of its dots: # deg RMS (# to #)",
        "markergen compare marker.json",
        [(COMPARED, "marker.json @ % # #–# @")],
    ),
    _set("checkerboard:9x9", 10),
    _set('checkerboard:9x9 "then cornerSubPix, half window 0.5 of the spacing"', 12),
    _set('pupil:36h11 "quad_decimate 1, quad_sigma 0.8" "image x2"', 20),
    _set('pupil:36h11 "quad_decimate 1, quad_sigma 0.8" "image x4"', 45),
    _fitted("ngon:5", 30),
    _fitted('aruco:DICT_4X4_50 CONTOUR "image x4"', 20),
    _fitted('charuco:5x5:0.75 SUBPIX "image x2"', 30),
    _fitted('circles:5x5 "our correction of the centers for perspective"', 50),
    _fitted('stag:HD21 "image x3"', 40),
    _fitted('checkerboard:9x9 "then cornerSubPix, half window 0.5 of the spacing"', 40),
    _fitted('pupil:36h11 "quad_decimate 1, quad_sigma 0.8" "image x4"', 70),
    _sided("`pose`", SIDED_POSE),
    _sided("`pose, rotation <= 1.05 ngon`", SIDED_LOOSE),
    _sided("`pose, rotation <= ngon`", SIDED_TIGHT),
    _sided("(regular pentagon)", SIDED_POSE, "regular 5-gon # # @ # @"),
    Number(
        DESIGN,
        "a loss of @ % leaves # of # %",
        "markergen design --n 5 --radius 0.15 --dot 10mm",
        [(SIDED_LOOSE, "this marker # @ @ @ @"), (SIDED_POSE, POSE), (SIDED_POSE, "regular 5-gon # @ @ @ @")],
        lambda loose, pose, ngon: [100 * (1 - loose / ngon), 100 * (1 - pose / ngon)],
    ),
    _asymmetric(),
    Number(
        VALIDATE,
        "in # % of the paper's poses, and in # % of them with random roll",
        EPNP.line,
        [(EPNP, "paper a single call @ @ #% "), (EPNP, "paper-roll a single call @ @ #%")],
    ),
    Number(
        VALIDATE,
        "its rotation error is # deg RMS where that of the better call is #",
        EPNP.line,
        [(EPNP, "paper a single call # @ @% paper epnp #")],
    ),
    Number(PAPER, "instead of the layout: # deg RMS", EPNP.line, [(EPNP, "paper a single call #")]),
    *(_ranged(row) for row in ("pad", "nested AprilTags 36h11", "ArUco 4x4")),
    *(entry for room in ("disk", "rectangle", "L", "flange") for n in (5, 10, 20, 60) for entry in _in_room(room, n)),
    _in_three_rooms(),
    Number(
        DESIGN,
        "the intervals are # to # deg (@ %) for the dots and # to # for the circles",
        BESIDE_AUTO,
        [(RIVALS["disk"], "auto dots @/@ @ # to #"), (RIVALS["disk"], "circles:9x9 @/@ @ # to #")],
    ),
    Number(
        DESIGN,
        "the dots have # deg (# to #) and the circles # (# to #)",
        CLOSEST.line,
        [(CLOSEST, "auto dots @/@ # # to #"), (CLOSEST, "circles:9x9 @/@ # # to #")],
    ),
    Number(
        DESIGN,
        "All that the grey levels give is # deg for the dots in the disk and the paper's camera, and # for",
        BESIDE_AUTO,
        [
            (RIVALS["disk"], "auto dots @/@ @ @ to @ @ #"),
            (RIVALS["disk"], "charuco:5x5 @/@ @ @ to @ @ #"),
        ],
    ),
    *starmap(_counted, COUNTED),
    Number(VALIDATE, "it is # px per axis", DOT_BOUND.line, [(DOT_BOUND, "radius 10 px: # px")]),
    Number(
        DETECT,
        "Of dots of @ px (the root of long times short axis) # % are located alone, of those of @ px # %",
        SMALL.line,
        [(SMALL, "2.5 px, ring 50 @ @ @ @ #"), (SMALL, "5.0 px, ring 50 @ @ @ @ #")],
    ),
    _all_found(),
    Number(
        DETECT,
        "# % in clean images lie within the region of 95 %, # % with the edge of a shadow on the marker, "
        "# % under highlights that saturate, # % behind motion blur of 1 to 5 px, and # % after",
        COVERAGE.line,
        [(COVERAGE, f"{name} 2000 @ @ @ @ #") for name in ("clean", "shadow", "highlight", "motion", "jpeg")],
    ),
    Number(
        DETECT,
        "the median error of a center is # px at 3 px and # px at 7 px",
        SMALL.line,
        [(SMALL, "3.0 px, ring 50 @ @ #"), (SMALL, "7.0 px, ring 50 @ @ #")],
    ),
    Number(
        DETECT,
        f"| blur | # px | # px | # px | # px | # px | # px | {'|---' * 7}| {'| # px | # | # | # | # | # | # | ' * 6}",
        BLURRED.line,
        [(BLURRED, f"to @ diameters apart {'# px ' * 6} {'blur # px # # # # # # ' * 6}")],
    ),
    Number(
        DETECT,
        "at least # % are found behind any blur of # to # px and from # px on",
        BLURRED.line,
        [(BLURRED, f"blur and diameter, 2 diameters apart {'# px ' * 6} {'blur # px # # # # # # ' * 6}")],
        lambda *found: [min(share for k, share in enumerate(found[6:]) if k % 7), found[6], found[-7], found[0]],
    ),
    Number(
        DETECT,
        "that are only # to # diameters apart",
        BLURRED.line,
        [(BLURRED, "found % by blur and diameter, # to # diameters apart")],
    ),
    Number(
        DETECT,
        "blur_px=2` takes # px along",
        "markergen design --radius 0.15 --image-noise blur_px=2",
        [(_design("--image-noise blur_px=2", 4), "its image is at least # px across")],
    ),
    _speed("marker with key ring, of 5 dots", "markergen, ring"),
    _speed("the same, near the pose of the frame before", "markergen, ring, tracking"),
    _speed("marker without ring, of 8 dots", "markergen, no ring"),
    _speed("cv2.aruco, corners refined to subpixels", "cv2.aruco, subpixel"),
    _speed("the same in its fast mode", "cv2.aruco, subpixel, fast"),
    _speed("pupil-apriltags", "pupil-apriltags, quad_decimate=2"),
    _speed("cv2.findCirclesGrid", "cv2.findCirclesGrid"),
    Number(
        DETECT,
        "with one marker takes about # ms",
        "#how-fast-how-accurate",
        [(SPEED, "markergen, ring @ @ @ @ @ #")],
        factor=3.0,
    ),
    _paper("errs # times as much as LM with five to eight points", _ippe("4", range(5, 9)), _middle),
    _paper("In frontal views it is # to # times", _ippe("4", range(5, 9), "; at 0 deg"), _extremes),
    _paper("at 1 px # to # times, and", _ippe("1", range(5, 9), "; at 0 deg"), _extremes),
    _paper("at 0.2 px # to # times;", _ippe("0.2", range(5, 9), "; at 0 deg"), _extremes),
    _paper(
        "or 70 degrees it is # to # times at 4 px",
        [*_ippe("4", range(5, 9), "; at 52.5 deg"), *_ippe("4", range(5, 9), "; at 70 deg")],
        _extremes,
    ),
    _paper("With four points it is # times,", _ippe("4", [4])),
    _paper("it is # times, at 1 and", ["IPPE equals LM,metric,4,rotation_deg; ippe over lm; square-like layouts"]),
    _paper(
        "0.2 px # times.",
        [f"IPPE equals LM,metric,{noise},rotation_deg; ippe over lm; square-like layouts" for noise in ("1", "0.2")],
        _middle,
    ),
    _paper(
        "it errs # to # times as much at 4 px",
        [f"methods converge,metric,4,rotation_deg; epnp over lm; n = {n}" for n in range(4, 9)],
        _extremes,
    ),
    _paper(
        "and # to # times at 1 px.",
        [f"methods converge,metric,1,rotation_deg; epnp over lm; n = {n}" for n in range(4, 9)],
        _extremes,
    ),
    _paper(
        "# to # % of its gain is left",
        [
            "initial guess,metric,4,rotation_deg; share of lm's gain that is left if it starts from the true pose; "
            f"n = {n}"
            for n in range(4, 9)
        ],
        _percents,
    ),
    _paper(
        "of its gain from the DLT's pose # to # %",
        [
            "initial guess,metric,4,rotation_deg; share of lm's gain from the dlt that is left if it starts from the "
            f"true pose; n = {n}"
            for n in range(4, 9)
        ],
        _percents,
    ),
    _paper(
        "Nine random ones they beat in # to # % of the poses",
        [
            f"always better,metric,4,share of poses; {error}; random 9 over optimized 4"
            for error in ("dlt he_px2", *(f"{by} {of}" for by in ("epnp", "ippe", "lm") for of in POSE_ERRORS))
        ],
        _percents,
    ),
    _paper("its rotation errs # to # times as much on optimized layouts", _poor("metric", "optimized"), _extremes),
    _paper("from the DLT's pose, and # to # times on random ones", _poor("none", "random"), _extremes),
    _paper(
        "LM from there errs # times as much as from the true pose",
        ["start of the DLT,metric,4,rotation_deg; lm from the dlt over lm from the truth; optimized layouts; n = 4"],
    ),
    Number(
        PAPER,
        "the rotation bound of six points is # deg as the regular hexagon, which the pose objective finds, # deg as "
        "the best layout by c(A) in unit coordinates, # deg as a random one, and with relief # deg (@ mm) and # deg",
        STUDY,
        [(STUDIED, f"{name},6,@,@,@,@,#") for name in ("ngon", "unit", "random")]
        + [(STUDIED, f"relief-{height},6,1,@,,,#") for height in (20, 50)],
    ),
    _calibrated("the dots as designed", "as designed"),
    _calibrated("measured dots, camera known", "camera known"),
    _calibrated("the same, @ % of the dots false by @ to @ px", "camera known, 5 % of false dots"),
    _calibrated("measured dots, camera estimated from the same photographs", "camera unknown"),
    _calibrated("the same, and the estimated camera used as well", "camera unknown, and used"),
    *(
        Number(
            CALIBRATE,
            f"| {row} | # deg | # mm | # | # | # deg, # mm |",
            STEREO.line,
            [(STEREO, f"{camera} # # # # # #")],
        )
        for camera, row in (("exact", "exact"), ("covariance", "with their covariance"), ("unknown", "unknown"))
    ),
    *(
        Number(CALIBRATE, f"| {lens} | # | # | # |", LENSES.line, [(LENSES, f"{lens} # @ @ # # @")])
        for lens in ("none", "radtan, weak", "radtan, strong", "rational", "equidistant", "all")
    ),
    *(
        _hand_eye(camera, *setting)
        for setting in (("eye-in-hand", "on the hand"), ("eye-to-hand", "beside"))
        for camera in ("exact", "covariance", "unknown")
    ),
    Number(
        HANDEYE,
        "its five methods*, camera exact | eye-in-hand | # mm | # deg |",
        HAND_EYE.line,
        [(HAND_EYE, "on the hand, camera exact @ @ @ @ OpenCV, Tsai @ @ OpenCV, Park # #")],
    ),
    _cube("all faces, exact print", "this cube, print exact"),
    _cube("its best face alone, exact print", "its best face alone, print exact", "-"),
    _cube("all faces, print good to 0.1 mm", "this cube, print 0.1 mm"),
    _cube("its best face alone, print good to 0.1 mm", "its best face alone, print 0.1 mm", "-"),
    _cube("ArUco tags by cv2.aruco, exact print", "cv2.aruco, all corners, exact"),
    *(
        _beside(row, label, command)
        for command, row, label in (
            (MISPRINTED, "64 designed dots, `--n auto`", "many.json"),
            (MISPRINTED, "5 designed dots", "five.json"),
        )
    ),
    *(
        Block(file, f"<!-- {name} -->", "<!-- end -->", FIGURES[file].line.removesuffix(" -o ."), FIGURES[file])
        for file, names in (
            (CHOOSING, ("room", "number", "size", "print", "relief")),
            (ERROR, ("dots", "bias", "tilt", "distance", "example")),
            (THEORY, ("condition", "another")),
        )
        for name in names
    ),
    Block(COMPARISON, "10000 poses:\n\n```text\n", "```", FMAC.line.rpartition(" && ")[2], FMAC),
    Block(PAPER, "<!-- sentences -->", "<!-- end -->", STUDY, STUDIED),
    Block(PAPER, "<!-- claims -->", "<!-- end of claims -->", STUDY, STUDIED, MACHINES),
)
"""Places whose numbers are compared, by file."""
