"""Build hook: compiles the optional part of detection. Without a compiler the installation goes on without it."""

import runpy
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags


class KernelHook(BuildHookInterface):
    """Puts the compiled library into the wheel, or for an editable installation into the source tree."""

    _scratch: str | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build before the wheel's files are collected."""
        build = runpy.run_path(str(Path(self.root, "markergen", "detect", "kernel_build.py")))["build"]
        try:
            if version == "editable":
                build()
                return
            self._scratch = tempfile.mkdtemp()
            library = build(Path(self._scratch))
        except OSError as error:
            self.app.display_warning(f"markergen is installed without the compiled part of detection: {error}")
            return
        build_data["force_include"][str(library)] = f"markergen/detect/{library.name}"
        build_data["pure_python"] = False
        # The library does not use Python's interface, so the wheel is for every Python, on this platform.
        platforms = (tag.platform for tag in sys_tags())
        build_data["tag"] = f"py3-none-{next(p for p in platforms if not p.startswith(('manylinux', 'musllinux')))}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove what was built for the wheel."""
        if self._scratch:
            shutil.rmtree(self._scratch, ignore_errors=True)
