"""Every block of code in README and docs runs as it stands, or carries the reason why not."""

import subprocess
import sys
import textwrap

import pytest

from docs.blocks import ROOT, blocks, pages, run

LEFT_OUT = {
    "README.md": 1,  # the installation
    "calibrate.md": 2,  # a live camera, two cameras
    "comparison.md": 2,  # takes minutes
    "detect.md": 1,
    "handeye.md": 1,  # a live camera
    "install.md": 2,  # the installation, another OpenCV
    "paper.md": 1,  # takes half an hour
    "plugins.md": 2,  # packages of others
    "ros2.md": 1,  # an installation of ROS
    "simulators.md": 1,  # OpenGL
    "start.md": 1,  # the installation
    "studio.md": 1,  # a server
    "study.md": 1,  # a cluster
}


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_every_block_is_run_or_says_why_not(page):
    results = list(blocks(page.read_text(encoding="utf-8")))
    unknown = [block.line for block in results if not block.kind and not block.left_out]
    assert not unknown, "mark these lines with <!-- file: NAME --> or <!-- not run: REASON -->, or as ```text"
    assert sum(bool(block.left_out) for block in results) == LEFT_OUT.get(page.name, 0)


def test_a_page_in_small(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [])
    page = tmp_path / "page.md"
    page.write_text(
        textwrap.dedent(
            """
            <!-- setup python:
            start = 3
            -->
            <!-- file: data.txt -->

            ```json
            [4]
            ```

            <!-- not run (forever): takes too long -->

            ```sh
            forever
            cat data.txt
            ```

            Then

                import json
                from pathlib import Path
                total = start + json.loads(Path("data.txt").read_text())[0]

            <!-- exits: 3 -->

            ```sh
            exit 3
            ```

            ```python
            print("total", total)
            ```
            """
        )
    )
    run(page, tmp_path)
    output = capfd.readouterr().out
    assert "[4]" in output
    assert "total 7" in output
    page.write_text("<!-- not run: no reason -->\n\nnothing\n")
    with pytest.raises(ValueError, match="block follows"):
        run(page, tmp_path)


@pytest.mark.docs
@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_page_runs_as_it_stands(page):
    done = subprocess.run([sys.executable, "-m", "docs.blocks", page], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
