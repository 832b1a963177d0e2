"""Options of a comparison, and of a study."""

# tests: tests/options/test_declared.py tests/options/test_reading.py

from typing import Annotated, TypedDict

from markergen.defaults import COMPARED_VIEWS
from markergen.options import ERRORS, IMAGES, RUN, TRIALS, VIEW, Option
from markergen.options.kinds import File, Length, Poses
from markergen.options.shared import CameraInBody, PosesAxes, PosesFrame, PosesUnit, Workers


class CompareKeywords(TypedDict, total=False):
    """Options of a comparison, besides the contestants."""

    views: Annotated[
        int,
        Option(
            IMAGES,
            "Synthetic images of each, from the same poses.",
            otherwise=f"{COMPARED_VIEWS}; of a protocol all",
            metavar="N",
        ),
    ]
    protocol: Annotated[
        str,
        Option(
            IMAGES,
            "none, or fmac: square markers of 50 mm in 10,000 poses over six degrees of freedom.",
            "none",
            metavar="NAME",
        ),
    ]
    parts: Annotated[
        File,
        Option(RUN, "Folder that keeps finished parts of a protocol; the next run goes on from there.", metavar="DIR"),
    ]
    poses: Annotated[
        Poses,
        Option(
            VIEW,
            "paper, paper-roll, a cone, or a file of poses.",
            otherwise="the design poses of the first one",
            metavar="NAME",
        ),
    ]
    poses_frame: PosesFrame
    poses_axes: PosesAxes
    poses_unit: PosesUnit
    camera_in_body: CameraInBody
    print_sigma: Annotated[
        Length, Option(ERRORS, "Standard deviation of a printed dot's or corner's position along each axis.", "0mm")
    ]
    seed: Annotated[int, Option(RUN, "Seed for noise and poses; the same seed gives the same results.", 0)]
    workers: Workers


class StudyKeywords(TypedDict, total=False):
    """Options for running a study."""

    workers: Workers
    scheduler: Annotated[
        str,
        Option(RUN, "Compute on a running Dask cluster instead, such as tcp://10.0.0.1:8786.", metavar="ADDRESS"),
    ]
    resume: Annotated[
        bool,
        Option(RUN, "Continue in a folder: finished cells are not computed again.", False, flags="--resume"),
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
