"""What a pose file says of its columns, units and frames, what a user says of them, and the poses that follow.

Names of columns, units and orders are read wherever they are: in a header, in comments, under keys. What is not known,
or contradicts the format, is refused; body frames are asked about, never assumed.
"""

# tests: tests/read/test_pose_conventions.py

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, among, brief
from markergen.units import METERS

MARKER_IN_CAMERA, CAMERA_IN_MARKER, BODY, ASKED = "marker-in-camera", "camera-in-marker", "body", "asked"
FRAMES, AXES = (MARKER_IN_CAMERA, CAMERA_IN_MARKER, BODY), ("opencv", "opengl")
"""What ``--poses-frame`` and ``--poses-axes`` take: the pose of the one in the other's frame; the camera's axes."""

READING = ("poses_frame", "poses_axes", "poses_unit", "camera_in_body")
"""Options for reading a file of poses."""

FLIP = np.diag([1.0, -1.0, -1.0])
"""Turns OpenCV's camera axes into OpenGL's, x right, y up, z backward, and back."""


class RawPoses(NamedTuple):
    """Poses as a file has them: numbers (P, 7) as in `RecordedPoses`, in the frame and axes of the file."""

    numbers: Array
    frame: str = MARKER_IN_CAMERA
    axes: str = "opencv"


@dataclass(frozen=True)
class PoseConvention:
    """What a user says of the poses of a file; None leaves it to the file.

    Attributes
    ----------
    frame : str or None
        One of `FRAMES`.
    axes : str or None
        One of `AXES`.
    unit : str or None
        Of translations, such as mm.
    camera_in_body : array (7,) or None
        Pose of the camera in the body, for the frame ``body``.
    """

    frame: str | None = None
    axes: str | None = None
    unit: str | None = None
    camera_in_body: Array | None = None

    def __post_init__(self) -> None:
        for name, choices in (("frame", FRAMES), ("axes", AXES), ("unit", tuple(filter(None, METERS)))):
            if getattr(self, name) not in (None, *choices):
                value = getattr(self, name)
                raise InputError(f"a known --poses-{name}", brief(value), among(value, choices))
        if (self.frame == BODY) != (self.camera_in_body is not None):
            alone = "--camera-in-body alone" if self.frame != BODY else "--poses-frame body alone"
            raise InputError("--poses-frame body with --camera-in-body FILE", alone, "give both, or neither")


# --- Columns ----------------------------------------------------------------------------------------------------------

_UNIT = re.compile(r"\s*[\[(]\s*([^\])]*)\s*[\])]\s*$|_(mm|cm|m|um|in|ft|deg|rad|km|inch|inches)$", re.IGNORECASE)
_PLACE = re.compile(
    r"(?:.*[._ /])?(?:p|t|pos|position|tvec|trans|translation|loc|location|p_\w+)[._ /]?([xyz])|([xyz])"
)
_TURN = re.compile(r"(?:.*[._ /])?(?:q|quat|quaternion|ori|orient|orientation|rotation|q_\w+)[._ /]?([wxyz])|q?(w)")
_AXIS = re.compile(r"(?:rotvec|rodrigues|r|rv|rvec)[._]?([xyz])")
_ENTRY = re.compile(r"r_?([123])_?([123])")
_TIME = re.compile(
    r"(.*[._ /])?(t|time|times|timestamp|timestamps|stamp|sec|secs|nsec|nsecs|nanosec)s?([._ ].*)?|%time"
)
IGNORED = re.compile(
    r"(id|index|idx|frame|image|image_?name|name|seq|file|filename|camera_?id|device_?id|frame_?id|child_frame_?id|label)|"
    r".*header.*|.*covariance.*|.*twist.*|v_\w+_[xyz]|b_[wa]_\w+_[xyz]|.*(velocity|bias).*|.*confidence.*|.*status.*"
)
"""Columns that do not change a pose."""

BODY_COLUMN = re.compile(r"[pq]_\w+_\w*[wxyz]\b|.*\bbody\b.*|.*\bimu\b.*")
ASKED_COLUMN = re.compile(
    r"(field\.|/?\w*pose[./]|.*[./]pose[./]|transform[./]|.*[./]transform[./]).*|"
    r"(.*[._ /])?(pos|position|loc|location)[._ /]?x.*"
)
"""Columns of a pose of anything in anything."""

ANGLES = ("rad", "radian", "radians", "deg", "degree", "degrees")
_PREFIXES = {"": "m", "milli": "mm", "centi": "cm", "micro": "um"}
_OTHER_UNITS = {"micron": "um", "microns": "um", "inch": "in", "inches": "in", "feet": "ft", "foot": "ft"}


def length_unit(word: str) -> str | None:
    """Return the unit of length that a word names; None if it names none."""
    plain = word.strip().strip("\"'.").lower()
    metric = re.fullmatch(r"(milli|centi|micro|)met(?:er|re)s?", plain)
    unit = _PREFIXES[metric[1]] if metric else _OTHER_UNITS.get(plain, plain)
    return unit if unit in METERS and unit else None


class Column(NamedTuple):
    """What a column holds: tx, qw, rx, r11 and so on, time, ignored or "" if it is not known; and its unit or ""."""

    kind: str
    unit: str


def plain_name(name: str) -> tuple[str, str]:
    """Return the name of a column in lower case without its unit, and the unit or ""."""
    plain = name.strip().strip("\"'#").strip().lower()
    if (match := _UNIT.search(plain)) and match.start() > 0:
        return plain[: match.start()].strip(), (match[1] if match[1] is not None else match[2]).strip()
    return plain, ""


def column_of(name: str) -> Column:
    """Return what a column holds, from its name in any program's spelling."""
    plain, unit = plain_name(name)
    for pattern, prefix in ((_PLACE, "t"), (_TURN, "q"), (_AXIS, "r")):
        if (match := pattern.fullmatch(plain)) and (plain != "t" or prefix != "t"):
            return Column(prefix + next(filter(None, match.groups())), unit)
    if match := _ENTRY.fullmatch(plain):
        return Column(f"r{match[1]}{match[2]}", unit)
    if _TIME.fullmatch(plain):
        return Column("time", unit)
    return Column("ignored" if IGNORED.fullmatch(plain) else "", unit)


def is_body(name: str) -> bool:
    """True if a column may be that of a body, such as an IMU, as those of EuRoC are."""
    return BODY_COLUMN.match(name.strip().lstrip("#").strip().lower()) is not None


def unit_of(units: Iterable[str], place: str) -> str:
    """Return the unit of length that columns share; "" if none states one."""
    stated_units = set(units) - {""}
    lengths = {length_unit(unit) for unit in stated_units}
    if len(lengths) > 1 or None in lengths:
        problem = brief(", ".join(sorted(stated_units)))
        raise InputError(f"one known unit of length at {place}", problem, "correct the header")
    return str(lengths.pop()) if lengths else ""


# --- Statements -------------------------------------------------------------------------------------------------------

_Q = r"q?[_ ]?(?:quat(?:ernion)?[_ .]?)?"
_S, _CAM = r"[\s,;|/]*", r"cam(?:era)?s?"
_TO = r"(?:[- _]?(?:to|2)[- _]?(?:the )?|\s*-+>\s*)"
_IN = r"(?:[- _]+(?:poses?|positions?))?[- _](?:in|wrt|relative to|with respect to)[- _](?:the )?"
_WORLD = r"(?:world|marker|map|global)"
STATEMENTS: list[tuple[str, str, str]] = [
    ("order", "wxyz", rf"\b({_Q})w{_S}\1x{_S}\1y{_S}\1z\b|\b(?:scalar|real|w)(?: part)?[- ]first"),
    ("order", "xyzw", rf"\b({_Q})x{_S}\1y{_S}\1z{_S}\1w\b|\b(?:scalar|real|w)(?: part)?[- ]last"),
    ("frame", MARKER_IN_CAMERA, rf"\bworld{_TO}cam|\b{_WORLD}{_IN}cam|\b{_CAM}[- _]from[- _]world|"
     rf"\bT_?c(?:am(?:era)?)?_?(?:w(?:orld)?|m(?:arker)?)\b|\bw2c\b|\binver(?:se|ted)"),
    ("frame", CAMERA_IN_MARKER, rf"\b{_CAM}{_TO}world|\b{_CAM}{_IN}{_WORLD}|"
     rf"\bT_?w(?:orld)?_?c(?:am(?:era)?)?\b|\bworld[- _]from[- _]cam|\bc2w\b"),
    ("frame", BODY, r"\bimu\b|\bbody\b|\bbase_?link\b|\bgripper|\bend[- _]?effector|\btool0?\b|"
     r"\bT_?w(?:orld)?_?(?:b|i|imu|body)\b"),
    ("axes", "opengl", r"\bopen[- ]?gl\b|\bblender\b|\bnerf\b|\by[- ]up\b|\bz[- ]backward"),
    ("axes", "opencv", r"\bopen[- ]?cv\b|\by[- ]down\b|\bz[- ]forward"),
    ("angle", "deg", r"\b(?:in )?degrees?\b|\bdeg\b"),
]  # fmt: skip
"""Aspect, value, and how comments and keys state it, in any case."""

OTHERS = (
    (r"\bjpl\b", "Hamilton's quaternions", "JPL's", "write the conjugates, with x y z negated"),
    (r"\bleft[- ]?handed|\bunity ?3d|\b(?:unity|unreal)(?:'s)? (?:engine|coord|axes|frame)", "right-handed frames",
     "left-handed ones", "convert them"),
)  # fmt: skip
"""What comments state and readers do not convert: form, what was expected, what it is, what to do."""

_UNIT_WORD = re.compile(r"\b(mm|cm|um|millimet\w+|centimet\w+|micromet\w+|microns?|inch(?:es)?|feet)\b", re.IGNORECASE)
_UNIT_KEY = re.compile(
    r"\bunits?(?:[_ ]of[_ ]length)?\s*(?:[:=]|is|are)\s*[\"']?([A-Za-z]+)|\bin ([A-Za-z]+ters?)\b", re.IGNORECASE
)


def stated(texts: Iterable[str], place: str) -> dict[str, str]:
    """Return what texts such as comments state: order, frame, axes, unit, angle; raises InputError if they disagree."""
    statements: dict[str, str] = {}
    for text in texts:
        for form, expected, problem, remedy in OTHERS:
            if re.search(form, text, re.IGNORECASE):
                raise InputError(f"{expected} in {place}", problem, remedy)
        here = [(aspect, value) for aspect, value, form in STATEMENTS if re.search(form, text, re.IGNORECASE)]
        units = [match[1] or match[2] for match in _UNIT_KEY.finditer(text)] + _UNIT_WORD.findall(text)
        for word in units:
            if (unit := length_unit(word)) is None and word.lower() not in ANGLES:
                raise InputError(f"a known unit of length in {place}", brief(word), f"known: {', '.join(METERS)[2:]}")
            here += [("unit", unit)] if unit else []
        for aspect, value in here:
            if (before := statements.setdefault(aspect, value)) != value:
                problem = f"{before} and {value}"
                raise InputError(f"one {aspect} of the poses in {place}", problem, "remove the wrong comment")
    return statements


# --- Poses ------------------------------------------------------------------------------------------------------------


def scale_of(convention: PoseConvention, unit: str, place: str) -> float:
    """Return the length in m of a file's unit: the one it states, or else the user's, or else 1."""
    if unit and convention.unit and unit != convention.unit:
        raise InputError(f"poses in {convention.unit} in {place}", f"{unit} in the file", "leave out --poses-unit")
    return float(METERS[unit or convention.unit or ""])


REASONS = {
    BODY: "poses that may be those of a body or of a camera",
    MARKER_IN_CAMERA: "a comment about world to camera",
    CAMERA_IN_MARKER: "a comment about camera to world",
}
"""Why users are asked for the frame, by what a file states."""


def settled_frame(
    convention: PoseConvention, raw: RawPoses, statements: Mapping[str, str], file: str
) -> tuple[str, str]:
    """Return frame and axes of poses: the user's, or else those of the format unless the file states others."""
    frame, axes = convention.frame or raw.frame, convention.axes or raw.axes
    if convention.frame is None and (raw.frame == ASKED or statements.get("frame", frame) != frame):
        reason = statements.get("frame", "body" if raw.frame == ASKED else frame)
        remedy = f"give {MARKER_IN_CAMERA}, {CAMERA_IN_MARKER}, or body with --camera-in-body FILE"
        raise InputError(f"--poses-frame for {file}", REASONS[reason], remedy)
    if convention.axes is None and statements.get("axes", axes) != axes:
        raise InputError(f"--poses-axes for {file}", f"a comment about {statements['axes']}", "give opencv or opengl")
    return frame, axes


def camera_in_marker(numbers: Array, axes: str = "opencv") -> Array:
    """Convert T_camera_marker (P, 7) with OpenCV's axes to the camera in the marker, with these axes."""
    from scipy.spatial.transform import Rotation

    # The inverse is its own inverse; flipped axes are those of its columns.
    back = marker_in_camera(numbers, CAMERA_IN_MARKER, "opencv")
    if axes == "opengl":
        back[:, 3:] = (Rotation.from_quat(back[:, 3:]) * Rotation.from_matrix(FLIP)).as_quat(canonical=True)
    return back


def marker_in_camera(numbers: Array, frame: str, axes: str, camera_in_body: Array | None = None) -> Array:
    """Convert poses (P, 7) of a frame and axes to T_camera_marker with OpenCV's axes."""
    if frame == MARKER_IN_CAMERA and axes == "opencv":
        return numbers
    from scipy.spatial.transform import Rotation

    rotation, translation = Rotation.from_quat(numbers[:, 3:]), numbers[:, :3]
    flip = Rotation.from_matrix(FLIP)
    if frame == BODY:
        assert camera_in_body is not None
        translation = translation + rotation.apply(camera_in_body[:3])
        rotation = rotation * Rotation.from_quat(camera_in_body[3:])
    if frame != MARKER_IN_CAMERA:
        # of T_marker_camera the camera's axes are columns.
        rotation = (rotation * flip if axes == "opengl" else rotation).inv()
        translation = -rotation.apply(translation)
    elif axes == "opengl":
        rotation, translation = flip * rotation, flip.apply(translation)
    return np.round(np.concatenate([translation, rotation.as_quat(canonical=True)], axis=-1), 12) + 0.0


def frame_of_columns(names: list[str]) -> str:
    """Return the frame of poses with these columns; poses over time may be those of a camera, a body or a marker."""
    open_names = any(is_body(name) or ASKED_COLUMN.fullmatch(name.strip().lower()) for name in names)
    return ASKED if open_names or "time" in (column_of(name).kind for name in names) else MARKER_IN_CAMERA
