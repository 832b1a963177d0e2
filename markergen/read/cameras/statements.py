"""What a camera file says besides its numbers: the lens, by a known name under any key, units and conventions.

Every key is used, known to be irrelevant, or reported. What is unknown or contradicts itself is refused.
"""

# tests: tests/read/test_camera_statements.py

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.maths.lenses import LENSES
from markergen.model.camera import Camera
from markergen.read.cameras.document import KEYS, NAMED, Document, Fields, endings_of, plain, tables_in
from markergen.read.remarks import remark_unused

BY_COUNT, ANY = "by count", "any"
"""What a name leaves open: which of OpenCV's models, by the number of coefficients; or everything."""

NAMES = {
    **dict.fromkeys(("opencv", "brown", "brownconrady", "polynomial", "standard", "perspective", "rectilinear"),
                    BY_COUNT),
    **dict.fromkeys(("pinhole", "simplepinhole", "pinholecamera", "camera", "frame", "mono", "monocular", "hd", "vga",
                     "rgb", "color", "gray"), ANY),
    **dict.fromkeys(("nodistortion", "undistorted", "rectified", "linear"), "none"),
    **dict.fromkeys(("radialtangential", "radialtan", "radial", "simpleradial", "pinholeradtan", "opencv4", "opencv5",
                     "plumbbob"), "radtan"),
    **dict.fromkeys(("opencv8", "fullopencv", "rationalpolynomial", "pinholeradtan8", "radtan8"), "rational"),
    **dict.fromkeys(
        ("opencvfisheye", "pinholeequi", "pinholeequidistant", "kannalabrandt", "kannalabrandt4", "kannalabrandt8",
         "kb", "kb4", "kb8", "fisheyeopencv", "fisheyeequidistant", "equidistantfisheye"), "equidistant"),
}  # fmt: skip
"""Names of lenses in other programs, besides `LensModel.aliases`; without case, marks and words such as *model*."""

REFUSED = {
    **dict.fromkeys(("mei", "omni", "omnidirectional", "ucm", "unified", "catadioptric"), "unified camera (Mei)"),
    **dict.fromkeys(("eucm", "extendedunified"), "extended unified camera"),
    **dict.fromkeys(("ds", "doublesphere"), "double sphere"),
    **dict.fromkeys(("fov", "atan", "fovdistortion"), "field-of-view lens"),
    **dict.fromkeys(("scaramuzza", "ocam", "ocamcalib"), "Scaramuzza's polynomial"),
    **dict.fromkeys(("inversebrownconrady", "modifiedbrownconrady", "ftheta"), "RealSense lens"),
    **dict.fromkeys(("stereographic", "equisolid", "equisolidangle", "orthographic", "equirectangular", "spherical"),
                    "projection that is not modeled"),
    **dict.fromkeys(("radialdivision", "division", "simpledivision"), "division model"),
    **dict.fromkeys(("thinprism", "thinprismfisheye", "radtanthinprismfisheye", "opencv12", "opencv14", "fisheye624"),
                    "lens with thin prisms"),
    **dict.fromkeys(("cahv", "cahvor", "cahvore"), "CAHVOR camera"),
    "splinedstereographic": "splined lens of mrcal",
}  # fmt: skip
"""Names of lenses that are not modeled, unless a plug-in has one of the name."""

DEPTHAI = {"0": "perspective", "1": "fisheye", "2": "equirectangular"}
"""Lenses by their numbers under the key cameraType."""

GENERAL = {"none", "linear", "opencv", "camera", "standard", "polynomial", "frame", "mono", "monocular", "perspective",
           "rectified", "ds", "fov", "unified", "spherical", "division", "kb", "brown", "pinhole"}  # fmt: skip
"""Names that mean a lens only under a key that is about one."""

ABOUT_LENS = re.compile(
    r"distort|lens|model|projection|camera_?type|calibration_?type|fish_?eye|"
    r"(^|(cam|intrin|calib|optic)[^.]*\.(\d+\.)?)type$",
    re.IGNORECASE,
)
LABEL = re.compile(
    r"name|title|note|comment|desc|serial|label|product|sensor|manufacturer|brand|make$|topic|frame_?id|path|file",
    re.IGNORECASE,
)
"""Keys that are about the lens, and keys whose text names a thing."""

IRRELEVANT = re.compile(
    r"date|time|version|error|rms|board|square|pattern|grid|n_?frames|nr_of|frames_?count|views?$|name|title|note|comment|desc|"
    r"serial|label|extrinsic|rvec|tvec|flags?$|^id$|_id$|fps|topic|image_?points|object_?points|rectification|^[rpt]$|"
    r"projection_?matrix|header|overlaps|^t_?c|^t_?i|timeshift|std_?dev|camera_?parameters|covariance|residual|observations|"
    r"calobject|^criteria|frame_?id|software|tool|author|copyright|schema|hash|uuid|guid|license|url|num_?images|image_?list|"
    r"extrinsic|translation|rotation_?(matrix|vector)s?$|stereo|baseline|^cam\d+$|hfov|vfov|lens_?position|"
    r"do_rectify|^rate|sensor_type|^t_\w|local_transform|fix_|corner|^rotation$|^projection$|_rect_|depth_scale|setup|color_order|"
    r"feature|orbextractor|metadata|camera_?poses|calibrator|calibrated_by|^[rt]_\d+$|blur_score|"
    r"^dt$|world_?units|^type_id$|^camera$|rt_cam|icam|valid_intrinsics|imu|accel|gyro|vignette|mocap",
    re.IGNORECASE,
)
"""Keys that do not change a camera: when, with what and how well it was calibrated, names, poses, what is rectified."""

UNITS = re.compile(r"^(unit|units|.*_unit|.*_units)$", re.IGNORECASE)
PIXELS = re.compile(r"px|pix|pixels?", re.IGNORECASE)
ORIGIN = re.compile(
    r"pixel_?(cent(er|re)s?|origin|offset|convention)|principal_?point_?convention|^convention|axes$", re.IGNORECASE
)
CENTERS = re.compile(r"0|0\.0|integers?|cent(er|re)s?|opencv|ros", re.IGNORECASE)
NOT_ZERO = re.compile(r"skew|alpha_?c|^gamma$|shear", re.IGNORECASE)
COMMENT = re.compile(r"\b(fish-?eye|equidistant|kannala\w*|omni\w*|double.sphere|mei|ucm)\b", re.IGNORECASE)
ORDER = re.compile(r"\bk_?1(?:[\s,;:|/'\"()\[\]]+[kp]_?\d\b){3,}", re.IGNORECASE)
"""Names of four coefficients or more, one after the other."""
MOST_TABLES = 100
"""Number of tables of a file without a camera that are searched for the name of a lens."""
SWITCH = re.compile(r"[01]|true|false|yes|no|on|off|", re.IGNORECASE)
TERMS = frozenset(map(plain, (*NAMED, *KEYS["coefficients"])))
"""Values of keys such as is_fisheye, and keys of coefficients, which beside *fisheye* are those of one."""
_PREFIX = re.compile(
    r"^(lensmodel|rsdistortion|rs2distortion|distortion|cameramodel|projection|cv2?)|(camera)?(model|lens|distortion|projection)$|"
    r"order\d+nx\d+.*"
)


def lens_name(text: str) -> str | None:
    """Return the model that a text names, `BY_COUNT` or `ANY`; None if it is not known, nor one to be refused."""
    word = plain(text)
    for name in (word, _PREFIX.sub("", word)):
        for model in LENSES:
            if name in map(plain, (model, *LENSES[model].aliases)):
                return model
        if name in NAMES:
            return NAMES[name]
    return None


def stated_lens(table: Fields) -> tuple[str, str]:
    """Return the lens that some key names, and its place: "" without a name, `BY_COUNT`, or a model.

    Raises InputError if two keys name different lenses, or one names a lens that is not known or not modeled.
    """
    stated: dict[str, str] = {}
    unknown: list[tuple[str, str]] = []
    for key, value in table.values.items():
        if (model := _lens_at(table, key, value, unknown)) is not None:
            stated.setdefault(model, table.place(key))
            table.used.add(table.path_of(key))
    models = [model for model in stated if model != ANY]
    definite = [model for model in models if model != BY_COUNT]
    if len(definite) > 1 or (models and BY_COUNT in models and "equidistant" in models):
        first, second = (definite + [BY_COUNT])[:2]
        remedy = "remove the wrong one"
        raise InputError(f"one lens at {stated[first]}", f"another at {stated[second]}", remedy)
    if unknown and (not definite or _is_refused(unknown[0][1])):
        place, name = unknown[0]
        names = ", ".join(dict.fromkeys(word for model in LENSES for word in (model, *LENSES[model].aliases)))
        kind = REFUSED.get(plain(name)) or REFUSED.get(_PREFIX.sub("", plain(name)), "")
        remedy = "calibrate with one of these, or remove the key if it names no lens"
        problem = f"{brief(name)}{kind and f', a {kind}'}"
        raise InputError(f"a known distortion model at {place}", problem, f"known: {names}; {remedy}")
    best = next(iter([*definite, *models, *stated]), "")
    return ("" if best == ANY else best), stated.get(best, "")


def _is_refused(name: str) -> bool:
    return not {plain(name), _PREFIX.sub("", plain(name))}.isdisjoint(REFUSED)


def _lens_at(table: Fields, key: str, value: Any, unknown: list[tuple[str, str]]) -> str | None:
    """Return the lens that a key names; names that are not known are added to `unknown`."""
    about, is_label = ABOUT_LENS.search(key) is not None, LABEL.search(_last(key)) is not None
    is_fisheye = re.search(r"fish_?eye", key, re.IGNORECASE) is not None
    if is_fisheye and TERMS.intersection(endings_of(key)):
        return "equidistant"
    if not isinstance(value, str | bool | int | float) or (is_label and not about):
        return None
    text = str(value).strip().strip("\"'")
    if plain(_last(key)) == "cameratype" and text in DEPTHAI:
        text = DEPTHAI[text]
    if SWITCH.fullmatch(text):
        return None if not is_fisheye else "equidistant" if text.lower() in ("1", "true", "yes", "on") else BY_COUNT
    word = plain(text)
    bare = _PREFIX.sub("", word)
    if not text or re.fullmatch(r"[-+\d.eE\s,]*", text) or (bare in GENERAL and not about):
        return None
    for name in (word, bare):
        if name in REFUSED and lens_name(name) is None:
            unknown.insert(0, (table.place(key), text))
            return None
    if (model := lens_name(text)) is None and about and not is_label and len(text) <= 200:
        unknown.append((table.place(key), text))
    return model


def refuse_lenses(document: Document) -> None:
    """Refuse a file without a camera by the lens that it names, if it is known and not modeled."""
    try:
        tables = [document.fields]
    except InputError:  # No keys and values.
        return
    for table in tables:
        tables += [Fields(table.file, inner, table.path_of(key)) for key, value in table.values.items()
                   for _, inner in tables_in(value) if len(tables) < MOST_TABLES]  # fmt: skip
        refused = any(isinstance(value, str) and _is_refused(value) for value in table.values.values())
        if refused:
            stated_lens(table)


def check_statements(table: Fields) -> None:
    """Refuse other units than pixels, skew, and other places of pixel centers than integers."""
    for key, value in table.values.items():
        text, name = str(value).strip().strip("\"'") if isinstance(value, str | int | float) else None, _last(key)
        for keys, values, expected in (
            (UNITS, PIXELS, "px as the unit"),
            (ORIGIN, CENTERS, "pixel centers at integers, as OpenCV has them,"),
        ):
            if text is not None and keys.search(name):
                if not values.fullmatch(text):
                    raise InputError(f"{expected} at {table.place(key)}", brief(text), "convert the file")
                table.used.add(table.path_of(key))
        if text is not None and NOT_ZERO.search(name) and re.fullmatch(r"[-+\d.eE]+", text):
            if float(text) != 0:
                raise InputError(f"no skew at {table.place(key)}", text, "calibrate without skew")
            table.used.add(table.path_of(key))


def _last(key: str) -> str:
    return key.rpartition(".")[2]


def remark_unused_keys(document: Document, camera: Camera) -> None:
    """Report in one line the keys of a file that are neither used nor known to be irrelevant."""
    unused = (item for table in document.tables if table.used for item in table.unused())
    names = [path for path, value in unused if not _irrelevant(path, value)]
    text = document.data.decode("utf-8", "replace")
    if camera.distortion.model != "equidistant" and COMMENT.search(text):
        comments = [line.strip() for line in text.splitlines() if line.lstrip()[:1] in ("#", "<")]
        names += [
            f"the comment {brief(line)}" for line in comments if COMMENT.search(line) and line[:2] in ("# ", "<!")
        ]
    remark_unused(document.name, names)


def check_order(document: Document, camera: Camera) -> None:
    """Refuse a file whose comments or keys list coefficients in another order than that of the lens."""
    text = document.data.decode("utf-8", "replace").lower()
    orders = [re.findall(r"[kp]\d", match[0].replace("_", "")) for match in ORDER.finditer(text)]
    names = list(camera.distortion.names)
    is_known = bool(names) and all(re.fullmatch(r"[kp]\d", name) for name in names)
    if is_known and orders and not any(order[: len(names)] == names[: len(order)] for order in orders):
        expected = f"coefficients in the order {' '.join(names)} in {document.name}"
        raise InputError(expected, f"the order {' '.join(orders[0])} in its text", "reorder them")


def _irrelevant(path: str, value: Any) -> bool:
    key = path.rpartition(".")[2]
    # A label that is a lens's name may be meant as one.
    if isinstance(value, str) and plain(value) not in GENERAL and lens_name(value) not in (None, ANY):
        return False
    if key == "type" and re.fullmatch(r"\d+", str(value)):  # Of a matrix's elements.
        return True
    return IRRELEVANT.search(key) is not None or value in ("", [], {}, "null")


# --- Plausibility -----------------------------------------------------------------------------------------------------

OFF_CENTER = 0.1
"""Largest usual distance of a principal point from the center, as a share of the diagonal: cameras without shift have
0.03 at most; width and height exchanged give 0.2 for 16:9."""
TANGENTIAL, RADIAL = 0.02, 1000.0
"""Largest usual |p1|, |p2|, and |k|: lenses have 0.005 and 100; k3 in the place of p1 is seldom below 0.02."""
ANISOTROPIC = 1.1
"""Largest usual ratio of the focal lengths: pixels are square to 1 %."""


def doubts(camera: Camera) -> Iterator[str]:
    """Yield what is unusual about a camera, with its likely cause."""
    size = np.array([camera.width, camera.height])
    off = np.array([camera.cx, camera.cy]) - (size - 1) / 2
    share = float(np.hypot(*off) / np.hypot(*size))
    if share > OFF_CENTER:
        swapped = np.hypot(*(np.array([camera.cx, camera.cy]) - (size[::-1] - 1) / 2)) < np.hypot(*off) / 2
        cause = (
            "are width and height exchanged?"
            if swapped
            else "is it the calibration of another resolution or of a part?"
        )
        yield f"the principal point is {100 * share:.0f} % of the diagonal off the center: {cause}"
    ratio = max(camera.fx / camera.fy, camera.fy / camera.fx)
    if ratio > ANISOTROPIC:
        yield f"fx and fy differ by a factor of {ratio:.3g}: was the image stretched?"
    terms = dict(zip(camera.distortion.names, camera.distortion.coefficients, strict=True))
    large = [name for name, value in terms.items() if abs(value) > (TANGENTIAL if name[0] == "p" else RADIAL)]
    if large:
        values = ", ".join(f"{name} {terms[name]:.4g}" for name in large)
        yield f"{values}: is the order of the coefficients {' '.join(terms)}?"
    if folded := folded_share(camera):
        yield f"the lens folds inside the image: {100 * folded:.0f} % of its border is beyond what the model covers"


def folded_share(camera: Camera) -> float:
    """Share of the image's border that no ray reaches."""
    x, y = np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 33)
    sides = [np.stack(np.broadcast_arrays(x, edge), axis=-1) for edge in (0.0, camera.height - 1.0)]
    sides += [np.stack(np.broadcast_arrays(edge, y), axis=-1) for edge in (0.0, camera.width - 1.0)]
    return float(np.isnan(camera.from_pixels(np.concatenate(sides))).any(axis=-1).mean())
