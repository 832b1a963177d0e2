"""Building the compiled core of detection: `python build_core.py`, and at installation.

The build hook loads this file by its path before anything is installed, so it imports the standard library alone.
"""

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent
PACKAGE = ROOT / "markergen_detect"

LIBRARY = "libdetect.dll" if sys.platform == "win32" else "libdetect.so"
"""Name of the compiled library in the package."""

FLAGS = ["-O3", "-std=c99", "-shared", "-fPIC", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
"""No instructions that other computers of the kind lack, and every operation rounded: the same numbers everywhere.
Roots that do not set errno are one instruction, of four numbers at a time, and nothing asks for exceptions."""

_TARGETS = {
    ("linux", "x86_64"): "x86_64-linux-gnu.2.17",
    ("linux", "aarch64"): "aarch64-linux-gnu.2.17",
    ("darwin", "x86_64"): "x86_64-macos.11.0",
    ("darwin", "arm64"): "aarch64-macos.11.0",
    ("win32", "AMD64"): "x86_64-windows-gnu",
}
"""Zig's names of platforms; the oldest of each, so that a wheel runs elsewhere, too."""

_PATIENCE_S = 300


def sources() -> list[Path]:
    """Return the C files."""
    return sorted((ROOT / "src").glob("*.c"))


def digest() -> str:
    """Return the digest of the sources, which a library carries that was built from them."""
    texts = [path.read_bytes() for path in [*sorted((ROOT / "src").glob("*.h")), *sources()]]
    return hashlib.sha256(b"".join(texts)).hexdigest()[:16]


def compiler() -> list[str]:
    """Return the command of the variable CC, else of cc, gcc or clang, else of the package ziglang; [] without one."""
    try:
        named = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise OSError(f"CC is no command: {error}") from error
    first = named or [path for path in map(shutil.which, ("cc", "gcc", "clang")) if path][:1]
    if first or importlib.util.find_spec("ziglang") is None:
        return first
    target = _TARGETS.get((sys.platform, platform.machine()))
    return [sys.executable, "-m", "ziglang", "cc", *(["-target", target] if target else []), "-mcpu=baseline"]


def build(folder: Path | None = None, extra: tuple[str, ...] = ()) -> Path:
    """Compile the sources into a folder, by default the package, beside their header; return the library's path.

    Raises
    ------
    OSError
        If there is no compiler, or it fails: the message is one line. An older library stays.
    """
    target = (folder or PACKAGE) / LIBRARY
    command = compiler()
    if not command:
        raise OSError("no C compiler found: none of cc, gcc and clang, no CC, and no package ziglang")
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        made = Path(scratch) / LIBRARY
        command += [*FLAGS, *extra, f'-DSOURCE="{digest()}"', "-o", str(made), *map(str, sources()), "-lm"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired as late:
            raise OSError(f"{command[0]} took more than {_PATIENCE_S} s") from late
        if done.returncode or not made.is_file():
            lines = done.stderr.strip().splitlines() or ["no message"]
            message = next((line for line in lines if "error" in line), lines[0])
            raise OSError(f"{command[0]} failed with status {done.returncode}: {message}")
        made.replace(target)  # processes that use the library now keep the old one
    shutil.copy(ROOT / "src" / "detector.h", target.parent)  # which the package reads
    return target


if __name__ == "__main__":
    try:
        print(f"built {build()}")
    except OSError as failure:
        sys.exit(f"markergen-detect was not built: {failure}")
