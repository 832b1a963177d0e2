"""Sheets drawn by pdfium and by ourselves; tests/outside has more programs."""

import numpy as np
import pytest
from renderers import RENDERERS, centers, page_size, sheet_of, write_sheet


@pytest.fixture(scope="module")
def folder(make_ngon, tmp_path_factory):
    return write_sheet(sheet_of(make_ngon), tmp_path_factory.mktemp("sheets"))


@pytest.mark.parametrize("name", ["pdfium", "png"])
def test_dots_are_where_they_belong_to_20_um(name, folder, make_ngon):
    sheet = sheet_of(make_ngon)
    expected = [(disk.x, disk.y) for disk in sheet.scene["dots"]]
    assert np.abs(centers(RENDERERS[name](folder), sheet) - expected).max() < 0.020


def test_the_page_has_its_size_to_a_tenth_of_a_millimeter(folder, make_ngon):
    paper = sheet_of(make_ngon).paper
    assert np.abs(page_size("pdfium", folder) - [paper.width, paper.height]).max() < 0.1
