"""Formats of files: recognized by content, written by the ending of a name; and those that are not read."""

# tests: tests/read/test_programs.py tests/api/test_inspect.py

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from markergen.errors import InputError, brief
from markergen.files import exists
from markergen.registry import Registry

F = TypeVar("F")
R = TypeVar("R")
W = TypeVar("W")


@dataclass(frozen=True)
class Format(Generic[F, R, W]):
    """A format of files, recognized by content.

    Attributes
    ----------
    signs : str
        Typical contents of such a file, for the message that no format fits.
    fits : callable
        True if a file has this format; true for at most one format if it is usable.
    read : callable
        Makes what is read from a file and, but for poses, the name of a camera or layer in it, or None.
    endings : tuple of str
        Endings of the names of files that are written in this format, in lower case; the longest of all formats counts.
    write : callable or None
        Makes the text of a file from its contents and the ending; None if it is only read.
    """

    signs: str
    fits: Callable[[F], bool]
    read: Callable[..., R]
    endings: tuple[str, ...] = ()
    write: Callable[[W, str], str] | None = None


T = TypeVar("T", bound=Format[Any, Any, Any])


def recognized(formats: Registry[T], file: object) -> str | None:
    """Return the name of the format that a file has, if any; raises InputError if one says why it has none."""
    damages = []
    for name in formats:
        try:
            if formats[name].fits(file):
                return name
        except InputError as error:  # Another format may not be what is damaged.
            damages.append(error)
    if damages:
        raise damages[-1]
    return None


def unknown_format(formats: Registry[T], file: str, what: str) -> InputError:
    """Return the error that a file has none of the formats."""
    signs = {name: formats[name].signs for name in formats}
    listed = "; ".join(name if name == sign else f"{name}: {sign}" for name, sign in signs.items())
    return InputError(f"{what} in {file}", "an unknown format", f"known formats: {listed}")


def written_format(formats: Registry[T], what: str, path: str | os.PathLike[str]) -> tuple[T, str]:
    """Return the format that a file's name stands for, and its ending, of which the longest counts.

    Raises InputError if there is none, with the known endings.
    """
    endings = {ending: form for name in formats if (form := formats[name]).write for ending in form.endings}
    name = Path(path).name
    for ending in sorted(endings, key=len, reverse=True):
        if name.lower().endswith(ending):
            return endings[ending], ending
    raise InputError(f"a name for {what}", brief(name), f"known endings: {', '.join(sorted(endings))}")


def written(formats: Registry[T], what: str, contents: object, path: str | os.PathLike[str]) -> bytes:
    """Return contents as a file of the format that its name stands for."""
    form, ending = written_format(formats, what, path)
    assert form.write is not None
    return form.write(contents, ending).encode()


def split(text: str) -> tuple[str, str | None]:
    """Split ``path#NAME`` into a path and the name of a camera or layer in its file, if there is one."""
    path, mark, name = text.rpartition("#")
    return (path, name) if mark and Path(path).name and not exists(Path(text)) else (text, None)


_ARRAYS = "in Python, Camera.from_cv2(K, D, (width, height)).save('camera.yaml') writes one that is read"
_OPENCV = "export it as OpenCV's XML or YAML, or calibrate with OpenCV"
_COLMAP = "convert it to COLMAP, and give cameras.txt"
_TABLE = "write them as a table with tx ty tz qx qy qz qw, or as lines of TUM"
_DRAWING = "export the outline as SVG or DXF"

UNREADABLE: dict[str, list[tuple[bytes, str, str]]] = {
    "camera": [
        (rb"\"control_points\"\s*:", "a marker", "give the file of the camera that it was designed for"),
        (rb"\A\x93NUMPY", "a NumPy array, without an image size", _ARRAYS),
        (rb"\APK\x03\x04", "an archive such as .npz", _ARRAYS),
        (rb"\A\x80[\x02-\x05]", "a Python pickle, which may run programs", _ARRAYS),
        (rb"\AMATLAB \d", "a MAT-file", "cameraIntrinsicsToOpenCV of MATLAB gives K and D: write them as YAML"),
        (rb"^\s*fc\s*=\s*\[", "Calib_Results.m", "write fc and cc as camera_matrix, kc as distortion_coefficients"),
        (rb"\A#ROSBAG", "a ROS bag", "save one message: rostopic echo -n 1 /camera/camera_info > camera.yaml"),
        (rb"\ASQLite format 3", "a database", "save one camera_info of a ROS bag, or cameras.txt of COLMAP"),
        (rb"<projection>|<chunks?\b|<calibration class|agisoft", "a calibration of Agisoft Metashape", _OPENCV),
        (rb"\"sfm_data_version\"|\"featuresFolders\"", "a scene of OpenMVG or Meshroom", _COLMAP),
        (rb"\A# Bundle file", "a scene of Bundler", _COLMAP),
        (rb"DIRECT mapping function|<poly\b.*ocam", "OCamCalib's polynomial", "calibrate with cv2.fisheye"),
        (rb"^\s*Intrinsic of \"", "all intrinsics of a RealSense", "write one as JSON: width, height, fx, fy, ppx..."),
        (rb"xcr:\w+=", "a camera of RealityCapture or RealityScan", _COLMAP),
        (rb"CamType:|\AParGroup", "camera parameters of HALCON", "cam_par_to_cam_mat gives K: write it as YAML"),
        (rb"^#\s*Focal Length mm", "a camera of Pix4D", "write its lengths in px as fx, fy, cx, cy in YAML"),
        (rb"\ANVM_V\d", "a scene of VisualSFM", _COLMAP),
        (rb"VICON_RADIAL|<intrinsic [^>]*focallength", "a calibration of Vicon or Qualisys", _OPENCV),
        (rb"<lensdatabase", "lenses of lensfun, whose models are others", "calibrate with OpenCV"),
        (rb"<sdf\b|<robot\b|<mujoco\b", "a simulator's model", "save one message of its camera_info topic"),
        (rb"cameraParameters with properties", "what MATLAB prints", "write jsonencode(toStruct(params)) to a file"),
        (rb"CALIBRATION_LensDistortionModel", "a raw calibration of an Azure Kinect", "save its ROS camera_info"),
        (rb"\"img_name\"\s*:", "cameras of a Gaussian splatting, without centers", _COLMAP),
        (rb"\"sensor_token\"\s*:", "sensors of nuScenes", "write one camera_intrinsic alone as JSON"),
        (rb"\ABLENDER", "a scene of Blender", "write its sensor as fx, fy, cx, cy in px as YAML"),
        (rb"\A\x89HDF", "an HDF5 file", _ARRAYS),
        (rb"aslam_cv\.libaslam", "results of Kalibr for people", "give its camchain.yaml"),
        (rb"libCalib::CameraModel", "a project of calib.io", _OPENCV),
        (rb"\"FOV_Degrees\"|\"image_size_x\"", "a camera of AirSim or CARLA", "write fx = width / (2 tan(fov / 2))"),
        (rb"\AP0: ", "KITTI's rectified projections", "give calib_cam_to_cam.txt, or write fx, fy, cx, cy, size"),
        (rb"\"CameraCalibrations\"", "a calibration of Aria, with thin prisms", "calibrate its images with OpenCV"),
        (rb"CAHVORE?\b|^Model = CAHV", "a CAHVOR camera", "convert it to mrcal's LENSMODEL_OPENCV8"),
    ],
    "poses": [
        (rb"^VERTEX_SE3:QUAT ", "a graph of g2o", _TABLE),
        (rb"\A\W*Format Version,", "a take of Motive", _TABLE),
        (rb"\ANO_OF_FRAMES", "a file of Qualisys", _TABLE),
        (rb"\"shots\"\s*:", "a reconstruction of OpenSfM", _TABLE),
        (rb"\"img_name\"\s*:", "cameras of a Gaussian splatting", "give images.txt of COLMAP"),
        (rb"\A#name,x,y,alt", "a registration of RealityCapture", _TABLE),
        (rb"^\s*(?:pose|position|translation):\s*$", "messages of ROS as YAML", _TABLE),
        (rb"\A\x93NUMPY", "an array of another shape", "save matrices (k, 4, 4), or a table with tx ty tz qx qy qz qw"),
        (rb"\A(?:PK\x03\x04|\x80[\x02-\x05]|MATLAB \d|\x89HDF)", "arrays of another program", _TABLE),
        (rb"\A#ROSBAG|\ASQLite format 3", "a bag or database", _TABLE),
        (rb"\A# Bundle file|\ANVM_V\d|\"sfm_data_version\"|<chunks?\b", "a scene of another program", _TABLE),
    ],
    "outline": [
        (rb"\A%PDF|\A%!PS|\AII\xbc|\A\xc5\xd0\xd3\xc6", "a PDF, EPS or Illustrator file", _DRAWING),
        (rb"\AISO-10303|\ADBRep_DrawableShape|\A(?:solid|facet)\b", "a solid", "project its outline: SVG or DXF"),
        (rb"\A(?:\x89PNG|\xff\xd8\xff|GIF8|BM|II\*|MM\0\*|RIFF....WEBP)", "a picture", "trace it, as Inkscape can"),
        (rb"\A(?:G04|%FS|%MO|M48)", "Gerber or drill data", "export Edge.Cuts as SVG or DXF, or give the .kicad_pcb"),
        (rb"<eagle\b|<LightBurnProject|<kml\b|<gpx\b|<mxfile\b", "a drawing of another program", _DRAWING),
        (rb"\AAC10\d\d", "DWG", "save it as DXF"),
        (rb"\A\(kicad_(?:sch|sym|pro)", "a schematic of KiCad", "give its .kicad_pcb"),
        (rb"\APK\x03\x04|\A\xd0\xcf\x11\xe0|\ARIFF....CDR", "a document of a drawing or CAD program", _DRAWING),
        (rb"\A\0\0\x27\x0a", "a shapefile", "convert it to GeoJSON"),
        (rb"\A\s*(?:MULTI)?(?:POLYGON|LINESTRING)\b", "well-known text", "write GeoJSON: shapely.to_geojson"),
        (rb"\"type\"\s*:\s*\"Topology\"|\"rings\"\s*:", "TopoJSON or Esri's JSON", "convert it to GeoJSON"),
        (rb"\AIN;|\A\x1b%|^G[01] [XY]", "commands for a plotter or machine", _DRAWING),
    ],
}  # fmt: skip
"""What such a file has, what it is, and what to do, by what was asked for."""

_BEGINNING = 20_000
"""Number of bytes at the beginning of a file that are looked at: comments above the first key may be long."""


def refuse_unreadable(name: str, data: bytes, *kinds: str) -> None:
    """Refuse a file that is recognized and not read; raises InputError with the way out."""
    for kind in kinds or UNREADABLE:
        for signature, program, remedy in UNREADABLE[kind]:
            if re.search(signature, data[:_BEGINNING], re.MULTILINE | re.DOTALL):
                article = {"camera": "a camera", "poses": "poses", "outline": "an outline"}[kind]
                raise InputError(f"{article} in {name}", program, remedy)
