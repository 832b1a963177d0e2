import io
import zlib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from markergen.drawing.paper import Paper
from markergen.drawing.scene import Disk, Layer, Scene
from markergen.drawing.sheet_layout import sheet_for
from markergen.errors import InputError
from markergen.exporters.png import STRIP, image_size, pixels_per_meter, write_png


@pytest.fixture(scope="module")
def sheet(make_ngon):
    return sheet_for(make_ngon(5, 0.06, 0.014))


def pixels(data: bytes) -> np.ndarray:
    return np.array(Image.open(io.BytesIO(data)))


@pytest.mark.parametrize("dpi", [150, 600])
def test_every_dot_is_within_a_tenth_of_a_micrometer(make_ngon, sheet, dpi):
    """Far below the 10 um that are asked for: shares are exact, and grey levels round them to 2e-3."""
    ink = 255.0 - pixels(write_png(sheet, dpi))
    per_mm = pixels_per_meter(dpi) / 1e3
    for point in make_ngon(5, 0.06, 0.014).control_points:
        x = sheet.origins_mm[0][0] + point.x * 1e3
        y = sheet.paper.height - sheet.origins_mm[0][1] - point.y * 1e3
        half = 0.65 * point.feature.diameter * 1e3
        top, left = round((y - half) * per_mm), round((x - half) * per_mm)
        patch = ink[top : round((y + half) * per_mm), left : round((x + half) * per_mm)]
        rows, columns = np.indices(patch.shape) + 0.5
        result = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum() + [left, top]
        assert np.hypot(*(result / per_mm - [x, y])) < 1e-4


@pytest.mark.parametrize(("dpi", "per_meter"), [(600, 23622), (300, 11811), (150, 5906)])
def test_the_file_says_its_scale_and_is_as_large_as_the_page(sheet, dpi, per_meter):
    data = write_png(sheet, dpi)
    assert pixels_per_meter(dpi) == per_meter
    at = data.index(b"pHYs")
    assert data[at + 4 : at + 13] == per_meter.to_bytes(4, "big") * 2 + b"\x01"
    width, height = Image.open(io.BytesIO(data)).size
    # Half a pixel.
    assert width / per_meter * 1e3 == pytest.approx(sheet.paper.width, abs=500.1 / per_meter)
    assert height / per_meter * 1e3 == pytest.approx(sheet.paper.height, abs=500.1 / per_meter)


def test_grey_sheets_have_one_channel_and_colored_ones_three(sheet):
    grey = pixels(write_png(sheet, 100))
    assert grey.ndim == 2
    assert grey.min() == 0
    assert grey[0, 0] == 255
    dots = tuple(replace(shape, color="#c01020") for shape in sheet.scene["dots"])
    layers = tuple(Layer("dots", dots) if layer.name == "dots" else layer for layer in sheet.scene.layers)
    image = pixels(write_png(replace(sheet, scene=Scene(layers)), 100))
    assert image.shape == (*grey.shape, 3)
    colors = {tuple(color) for color in image.reshape(-1, 3).tolist()}
    assert {(255, 255, 255), (0xC0, 0x10, 0x20)} <= colors
    # Ink on paper lies between them.
    edge = [color for color in colors if color[0] != color[1]]
    assert all(0xC0 <= red <= 255 and 0x10 <= green <= 255 and 0x20 <= blue <= 255 for red, green, blue in edge)


def test_strips_leave_no_seam(sheet):
    dot = Disk(50, 75, 45)
    tall = replace(sheet, paper=Paper("tall", 100, 150), scene=Scene((Layer("dots", (dot,)),)))
    image = pixels(write_png(tall, 600))
    assert image.size > 1.9 * STRIP
    # The disk is as high as wide, and the same upside down and left to right but for the page's last part of a pixel.
    assert image[:, image.shape[1] // 2].astype(int).sum() == pytest.approx(
        255 * (image.shape[0] - 90 * 23.622), abs=255
    )
    covered = 255.0 - image
    assert covered.sum() / 255 / 23.622**2 == pytest.approx(np.pi * 45**2, rel=1e-6)


def test_titles_are_in_the_file_and_every_chunk_has_its_sum(sheet):
    data = write_png(sheet, 100)
    info = Image.open(io.BytesIO(data)).info
    assert info["Title"] == sheet.title
    assert info["Author"] == "markergen"
    assert info["Description"] == sheet.description
    at, kinds = 8, []
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        body = data[at + 4 : at + 8 + length]
        assert zlib.crc32(body).to_bytes(4, "big") == data[at + 8 + length : at + 12 + length]
        kinds.append(body[:4])
        at += 12 + length
    assert (kinds[0], kinds[-1]) == (b"IHDR", b"IEND")
    assert b"tIME" not in kinds


@pytest.mark.parametrize("dpi", [0, 9, 10_001, -300, float("nan")])
def test_a_dpi_that_no_printer_has_is_refused(sheet, dpi):
    with pytest.raises(InputError, match="dpi of 10 to 10000"):
        write_png(sheet, dpi)


def test_images_above_two_gigabytes_are_refused_with_a_dpi_that_fits():
    a0 = Paper("A0", 841, 1189)
    with pytest.raises(InputError, match=r"2 GB.*A0.*at 1200 dpi with 2.2 GB; use --dpi 1100"):
        image_size(a0, 1200)
    assert image_size(a0, 1100) == (36421, 51492)
    with pytest.raises(InputError, match="use --dpi 650"):
        image_size(a0, 1100, 3)
    image_size(a0, 650, 3)
