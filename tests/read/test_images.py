import io
import os
import resource
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sentences import sentence

from markergen import guard
from markergen.errors import InputError
from markergen.read.images import (
    ORIENTATION_NOTE,
    TRANSPARENCY_NOTE,
    find_images,
    grey_frame,
    quiet,
    read_image,
    size_in_file,
)

HEIGHT, WIDTH = 30, 40
GREY = (np.arange(WIDTH) * 3 + np.arange(HEIGHT)[:, None] * 4).astype(np.uint8)
COLOR = np.stack([GREY, GREY // 2, GREY // 3], axis=-1)  # red, green, blue
LUMINANCE = COLOR @ np.array([0.299, 0.587, 0.114])
DEEP = GREY.astype(np.uint16) * 257 + 3


def encoded(suffix: str, pixels: np.ndarray, *options: int) -> bytes:
    """By OpenCV; colors are given as red, green, blue."""
    swapped = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., ::-1])
    done, data = cv2.imencode(suffix, swapped, list(options))
    assert done
    return bytes(data)


def by_pillow(pixels: np.ndarray, format: str, mode: str | None = None, **options) -> bytes:
    from PIL import Image as Pillow

    image, buffer = Pillow.fromarray(pixels), io.BytesIO()
    (image.convert(mode) if mode else image).save(buffer, format, **options)
    return buffer.getvalue()


def turned(format: str, orientation: int, pixels: np.ndarray = GREY) -> bytes:
    from PIL import Image as Pillow

    exif = Pillow.Exif()
    exif[0x0112] = orientation
    options = {"tiffinfo": {0x0112: orientation}} if format == "TIFF" else {"exif": exif}
    if format in ("JPEG", "WEBP"):
        options["quality"] = 95
    return by_pillow(pixels, format, **options)


@pytest.fixture
def read(tmp_path):
    def read(data: bytes, name: str = "image.png"):
        path = tmp_path / name
        path.write_bytes(data)
        return read_image(path)

    return read


def empty_png(width: int, height: int, depth: int, color: int) -> bytes:
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)), (b"IDAT", zlib.compress(b""))]
    chunks = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def refused(read, data, name="image.png"):
    with pytest.raises(InputError) as caught:
        read(data, name)
    line = str(caught.value)
    assert "\n" not in line
    assert name in line
    return line


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".pgm"])
def test_grey_levels_are_kept(read, suffix):
    image = read(encoded(suffix, GREY))
    assert image.grey.dtype == np.uint8
    assert image.notes == ()
    np.testing.assert_array_equal(image.grey, GREY)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".pgm"])
def test_sixteen_bits_are_kept(read, suffix):
    image = read(encoded(suffix, DEEP))
    assert image.grey.dtype == np.uint16
    np.testing.assert_array_equal(image.grey, DEEP)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".ppm"])
def test_colors_become_luminance(read, suffix):
    # Half a level of rounding, and 2^-14 in the weights of OpenCV's integers.
    np.testing.assert_allclose(read(encoded(suffix, COLOR)).grey, LUMINANCE, atol=0.52)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".ppm"])
def test_deep_colors_become_luminance(read, suffix):
    image = read(encoded(suffix, COLOR.astype(np.uint16) * 257))
    assert image.grey.dtype == np.uint16
    np.testing.assert_allclose(image.grey, LUMINANCE * 257, atol=257 * 0.03 + 0.5)


@pytest.mark.parametrize("suffix", [".jpg", ".webp"])
def test_lossy_formats(read, suffix):
    quality = cv2.IMWRITE_JPEG_QUALITY if suffix == ".jpg" else cv2.IMWRITE_WEBP_QUALITY
    assert np.abs(read(encoded(suffix, GREY, quality, 95)).grey.astype(int) - GREY).max() < 12


@pytest.mark.parametrize(("mode", "tolerance"), [("P", 0), ("LA", 0), ("RGBA", 0), ("CMYK", 6)])
def test_other_color_modes(read, mode, tolerance):
    data = by_pillow(GREY, "JPEG" if mode == "CMYK" else "PNG", mode)
    image = read(data)
    assert image.notes == ()  # opaque
    assert np.abs(image.grey.astype(int) - GREY).max() <= tolerance


def test_black_and_white(read):
    mask = GREY > 100
    for format in ("PNG", "TIFF"):
        np.testing.assert_array_equal(read(by_pillow(mask, format)).grey, np.where(mask, 255, 0))


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_what_is_transparent_is_white(read, depth):
    most = np.iinfo(depth).max
    opacity = np.full((HEIGHT, WIDTH), most, depth)
    opacity[:10], opacity[10:20] = 0, most // 5 * 2
    pixels = np.stack([GREY.astype(depth) * (most // 255)] * 3 + [opacity], axis=-1)
    image = read(bytes(cv2.imencode(".png", pixels)[1]))
    assert image.notes == (TRANSPARENCY_NOTE,)
    assert image.grey.dtype == depth
    grey = pixels[..., 0].astype(float)
    # Rounded twice, in the blend and in the luminance.
    np.testing.assert_allclose(image.grey[:10], most)
    np.testing.assert_allclose(image.grey[10:20], 0.6 * most + 0.4 * grey[10:20], atol=1.01)
    np.testing.assert_allclose(image.grey[20:], grey[20:])


def test_strips_of_a_transparent_image_have_no_seams(monkeypatch):
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 65535, (HEIGHT, WIDTH, 4), dtype=np.uint16)
    whole = grey_frame(pixels)
    monkeypatch.setattr("markergen.read.images.STRIP", 7)
    np.testing.assert_array_equal(grey_frame(pixels), whole)


@pytest.mark.parametrize(("depth", "color", "phrase"), [(16, 6, "4 channels with 16 bits"), (16, 2, "3 channels")])
def test_more_memory_than_a_photograph_takes_is_refused_before_decoding(read, depth, color, phrase):
    assert "500 MB of pixels" in (message := refused(read, empty_png(10_000, 10_000, depth, color)))
    assert f"10000x10000 px of {phrase}" in message


def test_only_the_depth_counts_not_a_width_that_looks_like_one(read):
    assert "MB of pixels" not in refused(read, empty_png(11_600, 8_000, 8, 2))


def test_transparent_tiff_is_refused(read):
    data = by_pillow(np.dstack([COLOR, GREY]), "TIFF")
    assert "transparen" in refused(read, data)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("format", ["PNG", "TIFF", "JPEG", "WEBP"])
def test_orientation_is_ignored_with_a_note(read, format, orientation):
    image = read(turned(format, orientation))
    assert image.notes == ((ORIENTATION_NOTE,) if orientation > 1 else ())
    assert image.grey.shape == GREY.shape
    # JPEG and WebP lose a few levels; a turned or mirrored ramp is off by 100.
    assert np.abs(image.grey.astype(int) - GREY).max() < (10 if format in ("JPEG", "WEBP") else 1)


def test_deep_tiff_with_orientation(read):
    np.testing.assert_array_equal(read(turned("TIFF", 6, DEEP)).grey, DEEP)


def test_broken_exif_is_no_matter(read):
    data = by_pillow(GREY, "JPEG", exif=b"Exif\0\0MM\0*\0\0\0\x08\0\xffgarbage", quality=95)
    assert np.abs(read(data).grey.astype(int) - GREY).max() < 12


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_other_depths_are_refused(read, dtype):
    data = encoded(".tiff", GREY.astype(dtype))
    line = refused(read, data, "deep.tiff")
    assert np.dtype(dtype).name in line or "format or depth" in line


@pytest.mark.parametrize(
    ("data", "phrase"),
    [
        (b"", "empty"),
        (b"hello, I am a text\n" * 20, "another format"),
        (b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n", "another format"),
        (encoded(".png", GREY[:1, :1]), "1x1"),
        (encoded(".png", GREY[:1]), "40x1"),
        (by_pillow(GREY, "GIF"), "another format"),
    ],
)
def test_unfit_files(read, data, phrase):
    assert phrase in refused(read, data)


def png_header(width: int, height: int) -> bytes:
    """A PNG that claims a size and has a hundred bytes of data."""
    chunks = b""
    for kind, body in (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(100))),
        (b"IEND", b""),
    ):
        chunks += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return b"\x89PNG\r\n\x1a\n" + chunks


@pytest.mark.parametrize("size", [(20_000, 20_000), (100_001, 1000), (2**31 - 1, 2**31 - 1)])
def test_huge_images_are_refused_from_their_header(read, size):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert f"{size[0]}x{size[1]}" in refused(read, png_header(*size))
    # KiB; the pixels would take 100 MB at least.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


def test_a_chunk_without_end(read):
    """It would make OpenCV ask for 4 GB."""
    whole = FORMATS[".png"]
    at = whole.index(b"IEND") - 4
    refused(read, whole[:at] + b"\xff\xff\xff\xf0tEXt" + whole[at:])


FORMATS = {
    ".png": encoded(".png", GREY),
    ".jpg": encoded(".jpg", COLOR),
    ".tiff": encoded(".tiff", GREY),
    ".bmp": encoded(".bmp", GREY),
    ".webp": encoded(".webp", COLOR),
    ".pgm": encoded(".pgm", DEEP),
}


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9])
def test_truncated_files(read, suffix, share, capfd):
    whole = FORMATS[suffix]
    refused(read, whole[: int(share * len(whole))], "cut" + suffix)
    # The decoders' own complaints stay inside.
    assert capfd.readouterr().err == ""


def test_others_may_speak_while_one_decodes(capfd):
    with quiet:
        os.write(2, b"of a decoder\n")
        with quiet.lifted():
            os.write(2, b"another thread\n")
        os.write(2, b"of a decoder\n")
    with quiet.lifted():
        os.write(2, b"afterward\n")
    assert capfd.readouterr().err == "another thread\nafterward\n"


@pytest.fixture(scope="session")
def fuzzed(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "image"


@given(
    st.sampled_from(sorted(FORMATS)),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=8),
    st.floats(0, 1),
    st.binary(max_size=8),
)
def test_damaged_files_never_raise_anything_else(fuzzed, suffix, changes, cut, tail):
    data = bytearray(FORMATS[suffix])
    for where, value in changes:
        data[int(where * len(data))] = value
    fuzzed.write_bytes(bytes(data[: int(cut * len(data))]) + tail if cut < 0.9 else bytes(data) + tail)
    try:
        image = read_image(fuzzed)
    except InputError as error:
        line, image = str(error), None
    if image is None:
        assert "\n" not in line
        assert str(fuzzed) in line
    else:
        assert image.grey.ndim == 2
        assert image.grey.dtype in (np.uint8, np.uint16)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_image(fuzzed, data):
    fuzzed.write_bytes(data)
    with pytest.raises(InputError):
        read_image(fuzzed)


def test_places_without_an_image(tmp_path):
    for path, phrase in (
        (tmp_path / "missing.png", "No such file"),
        (tmp_path, "folder"),
        (tmp_path / "a\0b.png", "invalid name"),
        (Path(os.devnull), "regular file"),
    ):
        with pytest.raises(InputError) as caught:
            read_image(path)
        assert phrase in str(caught.value)
        assert path.name in str(caught.value)


def test_no_permission(tmp_path, monkeypatch):
    path = tmp_path / "mine.png"
    path.write_bytes(FORMATS[".png"])

    def forbidden(path, count, pipes):
        raise PermissionError(13, "Permission denied")

    # Taking the right away does not stop the superuser, who may run the tests.
    monkeypatch.setattr(guard, "read_start", forbidden)
    with pytest.raises(InputError, match=r"mine.png, found Permission denied"):
        read_image(path)


def test_limit_of_pillow_is_left_as_it_was(read):
    from PIL import Image as Pillow

    before = Pillow.MAX_IMAGE_PIXELS
    read(FORMATS[".png"])
    refused(read, b"nothing")
    assert before == Pillow.MAX_IMAGE_PIXELS


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.png", "a.JPG", "notes.txt", ".hidden.png", "c[1].tif", "sub/d.png", "empty/readme.md"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x")
    (tmp_path / "dir.png").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        (["."], ["a.JPG", "b.png", "c[1].tif"]),
        (["*.png"], ["b.png"]),
        (["*"], ["a.JPG", "b.png", "c[1].tif"]),
        (["**/*.png"], ["b.png", "sub/d.png"]),
        (["b.png", "a.JPG"], ["b.png", "a.JPG"]),
        (["b.png", ".", "./b.png"], ["b.png", "a.JPG", "c[1].tif"]),
        (["c[1].tif"], ["c[1].tif"]),
        (["notes.txt"], ["notes.txt"]),
        (["sub", "missing.png"], ["sub/d.png", "missing.png"]),
    ],
)
def test_find_images(folder, patterns, names):
    assert [str(path) for path in find_images(patterns)] == names


@pytest.mark.parametrize("patterns", [[], ["empty"], ["*.bmp"], ["b.png", "nowhere/*"], ["nowhere"], ["x\0*"]])
def test_nothing_to_find(folder, patterns):
    with pytest.raises(InputError) as caught:
        find_images(patterns)
    assert "\n" not in str(caught.value)


def test_unreadable_folder(folder, monkeypatch):
    def forbidden(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", forbidden)
    with pytest.raises(InputError, match="Permission denied"):
        find_images(["sub"])


def test_heic_is_said_in_folders_patterns_and_by_name(folder):
    message = []
    for name in ("h.heic", "i.HEIC", "only/j.heif"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"\0\0\0\x24ftypheic\0\0\0\0mif1heic")
    assert len(find_images(["."], message.append)) == 3
    assert message == [f".: {sentence('HEIC files', 2)}"]
    for pattern, result in ((["*.[hH]*"], "2 HEIC files, which are not read"), (["only"], "1 HEIC file, which is not")):
        with pytest.raises(InputError, match=f"images at .*found {result}.*"):
            find_images(pattern)
    with pytest.raises(InputError, match="a HEIC file"):
        read_image(*find_images(["h.heic"]))


def test_a_marker_in_place_of_an_image_is_sent_to_its_option(folder):
    (folder / "marker-1.json").write_text('{"format": "markergen-marker"}')
    with pytest.raises(InputError, match="found a JSON file; give each marker with a --marker of its own"):
        read_image(*find_images(["marker-1.json"]))


@pytest.mark.parametrize("format", ["PNG", "JPEG", "TIFF"])
@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_the_size_of_an_image_is_that_of_its_pixels(tmp_path, format, orientation):
    path = tmp_path / "image"
    path.write_bytes(turned(format, orientation))
    assert size_in_file(path) == read_image(path).grey.shape[::-1]
    path.write_bytes(b"no image")
    assert size_in_file(path) is None
    assert size_in_file(tmp_path / "none") is None


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_frames_in_memory_have_the_grey_levels_of_files(read, depth, channels):
    rng = np.random.default_rng(channels)
    image = rng.integers(0, np.iinfo(depth).max, (HEIGHT, WIDTH, channels), dtype=depth, endpoint=True)
    levels = grey_frame(image)
    assert levels.flags.c_contiguous
    np.testing.assert_array_equal(levels, read(bytes(cv2.imencode(".png", image)[1])).grey)
    np.testing.assert_array_equal(grey_frame(image[::-1]), levels[::-1])
