"""Pictures from files: grey levels as the sensor has them, or one line that says why not."""

import glob
import io
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.files import exists
from markergen.guard import read, reason_of

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

Grey = NDArray[np.uint8] | NDArray[np.uint16]

SUFFIXES = (".bmp", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm", ".ppm", ".tif", ".tiff", ".webp")
"""By these a folder's files are taken for images."""

LARGEST_PIXELS = 100_000_000
"""Pixels of the largest image that is read: above most sensors, and still fit for memory in 16 bits and color."""

LARGEST_FRAME = 400_000_000
"""Pixels of the largest image in memory that is searched: five seconds, and 2 GB for 16 bits."""

LEAST_SIDE = 16
"""Least width and height in px: four dots that can be measured do not fit into less."""

_FORMATS = ("BMP", "JPEG", "PNG", "PPM", "TIFF", "WEBP")
_KNOWN = "PNG, JPEG, TIFF, BMP, WebP or PGM"
_ORIENTATION = 0x0112

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
"""By orientation, what takes back how decoders turn the images of TIFF files; those of others they do not turn."""

ORIENTATION_NOTE = "the EXIF orientation is ignored: the camera's calibration is for the sensor as it is"
TRANSPARENCY_NOTE = "transparent pixels are taken as white"


@dataclass(frozen=True, eq=False)
class Image:
    """A picture.

    Attributes
    ----------
    grey : array (h, w) of uint8 or uint16
        Colors are turned into luminance.
    notes : tuple of str
        What was done to it, or left undone, that its owner may not expect.
    """

    grey: Grey
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Header:
    """What a file says of its image."""

    width: int
    height: int
    format: str
    orientation: int


def read_image(path: Path) -> Image:
    """Read an image of 8 or 16 bits, grey or color; its rows and columns are the sensor's, whatever EXIF says.

    A second decoder, Pillow, reads the header first and then goes through the file to its end, since OpenCV fills up
    what a truncated file lacks and says nothing.

    Raises
    ------
    InputError
        If it is missing, not readable, no image of a known format, damaged, of another depth, of less than 16 px to a
        side or more than 100 million pixels.
    """
    data = _content(path)
    try:
        with _quiet():
            header = _examine(path, data)
            pixels = _decode(data)
    except InputError:
        raise
    except MemoryError:
        raise InputError(f"memory enough for {path}", "too little", "scale the image down") from None
    except Exception as error:  # Decoders raise whatever comes up in a broken file.
        raise InputError(f"a whole {_KNOWN} image in {path}", _brief(error), "export the image again") from None
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"8 or 16 bits per channel in {path}", f"{pixels.dtype}", "convert the image to 8 or 16 bit grey"
        )
    if pixels.shape[1::-1] != (header.width, header.height):
        raise InputError(
            f"{header.width}x{header.height} px in {path}, as its header says",
            f"{pixels.shape[1]}x{pixels.shape[0]} px",
            "export the image again",
        )
    if header.format == "TIFF":
        pixels = _UNDO.get(header.orientation, _UNDO[1])(pixels)
    transparent = _transparent(pixels)
    if transparent and header.format == "TIFF":
        # Decoders do not agree whether its colors are already multiplied by their opacity.
        raise InputError(f"an opaque image in {path}", "a transparent TIFF", "remove the transparency, or use PNG")
    notes = [ORIENTATION_NOTE] * (header.orientation != 1) + [TRANSPARENCY_NOTE] * transparent
    return Image(grey_levels(pixels), tuple(notes))


def grey_levels(pixels: NDArray[Any]) -> Grey:
    """Luminance (h, w) of grey (h, w), (h, w, 1 or 2) or BGR (h, w, 3 or 4), the last of 2 or 4 being opacity.

    0.299 R + 0.587 G + 0.114 B; what is transparent lies on white. Rows are contiguous in memory.
    """
    import cv2

    colors = pixels if pixels.ndim == 3 else pixels[..., None]
    if colors.shape[2] in (2, 4):
        if _transparent(pixels):
            most = float(np.iinfo(pixels.dtype).max)
            white = most + colors[..., -1:] / most * (colors - most)
            colors = np.rint(white).astype(pixels.dtype)
        colors = colors[..., :-1]
    colors = np.ascontiguousarray(colors)
    grey: Grey = colors[..., 0] if colors.shape[2] == 1 else cv2.cvtColor(colors, cv2.COLOR_BGR2GRAY)
    return grey


def grey_frame(frame: object) -> Grey:
    """Grey levels (h, w) of an image in memory, as `read_image` has those of a file; raises as `check_frame` does."""
    pixels = check_frame(frame)
    kind = pixels.dtype.newbyteorder("=")
    return grey_levels(np.asarray(pixels, dtype=kind))


def check_frame(frame: object) -> NDArray[Any]:
    """Return an image in memory as it is, if it is one.

    Parameters
    ----------
    frame : array (h, w) or (h, w, 1) grey, (h, w, 3) BGR or (h, w, 4) BGRA, of uint8 or uint16
        In any memory layout and byte order.

    Raises
    ------
    InputError
        If it is something else, or has no pixels, or more than 400 million.
    """
    if not isinstance(frame, np.ndarray):
        raise InputError("an image as a numpy array", _named(frame), _made_array(frame))
    kind = frame.dtype.newbyteorder("=")
    if kind not in (np.uint8, np.uint16):
        raise InputError("an image of uint8 or uint16", str(kind), _made_integer(kind))
    if not (frame.ndim == 2 or (frame.ndim == 3 and frame.shape[2] in (1, 3, 4))) or not frame.size:
        raise InputError(
            "a grey image (h, w), or one in color, (h, w, 3) BGR or (h, w, 4) BGRA",
            f"shape {frame.shape}",
            _reshaped(frame.shape),
        )
    height, width = frame.shape[:2]
    if height * width > LARGEST_FRAME:
        raise InputError(
            f"an image of at most {LARGEST_FRAME // 10**6} megapixels",
            f"{width}x{height} px",
            "reduce its size, or cut out the part with the marker",
        )
    return frame


def _named(value: object) -> str:
    kind = type(value)
    return "None" if value is None else f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")


def _made_array(value: object) -> str:
    if value is None:
        return "cv2.imread returns None when it cannot read the file: check the path"
    if isinstance(value, str | os.PathLike):
        return "read the file first, with cv2.imread"
    if isinstance(value, tuple):
        return "cv2.VideoCapture.read returns (ok, frame): give the frame"
    return "give what cv2.imread or cv2.VideoCapture.read gives; of another library's image, make a BGR array first"


def _made_integer(kind: np.dtype[Any]) -> str:
    if kind == np.bool_:
        return "give 255 * frame.astype(np.uint8)"
    if kind.kind == "f":
        return "give (255 * frame).astype(np.uint8) if white is 1, or frame.astype(np.uint8) if it is 255"
    return "give frame.astype(np.uint8) if white is 255, or frame.astype(np.uint16) if it is 65535"


def _reshaped(shape: tuple[int, ...]) -> str:
    if 0 in shape:
        return "give an image with pixels; a slice may have gone past the image's edge"
    if len(shape) == 4:
        return "give one image at a time"
    if len(shape) == 3 and shape[0] in (1, 3, 4):
        return "put the colors last: frame.transpose(1, 2, 0)"
    return "give what cv2.imread or cv2.VideoCapture.read gives"


def find_images(patterns: Sequence[str | Path]) -> list[Path]:
    """Paths of the images that files, folders and globs stand for, in this order and each once.

    A folder stands for all image files that lie in it, a glob for all image files that match, both sorted by name;
    hidden ones are left out. The name of a file is taken as it is: whether there is one, reading it will tell.

    Raises
    ------
    InputError
        If a folder or a glob has no image, or a folder cannot be read, or nothing was asked for.
    """
    if not patterns:
        raise InputError("one image or more", "none", "name image files or a folder")
    found: dict[str, Path] = {}
    for pattern in map(str, patterns):
        for path in _matches(pattern):
            found.setdefault(os.path.abspath(path), path)  # noqa: PTH100 - links with other names are other images
    return list(found.values())


def _matches(pattern: str) -> list[Path]:
    path = Path(pattern)
    try:
        if path.is_dir():
            candidates = list(path.iterdir())
        elif glob.has_magic(pattern) and not path.exists():
            candidates = [Path(name) for name in glob.glob(pattern, recursive=True)]  # noqa: PTH207
        else:
            return [path]
        images = sorted(
            each
            for each in candidates
            if each.suffix.lower() in SUFFIXES and not each.name.startswith(".") and not each.is_dir()
        )
    except (OSError, ValueError) as error:
        raise InputError(f"a readable folder at {pattern}", reason_of(error), "check the path") from None
    if not images:
        raise InputError(f"images at {pattern}", "none", f"name {_KNOWN} files, or a folder that has some")
    return images


def _content(path: Path) -> bytes:
    if "\0" in str(path):
        raise InputError(f"a readable image at {path}", "an impossible name", "check the path")
    if exists(path) and path.is_dir():
        raise InputError(
            f"a readable image at {path}", "a folder", "name its files, or give it where folders are taken"
        )
    return read(path, "image").data


@contextmanager
def opened(data: bytes, formats: tuple[str, ...]) -> "Iterator[PillowImage]":
    """Open an image by Pillow, which reads its header; however large it is, that is for the caller to judge."""
    from PIL import Image as Pillow

    # Pillow's own limit would raise before the size is known.
    limit, Pillow.MAX_IMAGE_PIXELS = Pillow.MAX_IMAGE_PIXELS, None
    try:
        with Pillow.open(io.BytesIO(data), formats=formats) as image:
            yield image
    finally:
        Pillow.MAX_IMAGE_PIXELS = limit


def _examine(path: Path, data: bytes) -> _Header:
    """Header of an image that has been read to its end; raises if it is damaged or of an unfit size."""
    from PIL import UnidentifiedImageError

    try:
        with opened(data, _FORMATS) as image:
            width, height = image.size
            if width * height > LARGEST_PIXELS:
                raise InputError(
                    f"at most {LARGEST_PIXELS // 1_000_000} megapixels in {path}",
                    f"{width}x{height} px",
                    "crop the image, or scale it and its calibration down",
                )
            if min(width, height) < LEAST_SIDE:
                raise InputError(
                    f"at least {LEAST_SIDE}x{LEAST_SIDE} px in {path}", f"{width}x{height} px", "give a larger image"
                )
            if image.format == "PNG":
                # Its EXIF may stand behind the pixels: looking for it reads them, and an error would be lost there.
                image.load()
            try:
                orientation = image.getexif().get(_ORIENTATION, 1)
            except Exception:  # EXIF is broken in many an image that is otherwise fine.
                orientation = 1
            header = _Header(width, height, str(image.format), orientation if orientation in _UNDO else 1)
            image.load()
    except UnidentifiedImageError:
        raise InputError(
            f"a {_KNOWN} image of 8 or 16 bits in {path}", "another format or depth", "convert the image to PNG"
        ) from None
    if header.format == "PNG":
        _check_chunks(data)
    return header


def _check_chunks(data: bytes) -> None:
    """Raise if a chunk of a PNG claims to go on after the file's end: OpenCV would ask for that much memory."""
    at, kind = 8, b""
    while kind != b"IEND":
        length, kind = int.from_bytes(data[at : at + 4]), data[at + 4 : at + 8]
        at += 12 + length
        if at > len(data):
            raise ValueError("a chunk that does not end")


def _decode(data: bytes) -> NDArray[Any]:
    import cv2

    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise ValueError("damaged data")
    return np.asarray(pixels)


def _transparent(pixels: NDArray[Any]) -> bool:
    return pixels.ndim == 3 and pixels.shape[2] in (2, 4) and bool((pixels[..., -1] < np.iinfo(pixels.dtype).max).any())


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep warnings back, also those that the decoders' libraries write to standard error past Python."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            kept = os.dup(2)
        except OSError:  # There is no standard error to write to.
            yield
            return
        try:
            with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _brief(error: Exception) -> str:
    """One line of at most 80 characters."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 80 else text[:77] + "..."
