"""Whatever stands in a file to verify, the answer is a check or one line."""

import struct
import time
import zlib

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mutants import FLIPS, flipped

from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.verification import verify
from markergen.verification.result import Verification

TEXTS = (".svg", ".dxf", ".step", ".csv", ".json", ".opencv.yaml", ".ros2.yaml", ".kalibr.yaml")
SUFFIXES = (*TEXTS, ".pdf", ".png", ".stl", ".3mf", ".glb")
SMALL = ExportOptions(dpi=40, fabrication=Fabrication(engrave=False, tolerance=1e-4))
TOKENS = [
    "0", "-1", "1e999", "1e300", "-1e-320", "nan", "inf", "9" * 5000, "", " ", "\n", "\0", "é", "<", ">", "</g>", '"',
    "[", "]", "{", "}", "(", ")", "&a;", "#", "$", "0\nINSERT\n", "40\n", "SECTION", "CIRCLE", "#1", "'", ";", ":", ",",
    "scale(1e200)", "M0 0 A", "Z" * 50, "!!python/object", "*a", "&a [*a]", "- - - -",
]  # fmt: skip


@pytest.fixture(scope="module")
def marker(make_ngon):
    return make_ngon(4, 0.05, 0.012)


@pytest.fixture(scope="module")
def seeds(marker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds")
    save(marker, [folder / f"a{suffix}" for suffix in SUFFIXES], SMALL)
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in SUFFIXES}


def test_a_page_that_overflows(marker, seeds, tmp_path):
    data = seeds[".pdf"].replace(b"/MediaBox [", b"/MediaBox [ -1e39 -1e39 1e39 1e39 ] /Was [")
    assert data != seeds[".pdf"]
    outcome(marker, tmp_path, ".pdf", data)


@pytest.mark.parametrize(
    "number", ["1e400", *(pytest.param(each, marks=pytest.mark.long) for each in ("nan", "1e38", "-1e308"))]
)
def test_numbers_that_overflow(marker, seeds, tmp_path, number):
    there = number.encode()
    outcome(marker, tmp_path, ".dxf", seeds[".dxf"].replace(b"\n 40\n6.0\n", b"\n 40\n" + there + b"\n"))
    outcome(marker, tmp_path, ".step", seeds[".step"].replace(b"42.8", there))
    outcome(marker, tmp_path, ".svg", seeds[".svg"].replace(b'r="6"', b'r="' + there + b'"'))


def outcome(marker, folder, suffix, data):
    path = folder / f"file{suffix}"
    path.write_bytes(data)
    start, check, message = time.process_time(), None, ""
    try:
        check = verify(marker, path)
    except InputError as error:
        message = str(error)
    # The seeds take 0.2 s at most; what was changed may hold more that looks like dots.
    assert time.process_time() - start < 3
    assert len(message.splitlines()) <= 1
    assert len(message) < 2000
    if check is not None:
        assert Verification([check]).to_json()
    return check


FUZZ = settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=30)
LONG = settings(FUZZ, max_examples=240)
CHANGES = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 30), st.sampled_from(TOKENS)), min_size=1, max_size=3)


def test_the_seeds_are_usable(marker, seeds, tmp_path):
    for suffix, data in seeds.items():
        check = outcome(marker, tmp_path, suffix, data)
        assert check is not None
        # 40 dpi put a center to a hundredth of a pixel.
        assert check.passed, (suffix, check.findings)


@pytest.mark.long
@LONG
@given(st.sampled_from(TEXTS), CHANGES)
@example(".svg", [(0.15625, 1, "1e999")])
@example(".svg", [(0.125, 0, "1e999")])
def test_pieces_replaced_by_others(marker, seeds, tmp_path, suffix, changes):
    data = seeds[suffix]
    # What counts is more often at the beginning: a sheet's text comes last.
    for place, length, token in changes:
        start = int(place**2 * len(data))
        data = data[:start] + token.encode() + data[start + length :]
    outcome(marker, tmp_path, suffix, data)


@FUZZ
@given(st.sampled_from(SUFFIXES), st.floats(0, 1))
def test_cut_off_anywhere(marker, seeds, tmp_path, suffix, share):
    data = seeds[suffix]
    outcome(marker, tmp_path, suffix, data[: int(share * len(data))])


@FUZZ
@given(st.sampled_from([suffix for suffix in SUFFIXES if suffix != ".step"]), FLIPS)
@example(".step", [(0.5, 57)])
def test_bytes_flipped(marker, seeds, tmp_path, suffix, changes):
    outcome(marker, tmp_path, suffix, flipped(seeds[suffix], changes))


@pytest.mark.long
@LONG
@given(FLIPS)
def test_bytes_flipped_in_step(marker, seeds, tmp_path, changes):
    """Each takes a second or two."""
    outcome(marker, tmp_path, ".step", flipped(seeds[".step"], changes))


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


@FUZZ
@given(
    st.integers(0, 2**32 - 1) | st.integers(1, 300),
    st.integers(0, 2**32 - 1) | st.integers(1, 300),
    st.sampled_from([1, 2, 4, 8, 16, 3]),
    st.sampled_from([0, 2, 3, 4, 6, 5]),
    st.binary(max_size=9) | st.just(struct.pack(">IIB", 2000, 2000, 1)),
    st.binary(max_size=50) | st.just(b"\0" * 4000),
)
@example(1, 1, 1, 0, struct.pack(">IIB", 2000, 2000, 1), b"\0" * 4000)
def test_images_that_lie(marker, tmp_path, width, height, depth, color, density, pixels):
    header = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    parts = [
        chunk(b"IHDR", header),
        chunk(b"pHYs", density),
        chunk(b"IDAT", zlib.compress(pixels)),
        chunk(b"IEND", b""),
    ]
    outcome(marker, tmp_path, ".png", b"\x89PNG\r\n\x1a\n" + b"".join(parts))


@FUZZ
@given(st.sampled_from(SUFFIXES), st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_anything(marker, tmp_path, suffix, data):
    outcome(marker, tmp_path, suffix, data)
