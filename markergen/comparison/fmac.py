"""The protocol of Laurent and Sandoz, "FMAC: a Fair Fiducial Marker Accuracy Comparison Software" (arXiv 2601.07723).

Square markers of 50 mm, anywhere in the view of a webcam with its distortion, 0.5 to 1.5 m away, in poses of a sequence
of low discrepancy over all six degrees of freedom, blurred by a thin lens's defocus and by diffraction.

Results are tables of bias and spread, and 36 plots of each contestant.
"""

# tests: tests/comparison/test_fmac.py tests/comparison/test_fmac_result.py

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.comparison.compare import flips, forecast
from markergen.comparison.contestants import KINDS, Arena, Choice, Contestant
from markergen.comparison.contestants.dots import DotBody
from markergen.comparison.contestants.printed import Squares
from markergen.comparison.result import Comparison, with_short_names
from markergen.comparison.series import (
    TUNING,
    VIEWS,
    Observation,
    Series,
    announcing,
    observe_chunk,
    shared,
    tune_chunk,
)
from markergen.comparison.tuning import POSE
from markergen.errors import InputError
from markergen.files import make_folder, write_atomic
from markergen.model.body_json import load_marker_or_rig
from markergen.model.boundary import Circle
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import Marker, check_supported
from markergen.model.rig import Rig
from markergen.objectives import Setting
from markergen.options import Progress
from markergen.pool import chunks_of
from markergen.presentation.plots import axes_of, new_figure
from markergen.presentation.results import json_bytes, plain
from markergen.presentation.tables import Table, data_frame, number, percent
from markergen.read.poses import poses_from
from markergen.render import Optics
from markergen.units import duration, format_length
from markergen.validation.degrees import ERRORS, SCATTERED, DegreeErrors, correlation_words, draw_degrees, pose_degrees

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame


IMAGES = 10_000
"""Number of poses of the sequence; fewer views are its beginning, which is of low discrepancy, too."""
SIDE = 0.05
"""Side in m of a tag's black square, and of the square that a marker of dots must fit in."""
ROOM = 0.048
"""Radius in m of the circle that is in view in all poses: tags with the white around them fit in it."""
CAMERA = Camera(640, 480, 621.0, 619.4, 324.6, 236.8, Distortion("radtan", (0.092, -0.213, 0.0012, -0.0009)))
"""A webcam: the protocol's authors took one of their own, whose numbers we do not have."""
OPTICS = Optics(blur_px=0.0, aperture_mm=2.0, focus=0.8)
"""Of a focal length of 4 mm at f/2, focused at 0.8 m: disks of up to 0.47 px and an Airy pattern of 0.21 px. Noise and
levels are those of all our views; the protocol's have none but that of rounding."""
POSES = "view:distance=0.5..1.5m,tilt=0..60,margin=0%"
OPPONENTS = ("aruco:DICT_4X4_50", "apriltag:36h11", "pupil:36h11", "stag:HD21")
"""Opponents of a single contestant."""
TUNING_VIEWS = 24
"""Number of views, from a sequence with another start, for choosing each rival's settings."""
PART = 100
"""Number of views of a part, which is kept as soon as it is finished."""
FORMAT = 1
"""Version of the files that keep parts; a change of rendering, detection or judging makes it another."""


@dataclass(frozen=True)
class Shelf:
    """Folder that keeps finished parts by what they were made from; None keeps nothing."""

    folder: Path | None

    def take(self, key: Sequence[Any], make: Callable[[], Any]) -> Any:
        """Return plain JSON values that were kept, or make and keep them."""
        if self.folder is None:
            return plain(make())
        digest = hashlib.sha256(json.dumps([FORMAT, *plain(key)]).encode()).hexdigest()
        path = self.folder / f"{digest[:24]}.json"
        if not path.exists():
            write_atomic(path, json_bytes(plain(make())))
        return json.loads(path.read_bytes())


def contestants_of(texts: Sequence[str], given: Mapping[str, Marker | Rig] | None = None) -> list[Contestant]:
    """Make contestants of 50 mm: tags by their black squares, markers of dots as they are.

    Raises
    ------
    InputError
        If one is neither a tag nor a marker that fits in a square of 50 mm.
    """
    bodies = given or {}
    wanted = list(dict.fromkeys([*texts, *OPPONENTS] if len(texts) == 1 else texts))
    return [_contestant(text, bodies.get(text)) for text in wanted]


def _contestant(text: str, body: Marker | Rig | None) -> Contestant:
    if body is None and text.partition(":")[0] in KINDS:
        made = _made(text, ROOM)
        if made.absent or not isinstance(made, Squares) or made.lattice.columns != 1:
            if made.absent:
                return made
            raise InputError("a square tag or a marker.json", text, f"name such as {', '.join(OPPONENTS)}")
        return _made(text, ROOM * SIDE / made.lattice.side)
    marker = body or load_marker_or_rig(Path(text))
    if marker.frame == "rig":
        raise InputError("a marker on one plate", f"{text}, a rig", "the protocol is for squares of 50 mm")
    left, low, right, high = marker.boundary.region.box
    if max(right - left, high - low) > SIDE * (1 + 1e-6):
        extent = f"{text} of {format_length(right - left)} x {format_length(high - low)}"
        raise InputError("a marker in a square of 50 mm", extent, "design it with --boundary rect:50mmx50mm")
    check_supported(marker, "to compare")
    return DotBody(text, marker)


def _made(text: str, radius: float) -> Contestant:
    poses = poses_from("cone:distance=1,count=1")
    return KINDS[text.partition(":")[0]](text, Arena(Setting(Circle(radius), CAMERA, poses)))


def sequence(seed: int) -> Any:
    """Poses of the protocol: all of the circle of radius `ROOM` is in view."""
    return poses_from(f"{POSES},count={IMAGES},seed={seed}").seen_whole(Circle(ROOM), CAMERA)


def fmac(
    texts: Sequence[str],
    views: int = IMAGES,
    seed: int = 0,
    print_sigma: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
    given: Mapping[str, Marker | Rig] | None = None,
    folder: Path | None = None,
    announce: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Judge markers by the protocol.

    Rivals are tuned as in `compare`, but by the product of RMS errors of rotation and translation, with
    flips as misses, in `TUNING_VIEWS` other views.

    Parameters
    ----------
    views : int
        Number of poses, from the first of the sequence, 1 to `IMAGES`.
    folder : Path or None
        Keeps tuned settings and finished parts, with which a run that was stopped, or one with more views, goes on.
    announce : callable or None
        Called with a sentence about the expected duration after the first views, and one about each contestant.

    Returns
    -------
    dict
        Plain JSON values. Each entry of ``contestants`` has its ``name``, ``size`` and ``setting``, how many views were
        ``found``, ``wrong`` or ``failed``, how many poses were ``flips``, the values of `DegreeErrors.summary` over the
        views found, ``unflipped`` the same without poses nearer to the mirrored one, and ``samples`` for plots.

    Raises
    ------
    InputError
        If a contestant is unknown or not of 50 mm, or a number out of range.
    """
    if not 1 <= views <= IMAGES:
        raise InputError(f"1 to {IMAGES} views", f"views={views}", "the protocol has so many poses")
    contestants = contestants_of(texts, given)
    if folder is not None:
        make_folder(folder)
    shelf = Shelf(folder)
    poses = sequence(seed)
    series = Series(tuple(contestants), CAMERA, poses, len(poses), seed, OPTICS, print_sigma, VIEWS)
    apart = sequence(seed + 1)
    tuning = replace(series, poses=apart, count=TUNING_VIEWS, stage=TUNING)
    present = [who for who, contestant in enumerate(contestants) if not contestant.absent]
    count = min(views, len(poses))
    if announce:
        seconds = forecast(replace(series, count=count), tuning, present, workers, {"views": observe_chunk})
        kept = ", less what --parts has kept" if folder else ""
        announce(f"the whole comparison: about {duration(seconds)}{kept}")
    common = [seed, print_sigma, asdict(OPTICS), CAMERA.as_dict(), POSES]
    identities = {who: [*_made_of(contestants[who]), *common] for who in present}
    to_tune = [(identities[who], who, range(TUNING_VIEWS)) for who in present if contestants[who].settings]
    tuned = shared(partial(_tuned, shelf), tuning, to_tune, workers, "settings", progress)
    settings = {who: ({}, []) for who in present} | {who: row for (_, who, _), row in zip(to_tune, tuned, strict=True)}
    tasks = [(identities[who], who, settings[who][0], part) for who in present for part in chunks_of(count, PART)]
    observations: dict[int, list[Observation]] = {who: [] for who in present}
    whose = [who for _, who, _, _ in tasks]
    tell = announcing(series, whose, announce or (lambda _: None), lambda rows: [*map(_observation, rows)])
    parts = shared(partial(_part, shelf), series, tasks, workers, "views", progress, tell)
    for who, rows in zip(whose, parts, strict=True):
        observations[who] += map(_observation, rows)
    entries = [
        {"name": contestant.name, "absent": contestant.absent}
        if contestant.absent
        else {
            "name": contestant.name,
            "absent": "",
            "size": contestant.size,
            "setting": contestant.describe(settings[who][0]),
            "tuning": settings[who][1],
            **_entry(series, contestant, observations[who]),
        }
        for who, contestant in enumerate(contestants)
    ]
    return {
        "protocol": "fmac",
        "camera": CAMERA.as_dict(),
        "optics": asdict(OPTICS),
        "poses": {"name": POSES, "count": len(poses)},
        "print_sigma_mm": 1e3 * print_sigma,
        "seed": seed,
        "views": {"count": count},
        "contestants": entries,
    }


def _made_of(contestant: Contestant) -> list[Any]:
    """What a contestant's pictures depend on: of a marker its dots and outline, whatever its file is called."""
    if isinstance(contestant, DotBody):
        marker = contestant.body.plates[0].marker
        return [[asdict(point) for point in marker.control_points], str(marker.boundary), marker.light]
    return [contestant.name, contestant.size]


def _tuned(shelf: Shelf, series: Series, task: tuple[list[Any], int, range]) -> tuple[Choice, list[Any]]:
    identity, who, views = task
    tables = {name: list(table) for name, table in series.contestants[who].settings.items()}
    choice, rows = shelf.take(
        ["tuning", identity, len(views), tables, POSE], lambda: tune_chunk(series, (who, views), POSE)[1:]
    )
    return choice, rows


def _part(shelf: Shelf, series: Series, task: tuple[list[Any], int, Choice, range]) -> list[dict[str, Any]]:
    identity, who, choice, views = task
    key = ["part", identity, choice, views.start, views.stop]
    rows: list[dict[str, Any]] = shelf.take(
        key,
        lambda: [
            {name: np.asarray(value).tolist() for name, value in vars(observation).items()}
            for observation in observe_chunk(series, (who, choice, views))
        ],
    )
    return rows


def _observation(row: Mapping[str, Any]) -> Observation:
    arrays = {key: np.array(row[key], dtype=float) for key in ("point_px", "error", "sigma")}
    numbers = {key: np.nan if row[key] is None else row[key] for key in ("rotation_deg", "translation_pct")}
    return Observation(**{**row, **arrays, **numbers})


def _entry(series: Series, contestant: Contestant, observations: Sequence[Observation]) -> dict[str, Any]:
    rows = np.array([k for k, observation in enumerate(observations) if observation.counts], dtype=np.intp)
    degrees = pose_degrees(series.poses.rotation[rows], series.poses.translation[rows])
    mirrored = np.array([observations[k].mirrored for k in rows], dtype=bool)
    errors, sigmas = (
        np.array([getattr(observations[k], name) for k in rows]).reshape(-1, 6) for name in ("error", "sigma")
    )
    every = DegreeErrors(degrees, errors, sigmas)
    true = DegreeErrors(degrees[~mirrored], every.errors[~mirrored], every.sigma[~mirrored])
    drawn = slice(0, SCATTERED)
    return {
        "found": len(rows),
        "rate": len(rows) / len(observations),
        "wrong": sum(observation.wrong for observation in observations),
        "failed": sum(observation.failed for observation in observations),
        "mirrored": int(mirrored.sum()),
        "flips": flips(series, contestant, observations),
        **every.summary(),
        "unflipped": true.summary(),
        "samples": {name: plain(getattr(true, name)[drawn].tolist()) for name in ("degrees", "errors", "sigma")},
        "bins": true.bins(),
    }


BLOCK = 6.4
"""Width in inches of the 36 plots of one contestant."""
NAMED = 6
"""Maximum number of correlations named for a contestant."""


class ProtocolComparison(Comparison):
    """The result of `markergen.compare` with a protocol; see `markergen.comparison.fmac.fmac` for its values."""

    def figure(self) -> "Figure":
        """See `SavableResult.figure`."""
        return degrees_figure(self._results)

    def to_frame(self) -> "DataFrame":
        """Return a pandas data frame with a row for each contestant and error: its bias and spread."""
        return data_frame(
            [
                {"name": entry["name"], "rate": entry["rate"], "flips": entry["flips"], "error": name, **values}
                for entry in self._results["contestants"]
                if not entry["absent"]
                for name, values in entry["unflipped"]["errors"].items()
            ]
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the spread of each contestant's errors, without flips.

        Parameters
        ----------
        ax : matplotlib axes or None
            Axes to draw on; None makes a new figure, available as ``ax.figure``.
        """
        axes, entries = axes_of(ax), _present(self._results)
        for entry in entries:
            spreads = [entry["unflipped"]["errors"][name]["std"] for name in ERRORS]
            axes.plot(range(len(ERRORS)), [spread or np.nan for spread in spreads], "o-", label=entry["name"])
        axes.set_yscale("log")
        axes.set_xticks(range(len(ERRORS)), ERRORS, fontsize=7)
        axes.legend()
        return axes

    def parts(self) -> list[str | Table]:
        """Return sentences and tables in the order in which the command prints them."""
        results = self._results
        tables = [
            _overview(results),
            _errors(results, "Standard deviations without flips", lambda row: number(row["std"])),
            _errors(
                results,
                "Biases without flips",
                lambda row: f"{number(row['bias'], 2)} ± {number(row['bias_sigma'], 1)}",
                "Mean error and its standard deviation.",
            ),
            _errors(results, "Standard deviations of all poses", lambda row: number(row["std"]), which=""),
            _cells(results),
        ]
        return [heading(results), *tables, *sentences(results)]

    def __repr__(self) -> str:
        names = ", ".join(entry["name"][:80] for entry in self._results["contestants"])
        return f"<Comparison by {self._results['protocol']}: {self._results['views']['count']} views; {names}>"


def _present(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [entry for entry in with_short_names(results) if not entry["absent"]]


def heading(results: Mapping[str, Any]) -> str:
    """Describe views, poses, camera and optics."""
    camera, optics, poses = results["camera"], results["optics"], results["poses"]
    return (
        f"FMAC: the first {results['views']['count']} of {poses['count']} poses ({poses['name']})\n"
        f"camera {camera['width']}x{camera['height']} with distortion, focal length {camera['fx']:g} px; "
        f"a lens of {optics['aperture_mm']:g} mm focused at {optics['focus']:g} m, diffraction at "
        f"{optics['wavelength_nm']:g} nm; noise {optics['noise_grey']:g} grey levels; "
        f"print error {results['print_sigma_mm']:g} mm"
    )


def _overview(results: Mapping[str, Any]) -> Table:
    rows = [
        [entry["name"], percent(entry["rate"]), str(entry["wrong"]), str(entry["failed"]), str(entry["flips"]),
         str(entry["mirrored"])]
        if not entry["absent"]
        else [entry["name"], "absent", *"----"]
        for entry in with_short_names(results)
    ]  # fmt: skip
    caption = (
        "Mirrored: poses nearer to the mirrored one than to the true one. Flips: those of them where the errors of the "
        "points distinguish the two."
    )
    return Table("Found", ["", "found", "wrong", "failed", "flips", "mirrored"], rows, caption)


def _errors(
    results: Mapping[str, Any],
    title: str,
    cell: Callable[[Mapping[str, Any]], str],
    caption: str = "",
    which: str = "unflipped",
) -> Table:
    rows = [
        [entry["name"], *(cell(row) for row in (entry[which] if which else entry)["errors"].values())]
        for entry in _present(results)
    ]
    return Table(title, ["", *ERRORS], rows, caption)


def _cells(results: Mapping[str, Any]) -> Table:
    rows = []
    for entry in _present(results):
        cells = entry["unflipped"]["cells"]
        if cells:
            values = [number(cells[key], 2) for key in ("least", "median", "greatest")]
            rows.append([entry["name"], *values, *(f"{cells[key]} of {cells['count']}" for key in ("above", "below"))])
    caption = (
        "Root mean square of error over claimed standard deviation, in eight parts of each degree of freedom, for each "
        "error. Above and below: outside the 99 % interval of a right covariance, about 1.4 of 288 on each side."
    )
    return Table(
        "Covariances held against errors", ["", "least", "median", "greatest", "above", "below"], rows, caption
    )


def sentences(results: Mapping[str, Any]) -> list[str]:
    """State each contestant's size and setting, and the correlations of errors and poses that stand out."""
    lines = []
    for entry in _present(results):
        named = entry["unflipped"]["standing_out"][:NAMED]
        stands = f"errors go with the pose: {correlation_words(named)}" if named else "no error goes with the pose"
        lines.append(f"{entry['name']}: {entry['size']}; {entry['setting']}; {stands}.")
    return lines


def degrees_figure(results: Mapping[str, Any]) -> "Figure":
    """Draw the 36 plots of each contestant, two contestants in a row."""
    entries = [entry for entry in _present(results) if entry["found"]]
    columns = min(2, len(entries)) or 1
    rows: int = max(1, -(-len(entries) // columns))
    figure = new_figure((columns * BLOCK, rows * BLOCK))
    blocks = figure.subfigures(rows, columns, squeeze=False).ravel()
    for block, entry in zip(blocks, entries, strict=False):
        samples = (
            np.array(entry["samples"][name], dtype=float).reshape(-1, 6) for name in ("degrees", "errors", "sigma")
        )
        block.suptitle(entry["name"], fontsize=9)
        draw_degrees(block, DegreeErrors(*samples), entry["bins"])
    return figure
