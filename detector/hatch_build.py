"""Build hook: compiles the core, with the package ziglang where the machine has no compiler."""

import runpy
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags


class CoreHook(BuildHookInterface):
    """Puts the compiled core into the wheel, or for an editable installation into the source tree."""

    _scratch: "str | None" = None

    def dependencies(self) -> "list[str]":
        """Ask for a compiler from the package index where there is none."""
        return [] if self._core["compiler"]() else ["ziglang>=0.12"]

    def initialize(self, version: str, build_data: "dict[str, Any]") -> None:
        """Build before the wheel's files are collected."""
        try:
            if version == "editable":
                self._core["build"]()
                return
            self._scratch = tempfile.mkdtemp()
            library = self._core["build"](Path(self._scratch))
        except OSError as error:
            raise SystemExit(f"markergen-detect cannot be built: {error}") from None
        for path in library.parent.iterdir():
            build_data["force_include"][str(path)] = f"markergen_detect/{path.name}"
        build_data["pure_python"] = False
        # The library does not use Python's interface, so the wheel is for every Python, on this platform.
        platforms = (tag.platform for tag in sys_tags())
        build_data["tag"] = f"py3-none-{next(p for p in platforms if not p.startswith(('manylinux', 'musllinux')))}"

    def finalize(self, version: str, build_data: "dict[str, Any]", artifact_path: str) -> None:  # noqa: ARG002
        """Remove what was built for the wheel."""
        if self._scratch:
            shutil.rmtree(self._scratch, ignore_errors=True)

    @property
    def _core(self) -> "dict[str, Any]":
        return runpy.run_path(str(Path(self.root, "build_core.py")))
