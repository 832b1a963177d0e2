"""Read images as grey levels in sensor coordinates, or explain in one line why that is impossible."""

import glob
import io
import os
import re
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, reason_of
from markergen.files import exists
from markergen.guard import read

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

Grey = NDArray[np.uint8] | NDArray[np.uint16]

SUFFIXES = (".bmp", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm", ".ppm", ".tif", ".tiff", ".webp")
"""Suffixes of the files in a folder that count as images."""

UNREAD = (".heic", ".heif", ".hif")
"""Suffixes of the photographs of phones that no decoder here reads."""

LARGEST_PIXELS = 100_000_000
"""Maximum number of pixels of an image file: above most sensors, and fit for memory in 16 bits and color."""

LARGEST_BYTES = 500_000_000
"""Maximum size of a file's pixels in bytes: 75 megapixels in color with 16 bits take 450 MB."""

LARGEST_FRAME = 400_000_000
"""Maximum number of pixels of an image in memory that is searched: five seconds, and 2 GB at 16 bits."""

LEAST_SIDE = 16
"""Minimum width and height in px: a smaller image cannot contain four measurable dots."""

STRIP = 256
"""Number of rows blended with white at a time: a whole image would take eight times its size."""

_FORMATS = ("BMP", "JPEG", "PNG", "PPM", "TIFF", "WEBP")
_KNOWN = "PNG, JPEG, TIFF, BMP, WebP or PGM"
_HEIC = re.compile(rb".{4}ftyp(he|mif1|msf1)", re.DOTALL)
_NO_HEIC = "set the phone to JPEG, or convert {}"
_ORIENTATION = 0x0112
"""EXIF's tag of how the image is turned, 1 to 8, as in `_UNDO`."""
_PILLOW = threading.Lock()

_UNDO: dict[int, Callable[[NDArray[Any]], NDArray[Any]]] = {
    1: lambda image: image,
    2: lambda image: image[:, ::-1],
    3: lambda image: image[::-1, ::-1],
    4: lambda image: image[::-1],
    5: lambda image: image.swapaxes(0, 1),
    6: lambda image: np.rot90(image),
    7: lambda image: image[::-1, ::-1].swapaxes(0, 1),
    8: lambda image: np.rot90(image, -1),
}
"""Inverse, by EXIF orientation, of the rotation that decoders apply to TIFF images (and to no others)."""

ORIENTATION_NOTE = "the EXIF orientation is ignored: the camera's calibration is for the sensor as it is"
TRANSPARENCY_NOTE = "transparent pixels are taken as white"


@dataclass(frozen=True, eq=False)
class Image:
    """An image.

    Attributes
    ----------
    grey : array (h, w) of uint8 or uint16
        Grey levels; colors are converted to luminance.
    notes : tuple of str
        Remarks on conversions that the user may not expect.
    """

    grey: Grey
    notes: tuple[str, ...] = ()


def read_image(path: Path) -> Image:
    """Read an 8- or 16-bit image, grey or color, with the sensor's rows and columns whatever its EXIF orientation.

    A second decoder, Pillow, first reads the header and then the file to its end, since OpenCV silently fills in the
    missing parts of a truncated file.

    Raises InputError if it is missing, unreadable, damaged, not in a known format, of another depth, under 16 px on a
    side, or above 100 million pixels or 500 MB.
    """
    import cv2

    data = _content(path)
    try:
        with quiet:
            (width, height), form, orientation = _examine(path, data)
            pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise ValueError("damaged data")
    except InputError:
        raise
    except MemoryError:
        raise InputError(f"enough memory for {path}", "too little", "scale the image down") from None
    except Exception as error:  # Decoders raise all kinds of exceptions for broken files.
        problem = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"a complete {_KNOWN} image in {path}", problem, "export the image again") from None
    if pixels.dtype not in (np.uint8, np.uint16):
        remedy = "convert the image to 8 or 16 bit grey"
        raise InputError(f"8 or 16 bits per channel in {path}", f"{pixels.dtype}", remedy)
    if pixels.shape[1::-1] != (width, height):
        expected = f"{width}x{height} px in {path}, as its header says"
        raise InputError(expected, f"{pixels.shape[1]}x{pixels.shape[0]} px", "export the image again")
    if form == "TIFF":
        pixels = _UNDO[orientation](pixels)
    transparent = _transparent(pixels)
    if transparent and form == "TIFF":
        # Decoders disagree on whether its colors are premultiplied by opacity.
        raise InputError(f"an opaque image in {path}", "a transparent TIFF", "remove the transparency, or use PNG")
    notes = [ORIENTATION_NOTE] * (orientation != 1) + [TRANSPARENCY_NOTE] * transparent
    return Image(decoded_levels(pixels), tuple(notes))


def decoded_levels(pixels: NDArray[Any]) -> Grey:
    """Luminance (h, w) of grey (h, w), (h, w, 1 or 2) or BGR (h, w, 3 or 4); channel 2 or 4, if any, is opacity.

    Computed as 0.299 R + 0.587 G + 0.114 B, with transparent pixels over white. Rows are contiguous in memory.
    """
    import cv2

    colors = pixels if pixels.ndim == 3 else pixels[..., None]
    if _transparent(pixels):
        most = float(np.iinfo(colors.dtype).max)
        strips = [colors[top : top + STRIP] for top in range(0, len(colors), STRIP)]
        # Blend with white: c a + most (1 - a).
        whitened = (most + strip[..., -1:] / most * (strip[..., :-1] - most) for strip in strips)
        blended: Grey = np.concatenate([decoded_levels(np.rint(strip).astype(colors.dtype)) for strip in whitened])
        return blended
    if colors.shape[2] in (2, 4):
        colors = colors[..., :-1]
    colors = np.ascontiguousarray(colors)
    grey: Grey = colors[..., 0] if colors.shape[2] == 1 else cv2.cvtColor(colors, cv2.COLOR_BGR2GRAY)
    return grey


def grey_frame(frame: object) -> Grey:
    """Grey levels (h, w) of an image in memory, as `read_image` returns for files; raises like `check_frame`."""
    pixels = check_frame(frame)
    kind = pixels.dtype.newbyteorder("=")
    return decoded_levels(np.asarray(pixels, dtype=kind))


def check_frame(frame: object) -> NDArray[Any]:
    """Return an image in memory unchanged after checking it.

    Raises InputError if it is not such an array, has no pixels, or has more than 400 million.

    Parameters
    ----------
    frame : array (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGRA, of uint8 or uint16
        In any memory layout and byte order.
    """
    if not isinstance(frame, np.ndarray):
        kind = type(frame)
        name = "None" if frame is None else f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")
        remedy = next(remedy for types, remedy in _MADE_ARRAYS if isinstance(frame, types))
        raise InputError("an image as a numpy array", name, remedy)
    # Byte order is not compared: arrays of files in the other order are images as well.
    kind = frame.dtype.newbyteorder("=")
    if kind not in (np.uint8, np.uint16):
        remedy = "give frame.astype(np.uint8) if white is 255, or frame.astype(np.uint16) if it is 65535"
        raise InputError("an image of uint8 or uint16", str(kind), _MADE_INTEGERS.get(kind.kind, remedy))
    if not (frame.ndim == 2 or (frame.ndim == 3 and frame.shape[2] in (1, 3, 4))) or not frame.size:
        expected = "a grey image (h, w), or one in color, (h, w, 3) BGR or (h, w, 4) BGRA"
        raise InputError(expected, f"shape {frame.shape}", _reshaped(frame.shape))
    height, width = frame.shape[:2]
    if height * width > LARGEST_FRAME:
        expected = f"an image of at most {LARGEST_FRAME // 10**6} megapixels"
        raise InputError(expected, f"{width}x{height} px", "reduce its size, or cut out the part with the marker")
    return frame


_READ_BY_CV2 = "give what cv2.imread or cv2.VideoCapture.read gives"
_MADE_ARRAYS: tuple[tuple[Any, str], ...] = (
    (type(None), "cv2.imread returns None when it cannot read the file: check the path"),
    (str | os.PathLike, "read the file first: cv2.imread(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)"),
    (tuple, "cv2.VideoCapture.read returns (ok, frame): give the frame"),
    (object, f"{_READ_BY_CV2}; convert another library's image to a BGR array first"),
)
"""How images are made of what is no array, by its type."""
_MADE_INTEGERS = {
    "b": "give 255 * frame.astype(np.uint8)",
    "f": "give (255 * frame).astype(np.uint8) if white is 1, or frame.astype(np.uint8) if white is 255",
}
"""How 8 bits are made of other numbers, by their kind."""


def _reshaped(shape: tuple[int, ...]) -> str:
    if 0 in shape:
        return "give an image with pixels; a slice may have gone past the image's edge"
    if len(shape) == 4:
        return "give one image at a time"
    is_first = len(shape) == 3 and shape[0] in (1, 3, 4)
    return "put the colors last: frame.transpose(1, 2, 0)" if is_first else _READ_BY_CV2


def size_in_file(path: Path) -> tuple[int, int] | None:
    """Return width and height in px of what `read_image` returns, by the header alone; None if that cannot be read."""
    try:
        with quiet, opened_image(_content(path), _FORMATS) as image:
            # Pillow's size is that after the rotation, which `read_image` undoes.
            is_sideways = image.format == "TIFF" and _orientation(image) > 4
            return image.size[::-1] if is_sideways else image.size
    except Exception:  # `read_image` says why.
        return None


def find_images(patterns: Sequence[str | Path], warn: Callable[[str], None] | None = None) -> list[Path]:
    """Expand files, folders and globs to image paths, in this order and without repetition.

    A folder or a glob stands for its image files, sorted by name, without hidden ones. The path of an image
    that does not exist is returned, too; reading it will report that. `warn` gets the HEIC files beside images.

    Raises InputError if a folder or a glob has no image, a folder does not exist or cannot be read, or nothing is
    given.
    """
    if not patterns:
        raise InputError("one or more images", "none", "name image files or a folder")
    paths: dict[str, Path] = {}
    for pattern in map(str, patterns):
        for path in _matches(pattern, warn):
            paths.setdefault(os.path.abspath(path), path)  # noqa: PTH100 - links with other names are other images
    return list(paths.values())


def _matches(pattern: str, warn: Callable[[str], None] | None) -> list[Path]:
    path = Path(pattern)
    try:
        if path.is_dir():
            candidates = list(path.iterdir())
        elif glob.has_magic(pattern) and not path.exists():
            candidates = [Path(name) for name in glob.glob(pattern, recursive=True)]  # noqa: PTH207
        elif path.suffix or exists(path):
            return [path]
        else:
            raise InputError(f"an image or a folder of images at {pattern}", "nothing", "check the path")
        files = [path for path in candidates if not path.name.startswith(".") and not path.is_dir()]
        images = sorted(path for path in files if path.suffix.lower() in SUFFIXES)
    except (OSError, ValueError) as error:
        raise InputError(f"a readable folder at {pattern}", reason_of(error), "check the path") from None
    count = sum(path.suffix.lower() in UNREAD for path in files)
    unread, verb = f"{count} HEIC file{'s' * (count > 1)}", "are" if count > 1 else "is"
    remedy = _NO_HEIC.format("them" if count > 1 else "it")
    if not images:
        if count:
            raise InputError(f"images at {pattern}", f"{unread}, which {verb} not read", remedy)
        raise InputError(f"images at {pattern}", "none", f"name {_KNOWN} files, or a folder with some")
    if count and warn:
        warn(f"{pattern}: {unread} {verb} not read: {remedy}")
    return images


def _content(path: Path) -> bytes:
    if "\0" in str(path):
        raise InputError(f"a readable image at {path}", "an invalid name", "check the path")
    if exists(path) and path.is_dir():
        remedy = "name its files, or give it where folders are accepted"
        raise InputError(f"a readable image at {path}", "a folder", remedy)
    return read(path, "image").data


@contextmanager
def opened_image(data: bytes, formats: tuple[str, ...]) -> "Iterator[PillowImage]":
    """Open an image with Pillow, which reads the header; the caller limits its size."""
    from PIL import Image as Pillow

    with _PILLOW:
        # Its own limit, which is that of the whole process, would raise before the size is known.
        limit, Pillow.MAX_IMAGE_PIXELS = Pillow.MAX_IMAGE_PIXELS, None
        try:
            unsized = Pillow.open(io.BytesIO(data), formats=formats)
        finally:
            Pillow.MAX_IMAGE_PIXELS = limit
    with unsized as image:
        yield image


def _orientation(image: "PillowImage") -> int:
    """EXIF orientation, 1 to 8; 1 if there is none."""
    try:
        orientation = image.getexif().get(_ORIENTATION, 1)
    except Exception:  # Many images that are otherwise fine have broken EXIF.
        orientation = 1
    return orientation if orientation in _UNDO else 1


def _examine(path: Path, data: bytes) -> tuple[tuple[int, int], str, int]:
    """Read an image to its end: size, format and orientation; raises if it is damaged or of an unsuitable size."""
    from PIL import UnidentifiedImageError

    try:
        with opened_image(data, _FORMATS) as image:
            width, height = image.size
            if width * height > LARGEST_PIXELS:
                raise InputError(
                    f"at most {LARGEST_PIXELS // 1_000_000} megapixels in {path}",
                    f"{width}x{height} px",
                    "crop the image, or scale it and its calibration down",
                )
            # Bits of a channel in the file; Pillow's mode has 8 for color of 16.
            coded = [tile.args if isinstance(tile.args, str) else tile.args[0] for tile in vars(image).get("tile", ())]
            depth = 16 if any("16" in str(mode) for mode in (image.mode, *coded)) else 8
            channels = len(image.getbands())
            if width * height * channels * depth // 8 > LARGEST_BYTES:
                raise InputError(
                    f"at most {LARGEST_BYTES // 1_000_000} MB of pixels in {path}",
                    f"{width}x{height} px of {channels} channels with {depth} bits",
                    "convert the image to 8 bit grey",
                )
            if min(width, height) < LEAST_SIDE:
                expected = f"at least {LEAST_SIDE}x{LEAST_SIDE} px in {path}"
                raise InputError(expected, f"{width}x{height} px", "give a larger image")
            if image.format == "PNG":
                # EXIF may follow the pixels: finding it reads them, and would swallow an error.
                image.load()
            form, orientation = str(image.format), _orientation(image)
            image.load()
    except UnidentifiedImageError:
        problem, remedy = "another format or depth", "convert the image to PNG"
        if _HEIC.match(data):
            problem, remedy = "a HEIC file, which is not read", _NO_HEIC.format("it")
        elif data.lstrip().startswith(b"{"):
            problem, remedy = "a JSON file", "give each marker with a --marker of its own"
        raise InputError(f"a {_KNOWN} image of 8 or 16 bits in {path}", problem, remedy) from None
    if form == "PNG":
        _check_chunks(data)
    return (width, height), form, orientation


def _check_chunks(data: bytes) -> None:
    """Raise if a chunk of a PNG extends past the end of the file: OpenCV would allocate its stated size."""
    at, kind = 8, b""
    while kind != b"IEND":
        length, kind = int.from_bytes(data[at : at + 4]), data[at + 4 : at + 8]
        at += 12 + length
        if at > len(data):
            raise ValueError("a chunk that does not end")


def _transparent(pixels: NDArray[Any]) -> bool:
    return pixels.ndim == 3 and pixels.shape[2] in (2, 4) and bool((pixels[..., -1] < np.iinfo(pixels.dtype).max).any())


class _Quiet:
    """Suppresses warnings, including those that the decoders' libraries write directly to standard error.

    Both belong to the whole process: of several threads, the first one in switches them off, and the last one out on.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._inside = 0
        self._undo = ExitStack()

    def __enter__(self) -> None:
        with self._lock:
            self._inside += 1
            if self._inside == 1:
                self._begin()

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._undo.close()

    @contextmanager
    def lifted(self) -> Iterator[None]:
        """Let this thread write to standard error while others decode; those that begin or end meanwhile wait."""
        with self._lock:
            self._undo.close()
            try:
                yield
            finally:
                if self._inside:
                    self._begin()

    def _begin(self) -> None:
        self._undo.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        self._undo.enter_context(_standard_error_nowhere())


@contextmanager
def _standard_error_nowhere() -> Iterator[None]:
    try:
        kept = os.dup(2)
    except OSError:  # Standard error is closed.
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


quiet = _Quiet()
"""The context in which decoders say nothing."""
