"""A search as a movie: its dots move in the marker and in the image, with value and errors, as SVG or MP4."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np

from markergen.arrays import Array
from markergen.objectives import Setting
from markergen.optimize.trace import Step

FRAMES, SECONDS, HELD = 90, 9.0, 1.5
"""Largest number of steps that are shown, and duration in s of the way and of its end."""

WIDTH, HEIGHT, PANEL, MARGIN, CURVE = 960, 560, 440, 20, 50
"""Size in px of the picture, of each of its two panels, of the space around them, and of the curve below."""

CORNERS = 16
"""Corners of the polygon that a dot is drawn as."""

RATE = 20
"""Frames per second of a video."""

DARK, LIGHT, BLUE = "#1b1b1b", "#9a9a9a", "#0b5fa5"

MOVIES = (".svg", ".mp4")
"""File formats of movies."""


@dataclass(frozen=True, eq=False)
class Movie:
    """A way to a layout, in pictures.

    Attributes
    ----------
    trace : sequence of Step
    setting : Setting
        Its pose of median tilt is the one of the image.
    diameter : float
        Of the dots, m; 0 draws small ones.
    title : str
        Name of the objective.
    """

    trace: Sequence[Step]
    setting: Setting
    diameter: float
    title: str

    @property
    def steps(self) -> list[Step]:
        """Steps that are shown, the first and the last among them."""
        places = np.linspace(0, len(self.trace) - 1, min(FRAMES, len(self.trace)))
        return [self.trace[place] for place in np.round(places).astype(int).tolist()]

    def polygons(self, step: Step) -> Array:
        """Dots (2 n, CORNERS, 2) in px of the picture: in the marker, then in the image."""
        points = np.pad(step.points, ((0, 0), (0, 3 - step.points.shape[1])))
        angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
        radius = (self.diameter or 0.03 * self.setting.boundary.radius) / 2
        rims = points[:, None] + radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
        return np.concatenate([self._in_marker(rims[..., :2]), self._in_image(rims)])

    def outlines(self) -> list[Array]:
        """Lines in px of the picture that do not move: the boundary in both panels, and the edge of the image."""
        camera = self.setting.camera
        rings = [np.concatenate([ring, ring[:1]]) for ring in self.setting.boundary.outlines()]
        width, height = camera.width - 0.5, camera.height - 0.5
        frame = np.array([[-0.5, -0.5], [width, -0.5], [width, height], [-0.5, height], [-0.5, -0.5]])
        flat = [self._in_image(np.pad(ring, ((0, 0), (0, 1)))[None])[0] for ring in rings]
        return [*(self._in_marker(ring) for ring in rings), *flat, self._of_image(frame)]

    def curve(self) -> Array:
        """Logarithm of the value (k, 2) over the steps shown, in px of the picture; the last height where infinite."""
        values = np.log([step.objective for step in self.steps])
        values = np.where(np.isfinite(values), values, values[-1])
        x = np.linspace(MARGIN, WIDTH - MARGIN, len(values))
        span = max(float(np.ptp(values)), 1e-9)
        return np.stack([x, HEIGHT - MARGIN - CURVE * (values - values.min()) / span], axis=-1)

    def caption(self, step: Step) -> str:
        """Stage, value and errors of a step, in words."""
        errors = f"rotation {step.rotation_deg:.3g} deg, translation {step.translation_pct:.3g} %"
        return f"{step.step}  {step.stage}: {self.title} {step.objective:.4g}, {errors}"

    def svg(self) -> bytes:
        """Animated SVG, which browsers play without end."""
        steps = self.steps
        # The end is shown for a while.
        ends = [*np.linspace(0, SECONDS / (SECONDS + HELD), len(steps)).round(4).tolist(), 1.0]
        times = f'dur="{SECONDS + HELD:g}s" repeatCount="indefinite" keyTimes="{_joined(ends, ";", 4)}"'
        frames = np.stack([self.polygons(step) for step in [*steps, steps[-1]]])
        curve = self.curve()
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
            f'font-family="sans-serif" font-size="15"><title>The way to the layout</title>'
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
            *(_polyline(line, LIGHT) for line in self.outlines()),
            _polyline(curve, BLUE),
        ]
        for dot in frames.swapaxes(0, 1):
            ways = ";".join(_text_of(corners) for corners in dot)
            parts.append(
                f'<polygon fill="{DARK}" points="{_text_of(dot[-1])}">'
                f'<animate attributeName="points" {times} values="{ways}"/></polygon>'
            )
        moves = "".join(
            f'<animate attributeName="c{axis}" {times} values="{_joined([*values, values[-1]], ";")}"/>'
            for axis, values in zip("xy", curve.T.tolist(), strict=True)
        )
        parts.append(f'<circle r="5" fill="{BLUE}" cx="{curve[-1, 0]:.1f}" cy="{curve[-1, 1]:.1f}">{moves}</circle>')
        for place, step in enumerate(steps):
            opacities = ";".join("1" if min(k, len(steps) - 1) == place else "0" for k in range(len(ends)))
            parts.append(
                f'<text x="{MARGIN}" y="{HEIGHT - CURVE - 1.6 * MARGIN:g}" opacity="{int(place == len(steps) - 1)}">'
                f'{escape(self.caption(step))}<animate attributeName="opacity" calcMode="discrete" {times} '
                f'values="{opacities}"/></text>'
            )
        return "\n".join([*parts, "</svg>\n"]).encode()

    def mp4(self) -> bytes:
        """Video, for players; browsers do not know its codec."""
        import tempfile
        from pathlib import Path

        import cv2

        steps, curve = self.steps, self.curve()
        lines = [np.round(16 * line).astype(np.int32) for line in [*self.outlines(), curve]]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "way.mp4"
            video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE, (WIDTH, HEIGHT))
            places = np.round(np.linspace(0, len(steps) - 1, round(RATE * SECONDS))).astype(int).tolist()
            for place in [*places, *[len(steps) - 1] * round(RATE * HELD)]:
                picture = np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)
                cv2.polylines(picture, lines, False, (154, 154, 154), 1, cv2.LINE_AA, 4)
                polygons = np.round(16 * self.polygons(steps[place])).astype(np.int32)
                for polygon in polygons:
                    cv2.fillPoly(picture, [polygon], (27, 27, 27), cv2.LINE_AA, 4)
                center = np.round(curve[place]).astype(int).tolist()
                cv2.circle(picture, center, 5, (165, 95, 11), -1, cv2.LINE_AA)
                at = MARGIN, round(HEIGHT - CURVE - 1.6 * MARGIN)
                text, font = self.caption(steps[place]), cv2.FONT_HERSHEY_SIMPLEX
                cv2.putText(picture, text, at, font, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
                video.write(picture)
            video.release()
            return path.read_bytes()

    def _in_marker(self, points: Array) -> Array:
        boundary = self.setting.boundary
        scale = PANEL / 2 / boundary.radius
        return MARGIN + PANEL / 2 + (points - boundary.center) * [scale, -scale]

    def _in_image(self, points: Array) -> Array:
        """Places in the picture of the images of points (m, k, 3) in m."""
        poses = self.setting.poses
        pose = np.argsort(poses.polar_angle_deg, kind="stable")[len(poses) // 2 : len(poses) // 2 + 1]
        flat = points.reshape(-1, 3)
        pixels = self.setting.camera.project(flat, poses.rotation[pose], poses.translation[pose])[0]
        return self._of_image(pixels.reshape(*points.shape[:-1], 2))

    def _of_image(self, pixels: Array) -> Array:
        camera = self.setting.camera
        scale = PANEL / max(camera.width, camera.height)
        return (pixels + 0.5) * scale + [WIDTH - MARGIN - PANEL, MARGIN + (PANEL - scale * camera.height) / 2]


def _joined(numbers: Sequence[float], by: str, digits: int = 1) -> str:
    return by.join(f"{value:.{digits}f}".rstrip("0").rstrip(".") for value in numbers)


def _text_of(points: Array) -> str:
    return _joined(points.ravel().tolist(), " ")


def _polyline(points: Array, color: str) -> str:
    return f'<polyline fill="none" stroke="{color}" points="{_text_of(points)}"/>'
