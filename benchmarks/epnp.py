"""What EPnP is in this project, beside a single call to OpenCV's: rotation errors over the paper's poses, and rolled.

    python -m benchmarks.epnp [--n 5] [--noise 0.2] [--runs 20]

Both get the same noisy images of the regular polygon on the rim of the paper's disk.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse

import numpy as np

from markergen.estimators import ESTIMATORS, Correspondences, PoseEstimates, PoseEstimator
from markergen.estimators.base import solve_each
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper, paper_roll
from markergen.objectives.criteria import regular_polygon
from markergen.validation.metrics import rotation_error_deg


class Single(PoseEstimator):
    """One call to OpenCV's EPnP."""

    name = "a single call"

    def solve(self, batch: Correspondences) -> PoseEstimates:
        """Poses of the batch, one solution each."""
        return solve_each(batch, "EPNP")


def main() -> None:
    """Print RMS, median and the share of large errors of both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=5)
    parser.add_argument("--noise", type=float, default=0.2, help="px")
    parser.add_argument("--runs", type=int, default=20)
    options = parser.parse_args()
    print(f"{options.n} points, noise {options.noise:g} px: rotation error, deg\n{'':24}     RMS  median  above 10")
    points = regular_polygon(options.n, 0.15)
    for poses in (paper(), paper_roll()):
        exact = PAPER_CAMERA.project(points[None], poses.rotation, poses.translation)[0]
        exact = np.repeat(exact, options.runs, axis=0)
        noise = options.noise * np.random.default_rng(0).standard_normal(exact.shape)
        batch = Correspondences(points, exact + noise, PAPER_CAMERA)
        for estimator in (Single(), ESTIMATORS["epnp"]):
            assert isinstance(estimator, PoseEstimator)
            rotation = batch.once(estimator).best[0]
            error = rotation_error_deg(rotation, np.repeat(poses.rotation, options.runs, axis=0))
            rms = np.sqrt(np.nanmean(error**2))
            print(
                f"{poses.name:11}{estimator.name:13} {rms:7.2f} {np.nanmedian(error):7.2f} {np.mean(error > 10):8.1%}"
            )


if __name__ == "__main__":
    main()
