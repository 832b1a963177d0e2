"""Programs that Debian installs, or a skip that says which package is missing."""

import shutil

import pytest


def program(package: str, *names: str) -> str:
    """Path of the first of several executables (the package's own name by default); skip the test if there is none."""
    result = next((path for name in names or (package,) if (path := shutil.which(name))), None)
    return result or pytest.skip(f"{package} is not installed")


def chromium() -> str:
    return program("chromium", "chromium", "chromium-browser", "google-chrome")
