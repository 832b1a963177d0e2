"""Options of a study."""
# tests: tests/options/test_declared.py tests/options/test_reading.py

from typing import Annotated, TypedDict

from markergen.options import RUN, TRIALS, Option
from markergen.options.shared import Workers


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
