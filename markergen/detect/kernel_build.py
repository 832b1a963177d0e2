"""Building the compiled part of detection, kernel.c: at installation and by hand.

The build hook loads this file by its path, before the package is installed, so it imports the standard library alone.
"""
# tests: tests/detect/test_kernel.py tests/test_packaging.py

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCE = Path(__file__).with_name("kernel.c")
SOURCES = [SOURCE, *(SOURCE.with_name(f"kernel_{part}.c") for part in ("fit", "pose", "blur"))]

LIBRARY = "libkernel.dll" if sys.platform == "win32" else "libkernel.so"
"""Name of the compiled library, in the same folder. Python would import a `kernel.so` instead of kernel.py."""

_FLAGS = ["-O3", "-std=c99", "-shared", "-fPIC", "-ffp-contract=off"]
"""No instructions that other computers of the kind lack, and every operation rounded: the same numbers everywhere."""

_PATIENCE_S = 120


def digest() -> str:
    """Return the digest of the sources, which a library carries that was built from them."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:16]


def build(folder: Path | None = None) -> Path:
    """Compile the sources and return the library's path.

    The compiler is that of the environment variable CC, or the first of cc, gcc and clang that is there.

    Parameters
    ----------
    folder : path, optional
        Where the library goes; by default beside kernel.c, where it is looked for.

    Raises
    ------
    OSError
        If there is no compiler, or it fails: the message is one line. An older library stays.
    """
    target = (folder or SOURCE.parent) / LIBRARY
    try:
        named = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise OSError(f"CC is no command: {error}") from error
    compiler = named or [path for path in map(shutil.which, ("cc", "gcc", "clang")) if path][:1]
    if not compiler:
        raise OSError("no C compiler found: none of cc, gcc and clang, and CC is not set")
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        made = Path(scratch) / LIBRARY
        command = [*compiler, *_FLAGS, f'-DSOURCE="{digest()}"', "-o", str(made), *map(str, SOURCES), "-lm"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired as late:
            raise OSError(f"{compiler[0]} took more than {_PATIENCE_S} s") from late
        if done.returncode or not made.is_file():
            said = (done.stderr.strip() or "no message").splitlines()[0]
            raise OSError(f"{compiler[0]} failed with status {done.returncode}: {said}")
        # Processes that use the library now keep the old one.
        made.replace(target)
    return target


if __name__ == "__main__":
    try:
        print(f"built {build()}")
    except OSError as failure:
        sys.exit(f"the compiled part of detection was not built: {failure}")
