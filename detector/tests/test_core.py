"""The header, as the package reads it, against what a compiler makes of it."""

import runpy
import subprocess
from pathlib import Path

import pytest
from markergen_detect.core import constants, library, structures

ROOT = Path(__file__).parents[1]


def test_structures_have_the_sizes_and_offsets_that_a_compiler_gives_them(tmp_path):
    compiler = runpy.run_path(str(ROOT / "build_core.py"))["compiler"]()
    if not compiler:
        pytest.skip("no C compiler is there")
    lines = [f'#include <stdio.h>\n#include "{ROOT / "src" / "detector.h"}"\nint main(void) {{']
    expected = []
    for name, kind in structures().items():
        lines.append(f'printf("%zu\\n", sizeof({name}));')
        expected.append(kind.itemsize)
        for field, (_, offset, *_) in kind.fields.items():
            lines.append(f'printf("%zu\\n", offsetof({name}, {field}));')
            expected.append(offset)
    source, program = tmp_path / "sizes.c", tmp_path / "sizes"
    source.write_text("\n".join([*lines, "return 0; }"]))
    subprocess.run([*compiler, "-std=c99", "-o", program, source], check=True)
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    assert list(map(int, printed.split())) == expected


def test_enumerations_count_from_their_last_number():
    names = ("NO_MEMORY", "ROUGH", "REFUSED", "SAMPLED", "COEFFICIENTS")
    assert [constants()[name] for name in names] == [-1, 0, 2, 3, 14]


def test_functions_know_what_they_take():
    assert len(library().lens_ray.argtypes) == 4
    assert library().detector_source()
