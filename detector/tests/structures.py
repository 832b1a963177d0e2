"""Structures of detector.h written down once more, as tests use them; test_core.py compares both."""

from ctypes import Structure, c_double, c_int, c_int64, c_void_p

import numpy as np

PINHOLE, BROWN_CONRADY, EQUIDISTANT, SAMPLED = range(4)
COEFFICIENTS = 14
ROUGH, FITTED, REFUSED = range(3)

BLOB = np.dtype(
    [
        ("center", "f8", 2),
        ("semi", "f8", 2),
        ("angle", "f8"),
        ("covariance", "f8", 3),
        *((name, "f8") for name in ("light", "dark", "blur", "hole", "other", "doubt", "side")),
        ("state", "i4"),
        ("reached", "i4"),
        ("at", "f8", 2),
        ("shape", "f8", 3),
        ("spread", "f8", 3),
    ],
    align=True,
)
POSE = np.dtype([("R", "f8", (3, 3)), ("t", "f8", 3), ("focal", "f8")], align=True)
DOT = np.dtype(
    [
        *((name, "f8", 3) for name in ("xyz", "place", "normal")),
        ("radius", "f8"),
        ("print", "f8", (3, 3)),
        *((name, "i4") for name in ("ring", "plate", "id", "constellation", "neighbor")),
    ],
    align=True,
)
MATCH = np.dtype([("dot", "i8"), ("blob", "i8")], align=True)
ESTIMATE = np.dtype(
    [
        ("pose", POSE),
        ("other", POSE),
        ("likelihood", "f8"),
        *((name, "f8", (6, 6)) for name in ("image", "print", "calibration", "covariance")),
        ("chi2", "f8"),
        ("scale", "f8"),
        ("count", "i8"),
        ("freedom", "i8"),
    ],
    align=True,
)


class ImageStruct(Structure):
    """`Image` of detector.h."""

    _fields_ = [
        ("rows", c_void_p),
        *((name, c_int64) for name in ("height", "width", "stride")),
        ("wide", c_int),
        ("inverted", c_int),
    ]


class CameraStruct(Structure):
    """`Camera` of detector.h."""

    _fields_ = [
        ("width", c_int64),
        ("height", c_int64),
        *((name, c_double) for name in ("fx", "fy", "cx", "cy")),
        ("lens", c_int),
        ("count", c_int),
        ("c", c_double * COEFFICIENTS),
        ("reach", c_double),
        ("columns", c_int64),
        ("rows", c_int64),
        ("map", c_void_p),
    ]


class ErrorsStruct(Structure):
    """`Errors` of detector.h."""

    _fields_ = [
        ("common", c_int64),
        *((name, c_void_p) for name in ("moved", "alone", "calibration")),
        ("several", c_int),
    ]
