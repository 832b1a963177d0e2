import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from markergen.detect import kernel, kernel_build

FRESH = kernel._loaded.__wrapped__


@pytest.fixture
def built(tmp_path, monkeypatch):
    # Optimizing takes most of the time.
    monkeypatch.setattr(kernel_build, "_FLAGS", [flag.replace("-O3", "-O0") for flag in kernel_build._FLAGS])
    try:
        return kernel_build.build(tmp_path)
    except OSError as error:
        pytest.skip(str(error))


def test_what_was_built_is_used_and_what_was_built_of_another_source_is_not(built, monkeypatch):
    monkeypatch.delenv(kernel.VARIABLE, raising=False)
    copies = [built.with_name(source.name) for source in kernel_build.SOURCES]
    for source, copy in zip(kernel_build.SOURCES, copies, strict=True):
        copy.write_bytes(source.read_bytes())
    monkeypatch.setattr(kernel_build, "SOURCE", copies[0])
    monkeypatch.setattr(kernel_build, "SOURCES", copies)
    library, reason = FRESH()
    assert library is not None
    assert reason is None
    with built.with_name("kernel.c").open("a") as source:
        source.write("/* changed */\n")
    library, reason = FRESH()
    assert library is None
    assert "another version" in reason
    assert {path.name for path in built.parent.iterdir()} == {built.name, *(copy.name for copy in copies)}


@pytest.mark.parametrize(
    ("content", "said"), [(None, "without its compiled part,"), (b"no library", "cannot be loaded")]
)
def test_what_is_not_there_or_no_library_is_told_in_one_line(tmp_path, monkeypatch, content, said):
    monkeypatch.delenv(kernel.VARIABLE, raising=False)
    monkeypatch.setattr(kernel_build, "SOURCE", tmp_path / "kernel.c")
    if content is not None:
        (tmp_path / kernel_build.LIBRARY).write_bytes(content)
    library, reason = FRESH()
    assert library is None
    assert said in reason
    assert "kernel_build" in reason
    assert len(reason.splitlines()) == 1


def test_it_can_be_switched_off(monkeypatch):
    monkeypatch.setenv(kernel.VARIABLE, "off")
    library, reason = FRESH()
    assert library is None
    assert kernel.VARIABLE in reason


@pytest.mark.parametrize("compiler", ["false", "no-such-compiler", f"{sys.executable} -c 'raise SystemExit(3)'"])
def test_without_a_working_compiler_there_is_one_line_and_what_was_there_stays(tmp_path, monkeypatch, compiler):
    (tmp_path / kernel_build.LIBRARY).write_bytes(b"older")
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(OSError) as caught:
        kernel_build.build(tmp_path)
    assert len(str(caught.value).splitlines()) == 1
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"older"]
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OSError, match="no C compiler"):
        kernel_build.build(tmp_path)


def test_by_hand_the_reason_is_one_line_and_status_1():
    done = subprocess.run(
        [sys.executable, "-m", "markergen.detect.kernel_build"], env={"CC": "false", "PYTHONPATH": ":".join(sys.path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "was not built: false failed" in line


def test_building_needs_the_standard_library_alone():
    # The build hook runs before anything is installed.
    tree = ast.parse(Path(kernel_build.__file__).read_text())
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [getattr(node, "module", None) or node.names[0].name for node in imported]
    assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names


def test_arrays_that_do_not_fit_are_refused():
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    image = np.zeros((4, 40), np.uint8)
    for wrong in (image.astype(np.uint16), image[0]):
        with pytest.raises(ValueError, match="8 bits"):
            kernel.dark_components(wrong, 6, 7)
    with pytest.raises(ValueError, match="out of range"):
        kernel.dark_components(image, 256, 7)
    with pytest.raises(ValueError, match="pieces of 32"):
        kernel.difference_squares(image)
    with pytest.raises(ValueError, match="11 numbers"):
        kernel.elliptic(np.zeros((3, 10), np.int64), np.zeros(6))
    assert kernel.dark_components(image[:0], 6, 7).shape == (0, 11)
