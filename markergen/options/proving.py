"""Options for proving and using a marker: validation, comparison, verification, detection, rescaling, studies."""

from typing import Annotated, TypedDict

from markergen.options.base import ERRORS, IMAGES, RUN, TRIALS, VIEW, File, Length, Option, Poses


class ValidateKeywords(TypedDict, total=False):
    """Options of a validation, beside the marker and the camera."""

    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "paper, paper-roll, cone:tilt=0..60,distance=0.4..1m, or a CSV, JSON, TUM or COLMAP file.",
            otherwise="what it was designed for",
            metavar="NAME|CONE|FILE",
        ),
    ]
    runs: Annotated[int, Option(TRIALS, "Noisy trials for each pose; 0 gives the bounds alone.", 1000)]
    noise: Annotated[float, Option(TRIALS, "Standard deviation on every image coordinate.", 0.2, metavar="PX")]
    trials_for_all: Annotated[
        bool,
        Option(TRIALS, "Run trials for the n-gon, square and random layouts, too.", False, flags="--trials-for-all"),
    ]
    views: Annotated[
        int, Option(IMAGES, "Synthetic images to find the marker in.", otherwise="100; 0 for bare points", metavar="N")
    ]
    optics: Annotated[
        str, Option(IMAGES, "Optics of the views, such as blur_px=1.5,noise_grey=4.", metavar="KEY=VALUE,...")
    ]
    background: Annotated[
        str, Option(IMAGES, "Background of the marker: plain, clutter or photo.", "plain", metavar="NAME")
    ]
    hide: Annotated[int, Option(IMAGES, "Number of dots that are covered in each view.", 0)]
    refine: Annotated[
        str,
        Option(IMAGES, "none, or photometric: align the rendered model with the image.", "none", metavar="NAME"),
    ]
    stress: Annotated[
        bool,
        Option(
            IMAGES, "Repeat the views with blur, noise, little light, a hidden dot, clutter.", False, flags="--stress"
        ),
    ]
    print_sigma: Annotated[
        Length, Option(ERRORS, "Standard deviation of a printed dot's position along each axis.", "0.1mm")
    ]
    camera_covariance: Annotated[
        File,
        Option(ERRORS, "Covariance, or a row of standard deviations, of fx, fy, cx, cy, ...", metavar="FILE"),
    ]
    seed: Annotated[int, Option(RUN, "Seed for the noise; the same seed gives the same results.", 0)]
    workers: Annotated[int, Option(RUN, "Number of processes.", otherwise="one for each processor", metavar="N")]


class CompareKeywords(TypedDict, total=False):
    """Options of a comparison, beside the contestants."""

    views: Annotated[int, Option(IMAGES, "Synthetic images of each, from the same poses.", 200)]
    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "paper, paper-roll, a cone, or a file of poses.",
            otherwise="what the first was designed for",
            metavar="NAME",
        ),
    ]
    print_sigma: Annotated[
        Length, Option(ERRORS, "Standard deviation of a printed dot's or corner's position along each axis.", "0mm")
    ]
    seed: Annotated[int, Option(RUN, "Seed for noise and poses; the same seed gives the same results.", 0)]
    workers: Annotated[int, Option(RUN, "Number of processes.", otherwise="one for each processor", metavar="N")]


class VerifyKeywords(TypedDict, total=False):
    """Options of a verification, beside the marker and the files."""

    tolerance: Annotated[
        Length,
        Option(RUN, "Maximum deviation of a dot.", otherwise="1 um; 5 um in a mesh; a quarter of a pixel in a PNG"),
    ]


class DetectKeywords(TypedDict, total=False):
    """Options of a detector, beside the markers and the camera."""

    camera_covariance: Annotated[
        File,
        Option(ERRORS, "Covariance, or a row of standard deviations, of fx, fy, cx, cy, ...", metavar="FILE"),
    ]
    print_sigma: Annotated[
        Length, Option(ERRORS, "Standard deviation of a printed dot's position along each axis.", "0.1mm")
    ]
    refine: Annotated[
        str,
        Option(RUN, "none, or photometric: align the rendered model with the image.", "none", metavar="NAME"),
    ]


class RescaleKeywords(TypedDict, total=False):
    """Measurements of a print, for rescaling."""

    measured_x: Annotated[Length, Option(ERRORS, "Measured length of the ruler along x.")]
    measured_y: Annotated[Length, Option(ERRORS, "Measured length of the ruler along y.", otherwise="as along x")]
    nominal_x: Annotated[Length, Option(ERRORS, "Length printed beside the ruler along x.", "200mm")]
    nominal_y: Annotated[Length, Option(ERRORS, "Length printed beside the ruler along y.", "200mm")]
    measured_points: Annotated[
        File,
        Option(
            ERRORS,
            "Measured dots: id,x,y[,sigma | ,sx,sy[,rho]]; meters, or units as in x_mm.",
            metavar="CSV",
        ),
    ]
    force: Annotated[bool, Option(ERRORS, "Accept a print that is 5 % off or more.", False, flags="--force")]


class StudyKeywords(TypedDict, total=False):
    """Options for running a study."""

    workers: Annotated[int, Option(RUN, "Number of processes.", otherwise="one for each processor", metavar="N")]
    scheduler: Annotated[
        str,
        Option(RUN, "Compute on a running Dask cluster instead, such as tcp://10.0.0.1:8786.", metavar="ADDRESS"),
    ]
    resume: Annotated[
        bool,
        Option(RUN, "Continue in a folder: what is finished is not computed again.", False, flags="--resume"),
    ]
    runs: Annotated[
        int,
        Option(
            TRIALS, "Noisy runs of each layout and pose.", otherwise="paper 20, sweep 100 or the file's", metavar="N"
        ),
    ]
    scale: Annotated[
        float, Option(TRIALS, "Share of the paper's study; 0.01 is a quick look.", otherwise="1", metavar="SHARE")
    ]
