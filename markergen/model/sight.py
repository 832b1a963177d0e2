"""Sight: which dots of a body each pose shows, and which poses a marker serves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.arrays import Array, Indices, Mask
from markergen.errors import InputError
from markergen.maths.projection import perspective, to_camera
from markergen.model.body import FEWEST, Body, enough, scales_of
from markergen.model.camera import Camera
from markergen.model.feature import RELIABLE_PIXELS
from markergen.model.marker import Marker
from markergen.model.occlusion import hidden
from markergen.model.poses import PoseDistribution
from markergen.presentation.tables import Table, percent
from markergen.units import format_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARGIN_PX = 3.0
"""Distance in px that the image of a dot keeps from the edge of the sensor to be detected."""

LEAST_FACING, TRIED_FACING = 0.1, 0.34
"""Cosines of the tilt from which on a dot may be seen, 84 deg, and up to which `Feature.least_pixels` was tried, 70."""

NARROWEST_PX = 3.0
"""Minimum short axis in px of the image of a dot at a steeper tilt; narrower ones are found in some images only."""

RIM = 16
"""Number of points on the rim of a dot that represent its image."""

AT_ONCE = 2**14
"""Largest number of images of disks that are held at once, in some 20 MB."""

BANDS, FINE_BANDS = 8, 32
"""Numbers of ranges of distance, of equal ratio, in tables and in sentences."""


def dots_in_view(body: Body, camera: Camera, poses: PoseDistribution) -> Mask:
    """Mask (P, n) of the dots of a body that each pose T_camera_body shows: see `disks_in_view`; and not hidden.

    They are large enough from `Feature.least_pixels` on, and what hides them is what `occlusion.hidden` knows.
    """
    parts = [
        disks_in_view(
            plate.marker.xyz,
            2 * plate.marker.radii,
            camera,
            PoseDistribution("", *plate.camera_pose(poses.rotation, poses.translation)),
            body.least_px[body.owner == k],
        )
        for k, plate in enumerate(body.plates)
    ]
    return np.concatenate(parts, axis=1) & ~hidden(body, poses)


def disks_in_view(
    points: Array, diameters: Array, camera: Camera, poses: PoseDistribution, least_px: Array | float = RELIABLE_PIXELS
) -> Mask:
    """Mask (P, n) of the disks of one plate that each pose T_camera_marker shows: whole, from the front, large enough.

    The whole image lies `MARGIN_PX` or more inside the sensor. Its mean diameter, the root of long times short axis, is
    at least `least_px`, and the cosine of the disk's tilt above `LEAST_FACING`; below `TRIED_FACING`, the short axis is
    at least `NARROWEST_PX`. What hides disks from each other does not count.

    Parameters
    ----------
    points : array (n, 2 or 3), m
    diameters : array (n,), m
    least_px : float or array (n,)
    """
    if len(poses) > 1 and len(poses) * len(points) > AT_ONCE:
        halves = np.array_split(np.arange(len(poses)), 2)
        return np.concatenate([disks_in_view(points, diameters, camera, poses.taken(k, 0), least_px) for k in halves])
    angle = 2 * np.pi * np.arange(RIM) / RIM
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rims = np.repeat(points[:, None], RIM, axis=1)
    rims[..., :2] += diameters[:, None, None] / 2 * circle
    seen = to_camera(rims.reshape(-1, rims.shape[-1]), poses.rotation, poses.translation)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pixels = camera.to_pixels(perspective(seen)).reshape(len(poses), len(points), RIM, 2)
        x, y = pixels[..., 0], pixels[..., 1]
        area = np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1) / 2
        # The rim is a polygon of slightly less area.
        mean = np.sqrt(np.abs(area) / (RIM / 2 * np.sin(2 * np.pi / RIM)) * 4)
        # Along an axis of an ellipse, the mean square over its rim is half the square of the semi-axis.
        x, y = x - x.mean(axis=-1, keepdims=True), y - y.mean(axis=-1, keepdims=True)
        half, skew = np.mean(x**2 + y**2, axis=-1), np.hypot(np.mean(x**2 - y**2, axis=-1), 2 * np.mean(x * y, axis=-1))
        short = 2 * np.sqrt(np.maximum(half - skew, 0.0))
        # Pixel centers are integers: the sensor begins half a pixel before the first.
        low = pixels >= MARGIN_PX - 0.5
        high = pixels <= np.array([camera.width, camera.height]) - 0.5 - MARGIN_PX
        whole = np.all(low & high, axis=(-2, -1)) & (mean >= least_px)
    ahead = np.all(seen.reshape(len(poses), len(points), RIM, 3)[..., 2] > 0, axis=-1)
    places = to_camera(points, poses.rotation, poses.translation)
    # The third column of R is the marker's normal in the camera frame; places points from the camera to the dot.
    facing = -np.sum(places * poses.rotation[:, None, :, 2], axis=-1) / np.linalg.norm(places, axis=-1)
    clear = (facing > LEAST_FACING) & ((facing >= TRIED_FACING) | (short >= NARROWEST_PX))
    return np.asarray(whole & ahead & clear)


@dataclass(frozen=True, eq=False)
class Coverage:
    """What each of P poses sees of a body whose dots have one or several diameters.

    Attributes
    ----------
    points : array (n, 2 or 3), m
    diameters : array (n,), m
    seen : array (P, n) of bool
        See `dots_in_view`.
    owner : array (n,) of int or None
        Plate of each dot; None if all are on one.
    """

    points: Array
    diameters: Array
    poses: PoseDistribution
    seen: Mask
    owner: Indices | None = None

    @cached_property
    def on_plates(self) -> tuple[Indices, ...]:
        """Indices of the dots of each plate."""
        owner = np.zeros(len(self.points), dtype=np.intp) if self.owner is None else self.owner
        return tuple(np.flatnonzero(owner == k) for k in range(owner.max(initial=0) + 1))

    @cached_property
    def scales(self) -> tuple[Indices, ...]:
        """Indices of the dots of each diameter of each plate, the largest first."""
        return tuple(dots[scale] for dots in self.on_plates for scale in scales_of(self.diameters[dots]))

    @cached_property
    def serving(self) -> Mask:
        """Mask (P, k): whether each of k scales shows four dots that are not on a line."""
        return np.stack([enough(self.points[scale], self.seen[:, scale]) for scale in self.scales], axis=-1)

    @property
    def served(self) -> Mask:
        """Mask (P,) of the poses in which the body can be found: by dots of one scale of one plate."""
        return np.asarray(self.serving.any(axis=-1))

    @cached_property
    def plate_served(self) -> Mask:
        """Mask (P, k): whether each of k plates can be found by itself."""
        parts = ([np.isin(scale[0], dots) for scale in self.scales] for dots in self.on_plates)
        return np.stack([self.serving[:, part].any(axis=-1) for part in parts], axis=-1)

    @cached_property
    def plates(self) -> Indices:
        """Number (P,) of plates of which dots are in view."""
        return np.sum([self.seen[:, dots].any(axis=1) for dots in self.on_plates], axis=0)

    def by_plates(self) -> dict[str, Mask]:
        """Masks (P,) of the served poses by the number of plates of which dots are in view."""
        return {str(k): mask for k in np.unique(self.plates) if (mask := self.served & (self.plates == k)).any()}

    @property
    def count(self) -> Indices:
        """Number (P,) of dots in view."""
        return np.asarray(self.seen.sum(axis=-1))

    def bands(self, most: int = BANDS) -> list[tuple[float, float, Mask]]:
        """Ranges of distance in m of equal ratio, nearest first, with masks (P,) of their poses; none is empty."""
        distance = self.poses.distance
        low, high = float(distance.min()), float(distance.max())
        if high < low * 1.001:
            return [(low, high, np.ones(len(distance), dtype=bool))]
        ends = np.geomspace(low, high, most + 1)
        at = np.clip(np.searchsorted(ends, distance, side="right") - 1, 0, most - 1)
        return [(float(ends[i]), float(ends[i + 1]), at == i) for i in range(most) if np.any(at == i)]

    @property
    def gaps(self) -> list[str]:
        """Distances at which no four dots are in view, in words: ``0.3 to 0.55 m: 2 dots in view``."""
        merged: list[tuple[float, float, Mask]] = []
        missed = False
        for low, high, mask in self.bands(FINE_BANDS):
            short = mask & ~self.served
            if not short.any():
                missed = False
                continue
            if missed:
                low, _, before = merged.pop()
                mask = mask | before
            merged.append((low, high, mask))
            missed = True
        return [self._gap(*band) for band in merged]

    def _gap(self, low: float, high: float, mask: Mask) -> str:
        short = mask & ~self.served
        least, most = int(self.count[short].min()), int(self.count[short].max())
        dots = f"{most} dot{'s' * (most != 1)}" if least == most else f"{least} to {most} dots"
        if len(self.scales) > 1:
            dots += f", no {FEWEST} of one size,"
        share = short.sum() / mask.sum()
        often = f" in {100 * share:.0f} % of the poses" if share < 1 else ""
        return f"{low:.3g} to {high:.3g} m: {dots} in view{often}"

    def rows(self) -> list[dict[str, Any]]:
        """By range of distance: poses, how many of them are served, dots in view, and diameters that serve, in m."""
        return [
            {
                "from_m": low,
                "to_m": high,
                "poses": int(mask.sum()),
                "served": int(self.served[mask].sum()),
                "dots": [int(self.count[mask].min()), float(np.median(self.count[mask])), int(self.count[mask].max())],
                "serving": self.serving[mask].sum(axis=0).tolist(),
            }
            for low, high, mask in self.bands()
        ]

    def plot(self, ax: "Axes") -> "Axes":
        """Draw each pose by its distance and tilt, colored by the number of dots in view; crosses are not served."""
        from markergen.presentation.plots import color_steps, log_axis

        poses, served = self.poses, self.served
        distance, tilt = poses.distance, poses.polar_angle_deg
        scatter = ax.scatter(
            distance[served], tilt[served], c=self.count[served], s=14, cmap=color_steps("viridis"), vmin=FEWEST
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


def coverage(body: Body, camera: Camera, poses: PoseDistribution) -> Coverage:
    """What each pose sees of a body; dots are large enough from `Feature.least_pixels` on."""
    poses = poses.placed(camera)
    return Coverage(body.xyz, 2 * body.radii, poses, dots_in_view(body, camera, poses), body.owner)


def poses_that_serve(marker: Marker, camera: Camera, poses: PoseDistribution) -> PoseDistribution:
    """Poses that see the whole marker, or of one with dots of several sizes, four of one size.

    Raises
    ------
    InputError
        If there is none.
    """
    if len(marker.constellations) < 2:
        return poses.seen_whole(marker.boundary, camera, marker.height)
    poses = poses.placed(camera)
    kept = np.flatnonzero(coverage(marker, camera, poses).served)
    if not kept.size:
        raise InputError(
            f"a pose that sees {FEWEST} dots of one size", f"none of {len(poses)} ({poses.name})", "use other poses"
        )
    return poses.taken(kept, poses.dropped + len(poses) - kept.size)


def partly_seen(body: Body, camera: Camera, poses: PoseDistribution) -> Mask | None:
    """Mask (P, n) of the dots that count; None if all do, as those of a marker with dots of one size."""
    return None if body.is_single else coverage(body, camera, poses).seen


def distance_table(
    rows: Sequence[Mapping[str, Any]], diameters: Sequence[float], titles: Sequence[str], cells: Sequence[Sequence[str]]
) -> Table:
    """Dots in view by distance, the share of the poses that four dots of each size serve, and more cells of each row.

    Parameters
    ----------
    rows : sequence
        Of `Coverage.rows`.
    diameters : sequence of float
        Of the sizes, m.
    """
    body = []
    for row, more in zip(rows, cells, strict=True):
        least, _, most = row["dots"]
        body.append(
            [
                f"{row['from_m']:.2g}..{row['to_m']:.2g}",
                percent(row["served"] / row["poses"]),
                f"{least} to {most}" if least < most else str(least),
                *(percent(count / row["poses"]) for count in row["serving"]),
                *more,
            ]
        )
    return Table(
        "What each distance is served by",
        ["distance m", "served", "dots", *map(format_length, diameters), *titles],
        body,
        "Dots in view: whole in the image and large enough. A pose is served by four or more of one size, whose share "
        "of the poses stands under it. Errors are RMS.",
    )
