"""Accessibility of the studio and the report by Lighthouse, where it is installed (`npm install -g lighthouse`)."""

import json
import os
import shutil
import subprocess
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest

import markergen as mg

pytestmark = pytest.mark.browser


@contextmanager
def served(folder):
    """Serve a folder; yields its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=folder))
    Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("form", [[], ["--preset=desktop"]], ids=["phone", "desktop"])
@pytest.mark.parametrize("page", ["studio", "report"])
def test_lighthouse_finds_pages_accessible(page, form, tmp_path, request):
    lighthouse = os.environ.get("LIGHTHOUSE") or shutil.which("lighthouse")
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if not lighthouse or not chromium:
        pytest.skip("no lighthouse or no Chromium in the path")
    if page == "report":
        mg.validate(mg.design(n=5).marker, runs=2, views=2, report=tmp_path / "report.html")
    with served(tmp_path) as folder:
        address = request.getfixturevalue("address") if page == "studio" else f"{folder}report.html"
        command = [lighthouse, address, *form, "--only-categories=accessibility", "--output=json", "--quiet"]
        command += [f"--output-path={tmp_path / 'found.json'}", "--chrome-flags=--headless=new --no-sandbox"]
        subprocess.run(command, check=True, env={**os.environ, "CHROME_PATH": chromium}, timeout=300)
    audit_report = json.loads((tmp_path / "found.json").read_text())
    failed = [name for name, audit in audit_report["audits"].items() if audit["score"] == 0]
    assert audit_report["categories"]["accessibility"]["score"] >= 0.95, failed
