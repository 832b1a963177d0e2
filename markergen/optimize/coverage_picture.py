"""Picture of what poses see of a marker: dots in view over distance and tilt."""
# tests: tests/api/test_design.py tests/validation/report/test_overview.py

from typing import TYPE_CHECKING

from markergen.model.constellation import FEWEST
from markergen.model.sight import Coverage
from markergen.presentation.plots import color_steps, log_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_coverage(covered: Coverage, ax: "Axes") -> "Axes":
    """Draw each pose by its distance and tilt, colored by the number of dots in view; crosses are not served."""
    poses, served = covered.poses, covered.served
    distance, tilt = poses.distance, poses.polar_angle_deg
    scatter = ax.scatter(
        distance[served], tilt[served], c=covered.count[served], s=14, cmap=color_steps("viridis"), vmin=FEWEST
    )
    if served.any():
        ax.figure.colorbar(scatter, ax=ax, label="dots in view")
    if not served.all():
        ax.scatter(
            distance[~served],
            tilt[~served],
            marker="x",
            s=18,
            c="tab:red",
            label=f"fewer than {FEWEST} dots of one size",
        )
        ax.legend(loc="upper left")
    ax.set_xlabel("distance, m")
    ax.set_ylabel("tilt, deg")
    log_axis(ax, "x")
    return ax
