"""Numbers of README and docs that no command gives, and what each is."""

from collections.abc import Mapping, Sequence

from docs.numbers import Given

DEFAULT = "a default or a limit of the program"
SETTING = "a condition of the numbers beside it"
STANDARD = "a standard, a product's version, or a law of geometry"
MEANING = "what a word means here"
EXAMPLE = "an example of what to type, or of a size"
UPPER = "an upper limit, of fewer settings than there are now"

PLACES: Mapping[str, Mapping[str, Sequence[str]]] = {
    "docs/calibrate.md": {
        DEFAULT: [
            "was read, # mm unless given",
            "move by less than # % of the picture's diagonal, # px of",
            "to be off by # % along x and y",
            "expected error by less than # %, at forty",
        ],
        EXAMPLE: ["by 20 to # degrees"],
        MEANING: ["within # sigmas (#)", "# % of rows are within # (centers), # (dots) and # (camera) of #."],
        SETTING: [
            "Photographs of # dots of # to # px behind lenses, # a set",
            "off by # mm along each axis, # % longer along x and bulging by # mm, in",
            "Simulated pairs, # mm apart, in 12 moments of 12 dots measured to # px",
            "hand-held photographs with dots measured to # px",
            "the same, # % of the dots false by # to # px",
        ],
    },
    "docs/handeye.md": {
        EXAMPLE: ["by 20 to # degrees"],
        SETTING: [
            "err by # mm and # deg along each axis",
            "measured to # px, and a print off by # mm, # % longer along x and bulging by # mm",
        ],
        MEANING: ["within # sigmas (#)"],
    },
    "docs/ros2.md": {
        STANDARD: [
            "| Humble, Ubuntu # | #, # |",
            "| Jazzy, Ubuntu # | #, # |",
            "whose Python # refuses",
        ],
    },
    "docs/rigs.md": {
        DEFAULT: [
            "views with errors of # px",
            "tilted by less than # deg",
            "(from # deg on, with a short axis of # px)",
        ],
        MEANING: ["a dot more than # px off", "more than # degrees or # %", "its # % `interval`"],
        SETTING: [
            "A cube of # mm with",
            "# x # px, f = # px, from # to # m",
            "plates of # m, # m apart",
            "| ArUco tags by aprilcube, exact print | # | # | #, # | # | # |",
            "| this wall, 640x480 | # | # | # | # |",
            "| GridBoard, 640x480 | # | # | # | # |",
            "| this wall, 1920x1080 | # | # | # | # |",
            "| GridBoard, 1920x1080 | # | # | # | # |",
            "all faces, print good to # mm |",
            "alone, print good to # mm |",
        ],
    },
    "README.md": {
        STANDARD: ["Python # to #."],
        SETTING: ["For a camera of 640 x # px and # degrees at # to # m", "a print good to # mm per dot"],
    },
    "docs/install.md": {
        STANDARD: [
            "by the CAD kernel alone (# MB)",
            "the same by cadquery (# GB)",
            "supports Python # to #:",
            "runs on #, and parts of it were run on #, on #,",
        ],
    },
    "docs/results.md": {
        SETTING: [
            "degrees for # px of noise, dots of # mm inside a disk of # m:",
            "(tilt 40 to # degrees, azimuth within 30)",
            "grids in the same circle of # m",
            "A print error of # mm costs",
            "A calibration off by # px in fx and fy and # px",
            "Dots on pillars of 20 or # mm",
            "(point dots, # px of noise;",
        ],
    },
    "docs/design.md": {
        DEFAULT: [
            "cannot keep them to # % is refused",
            "a disk of `--radius`, # mm by default",
            "Pillars are # mm high or more (of a relief below # mm,",
            "approximated to # um",
            "a distance of #..1.5 m",
            "sources is within # % of the least",
            "a print good to # mm unless",
            "In # % of the poses the images of its dots are at least # px",
            "and # px or more apart",
            "undecided, with errors of # px",
            "is more than # times as far",
            "Dots are # times as large",
            "sees whole, # px or more inside",
            "and # px large (a key ring # px)",
            "is at most # times the least that",
            "a dot that is printed or detected # mm off",
            "is noticed with # % by a test",
            "suspects a right one with # %",
            "that fill the room; above # % the results",
            "images of dots anywhere in the room # px apart in # % of",
        ],
        SETTING: [
            "--radius # --dot 10mm",
            "cone:distance=#..1.5,tilt=40..70,azimuth=-30..30,roll=0",
            "a loss of # % leaves",
            "one size serve # to # m:",
        ],
        MEANING: ["0.096 deg (# %) for", "found in # % of the views nothing"],
        EXAMPLE: ["up to image errors of # px", "on pillars up to # mm high"],
    },
    "docs/validate.md": {
        DEFAULT: [
            "(default 200, noise # px)",
            "the rotation bound exceeds # degrees",
            "as of a grid turned by # degrees",
            "- **# %**: interval",
            "over that of its square (# and # are tried",
            "(standard deviation; that of the design, or # mm)",
            "standard deviation | # |",
            "with # px of blur, noise of # grey levels",
            "reported more than # px from",
            "its second difference exceeds # % of the first",
            "rotate the pose by # % of its standard",
            "what # % of such series give (by drawing series from the expected errors, # % wider)",
            "their share is above # %",
            "off by # px in fx and fy and # px in cx",
            "with half windows of # to # of the spacing",
        ],
        MEANING: ["rotated by # degrees", "the # % interval for", "*In # %* is", "# % region;", "is the # % Clopper"],
        SETTING: ["for a radius of # px, a contrast of # grey levels, a blur of # px and noise of # grey"],
        EXAMPLE: ["gave # deg in the hardest case where # was expected"],
    },
    "docs/detect.md": {
        DEFAULT: [
            "gives no frame for # s",
            "`design` takes # px along",
            "may add, of # px up",
            "up to # px and",
            "and # % of the marker's extent",
            "P(missed) is # % for",
            "missed with a probability of # %",
            "from E = #, one",
            "but below #: show",
            "too small: # px a cell",
            "more after # ms of",
            "looks for dots of # px and",
        ],
        MEANING: [
            "expected to be # m - @ for",
            "median, # % |",
            "lie within the region of # %, @ %",
        ],
        SETTING: [
            "motion blur of 1 to # px, and",
            "tilted by up to # degrees",
            "Of dots of # px (the",
            "of those of # px @ %",
            "at # px and @ px at # px",
            "One thread, 640 x # px",
            "A frame of 640 x # px",
        ],
        EXAMPLE: ["this layout repeats under # deg"],
    },
    "docs/print.md": {
        DEFAULT: [
            "(`--overlap`, # mm)",
            "50 or # mm that is within # % is assumed",
            "off by # % or more are probably",
            "off by # % of the outermost",
            "compared to # um",
            "A2 for a disk of # mm",
            "which is # um (a quarter of a pixel for a PNG below # dpi)",
        ],
        MEANING: ['"actual size" or # %', "printed at # %"],
        STANDARD: ["turned by # degrees", "a principal point # px larger"],
    },
    "docs/fabricate.md": {
        DEFAULT: [
            "inlays of a second material, # mm deep | # mm |",
            "pockets # mm deep, and discs that fit them | # mm,",
            "stay inlays | # mm |",
            "engraved # mm deep, and a DXF of the same name | # mm |",
            "a recess # mm deep",
            "on the control points | # mm |",
            "which assumes # mm",
            "nozzle diameter, # mm by default",
            "largest common one up to # mm",
            "the recess # mm of the plate remains",
            "an `--edge` (# mm)",
            "are engraved # mm deep",
            "`--tolerance` (# um)",
            "to # um, which is what\na printer shows",
            "# mm apart on a plate of # mm",
        ],
        EXAMPLE: ["*of diameter* # mm", "by # degrees; `--foot`", "for a disc of # mm |"],
        STANDARD: [
            "with PrusaSlicer #,",
            "engine of Cura #,",
            "`pip install 'markergen[step]'` | # MB",
            "`pip install 'markergen[solids]'` | # GB",
        ],
    },
    "docs/simulators.md": {
        STANDARD: ["density of PLA (# kg"],
    },
    "docs/paper.md": {
        SETTING: [
            "f = # px",
            "disk of radius # m |",
            "| noise | # px | # px, and also # px |",
            "`metric` with noise of # px is computed in full, the others and noise of # px",
            "noise of #, # and # px",
            "coordinates, # px, or without",
            "relief of 20 and # mm. Over",
            "points at # px. In frontal",
            "at # px @ to @ times, and at # px @ to",
            "tilted by # or # degrees it is @ to @ times at # px.",
            "times, at 1 and # px",
            "times as much at # px, and @ to @ times at # px",
            "is left at # px, and with five points or more all of it at # px",
            "poses at # px, the rotation bound",
            "@ deg (# mm) and @ deg (# mm)",
            "growth #, half where",
            "of SuperSAB as published # and half",
            "From starts # deg off",
        ],
        MEANING: ["# times as wide", "over # %) are"],
    },
    "docs/choosing.md": {
        SETTING: [
            "a camera of 640 x # px with a focal length of # px, # to # m away",
            "a tilt of # degrees; a disk of # mm; a print good to # mm.",
            "(here off by # px in fx",
            "by # px in the principal point)",
            "made to # mm (`--relief",
        ],
        DEFAULT: ["no longer *found*: take # px along", "# px at the least.", "glued flat: # mm is the tool"],
    },
    "docs/error.md": {
        SETTING: [
            "a disk of # mm, a camera of 640 x # px with a focal length of # px, half",
            "tilted by 20 to # degrees:",
            "(Noise of # grey levels",
            "tilted by # degrees.) Hundredths",
            "a print good to # mm.) *First",
            "(Tilted by # degrees; a print good to # mm, and a calibration off by # px in fx and fy and # px in",
        ],
        DEFAULT: ["Keep dots at # px"],
        STANDARD: ["largest at # degrees or so"],
    },
    "docs/theory.md": {
        SETTING: ["rotation for # px of noise"],
    },
    "docs/objections.md": {
        SETTING: ["The camera has 640 x # px"],
    },
    "docs/comparison.md": {
        SETTING: [
            "640 x # px are few",
            "in a circle of # mm",
            "a print error of # mm of",
            "compare markers of # mm, at # to # m anywhere",
            "square of # mm and white",
            "up to # degrees, are",
        ],
        DEFAULT: ["dots of # px and a ring"],
        UPPER: [
            "| 7 x 7 circles | # (# to #) | # | # % |",
            "| checkerboard of 9 x 9 | # (# to #) | # | # % |",
            "| ArUco 4x4 | # (# to #) | # | # % |",
            "| AprilTag 36h11 | # (# to #) | # | # % |",
            "| ChArUco 5x5 | # (# to #) | # | # % |",
        ],
    },
    "docs/faq.md": {
        EXAMPLE: ["seen at # degrees or more"],
        STANDARD: ["by (cx + #) s - # for"],
    },
    "docs/study.md": {
        DEFAULT: ["times out after # s"],
    },
    "docs/start.md": {
        STANDARD: ["Python # or newer"],
        SETTING: ["for a camera of 640 x # px", "tilted by 20 to # degrees"],
    },
    "docs/conventions.md": {
        DEFAULT: ["an edge (# mm)", "polygons within # um", "at most # um off"],
        MEANING: ["a hole of # mm is # mm in every file", "are for # px;", "a TE over # %"],
        STANDARD: ["are # px larger"],
    },
}
"""Places by file and by what their numbers are."""

GIVEN = [Given(file, place, reason) for file in PLACES for reason in PLACES[file] for place in PLACES[file][reason]]
