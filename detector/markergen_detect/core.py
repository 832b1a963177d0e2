"""The compiled core: its structures and functions, as its header declares them."""

import ctypes
import functools
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HERE = Path(__file__).parent
_SOURCES = _HERE.parent / "src"
_TYPES = {"double": "f8", "int64_t": "i8", "int32_t": "i4", "int": "i4", "uint64_t": "u8"}
_POINTER = np.dtype("u8" if ctypes.sizeof(ctypes.c_void_p) == 8 else "u4")


@functools.cache
def header() -> str:
    """Return the header that the library was built with, without its comments."""
    path = next(path for path in (_HERE / "detector.h", _SOURCES / "detector.h") if path.is_file())
    return re.sub(r"/\*.*?\*/", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)


@functools.cache
def constants() -> dict[str, int]:
    """Return the numbers of the header's enumerations."""
    values: dict[str, int] = {}
    for body in re.findall(r"\benum\s*\{(.*?)\}", header(), flags=re.DOTALL):
        following = 0
        for entry in filter(None, map(str.strip, body.split(","))):
            name, _, number = (part.strip() for part in entry.partition("="))
            values[name] = following = int(number) if number else following
            following += 1
    return values


def words(first: str, last: str) -> "tuple[str, ...]":
    """Return the names of an enumeration's constants from 0 on, as words."""
    names = list(constants())
    return tuple(name.replace("_", " ").lower() for name in names[names.index(first) : names.index(last) + 1])


@functools.cache
def structures() -> "dict[str, np.dtype[Any]]":
    """Return the header's structures as types of arrays, with their pointers as integers."""
    types: dict[str, Any] = dict(_TYPES)
    for body, name in re.findall(r"typedef struct\s*\{(.*?)\}\s*(\w+)\s*;", header(), flags=re.DOTALL):
        fields = []
        for declaration in filter(None, map(str.strip, body.split(";"))):
            kind, members = re.sub(r"\b(const|struct)\s+", "", declaration).split(None, 1)
            for star, member, sizes in re.findall(r"(\**)\s*(\w+)((?:\[\w+\])*)", members):
                shape = tuple(constants().get(size) or int(size) for size in re.findall(r"\w+", sizes))
                fields.append((member, _POINTER if star else types[kind], shape))
        types[name] = np.dtype(fields, align=True)
    return {name: kind for name, kind in types.items() if name not in _TYPES}


@functools.cache
def library() -> ctypes.CDLL:
    """Return the compiled library, whose functions take pointers as `pointer` returns them.

    Raises
    ------
    ImportError
        If it is missing, cannot be loaded, or is of other sources than those beside it.
    """
    path = next((_HERE / name for name in ("libdetect.so", "libdetect.dll") if (_HERE / name).is_file()), None)
    if path is None:
        raise ImportError("markergen_detect has no compiled core: `pip install ./detector` builds it")
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise ImportError(f"the compiled core of markergen_detect cannot be loaded: {error}") from error
    for result, name, text in re.findall(r"^(\w[\w ]*[ *]+)(\w+)\(([^;{}]*)\);", header(), flags=re.MULTILINE):
        function = getattr(loaded, name, None)
        if function is not None:
            function.argtypes = [_argument(part) for part in text.split(",") if part != "void"]
            function.restype = ctypes.c_char_p if "*" in result else _argument(result)
    builder = _HERE.parent / "build_core.py"
    built = loaded.detector_source().decode()
    if built and builder.is_file() and runpy.run_path(str(builder))["digest"]() != built:
        raise ImportError(f"the compiled core of markergen_detect is older than its sources: run python {builder}")
    return loaded


def _argument(declaration: str) -> Any:
    if set("*[") & set(declaration):
        return ctypes.c_void_p
    return None if "void" in declaration else np.ctypeslib.as_ctypes_type(_TYPES[declaration.split()[0]])


def struct(name: str, kept: "list[NDArray[Any]]", **values: Any) -> "NDArray[np.void]":
    """Return a structure (1,); arrays that its pointers take are kept alive in `kept`, as it is itself."""
    result = np.zeros(1, structures()[name])
    for field, value in values.items():
        if isinstance(value, np.ndarray) and result.dtype[field] == _POINTER:
            kept.append(np.ascontiguousarray(value))
            result[field] = kept[-1].ctypes.data
        else:
            result[field] = value
    kept.append(result)
    return result


def pointer(array: "NDArray[Any]") -> int:
    """Return the address of an array's first element; it must be kept alive, and in one piece."""
    assert array.flags.c_contiguous
    return array.ctypes.data
