"""Run every block of code of README or of a page in docs/, in order and in one empty folder, as a reader would.

python -m docs.blocks docs/detect.md

`sh` blocks, and indented ones that begin with a command, are run by bash, `python` blocks in one namespace a page.
`text` is output. What readers do not see says the rest, in comments of one or more lines above a block:

    <!-- file: sweep.toml -->                  the block is the content of this file
    <!-- not run: needs a camera -->           or: not run (detect 0): ..., only the lines with these words
    <!-- exits: 1 -->                          the status that this command ends with
    <!-- setup: markergen design -->           commands for what a reader already has; $ROOT is the checkout
    <!-- setup python: frame = ... -->         the same in the namespace of the Python blocks
"""

import argparse
import ast
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from docs.numbers import ENVIRONMENT, PAGES, ROOT

GENERATED = {"cli.md", "api.md", "changelog.md"}
COMMANDS = {"markergen", "python", "pip", "echo", "make", "colcon", "ros2"}
MARK = re.compile(r"<!-- (setup python|setup|not run|file|exits)(?: \(([^)]+)\))?:\s(.*?)-->", re.DOTALL)
MINUTES = 5


@dataclass
class Block:
    """A block: where it begins, what it is (sh, python, file or text; empty if nothing shows it), and its marks."""

    line: int
    kind: str
    text: str
    marks: dict[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def left_out(self) -> str:
        """Why the block, or part of it, is not run; empty if all of it is."""
        return self.marks.get("not run", ("", ""))[1]

    def runnable(self) -> str:
        """Return the text without the lines that are marked as not run."""
        phrase, reason = self.marks.get("not run", ("", ""))
        if reason and not phrase:
            return ""
        return "".join(line for line in self.text.splitlines(keepends=True) if not phrase or phrase not in line)


def pages() -> list[Path]:
    """Return README and the pages that are written by hand."""
    return [ROOT / page for page in PAGES if Path(page).name not in GENERATED]


def _fenced(lines: list[str], k: int) -> tuple[str, str, int]:
    opening = re.match(r"( *)(`{3,})\s*([\w+-]*)", lines[k])
    assert opening
    indent, ticks, language = opening.groups()
    end = next(e for e in range(k + 1, len(lines)) if lines[e].strip() == ticks)
    text = "".join(line.removeprefix(indent) + "\n" for line in lines[k + 1 : end])
    return text, {"sh": "sh", "python": "python", "text": "text"}.get(language, ""), end + 1


def _indented(lines: list[str], k: int) -> tuple[str, str, int]:
    end = k
    while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
        end += 1
    text = "\n".join(line[4:] for line in lines[k:end]).rstrip() + "\n"
    if text.split(maxsplit=1)[0] in COMMANDS:
        return text, "sh", end
    try:
        ast.parse(text)
    except SyntaxError:
        return text, "", end
    return text, "python", end


def blocks(source: str) -> Iterator[Block]:
    """Yield the blocks of a page, with hidden ones for its set-up.

    Raises
    ------
    ValueError
        For a mark that no block follows.
    """
    lines = source.splitlines()
    marks: dict[str, tuple[str, str]] = {}
    k = 0
    while k < len(lines):
        line = lines[k]
        blank_above = k == 0 or not lines[k - 1].strip()
        if line.startswith("<!-- ") and (mark := MARK.match("\n".join(lines[k:]))):
            word, of, text = mark.group(1), mark.group(2) or "", mark.group(3).strip()
            if word.startswith("setup"):
                yield Block(k + 1, "python" if word.endswith("python") else "sh", text + "\n", {"setup": ("", text)})
            else:
                marks[word] = (of, text)
            k += mark.group().count("\n") + 1
            continue
        if re.match(r" *```", line):
            text, kind, end = _fenced(lines, k)
        elif line.startswith("    ") and line.strip() and blank_above:
            text, kind, end = _indented(lines, k)
        else:
            if line.strip() and marks:
                raise ValueError(f"line {k + 1}: a block follows {', '.join(marks)}, found {line[:40]!r}")
            k += 1
            continue
        block = Block(k + 1, "file" if "file" in marks else kind, text, marks)
        marks, k = {}, end
        yield block


def run(page: Path, folder: Path) -> None:
    """Run all blocks of a page in a folder, with a line about each.

    Raises
    ------
    subprocess.CalledProcessError
        If a command ends with another status than the page says.
    Exception
        Whatever a Python block raises.
    """
    os.chdir(folder)
    sys.argv = [page.name]
    names = {"__name__": "__main__"}
    for block in blocks(page.read_text(encoding="utf-8")):
        text, start = block.runnable(), time.monotonic()
        if not text.strip() or block.kind == "text":
            continue
        print(f"{page.name}:{block.line}: {text.splitlines()[0]}", flush=True)
        if block.kind == "file":
            path = folder / block.marks["file"][1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        elif block.kind == "python":
            exec(compile("\n" * block.line + text, page.name, "exec"), names)
        else:
            bash = ["bash", "-euo", "pipefail", "-c", text]
            done = subprocess.run(bash, env=ENVIRONMENT, stdin=subprocess.DEVNULL, timeout=60 * MINUTES)
            if done.returncode != int(block.marks.get("exits", ("", "0"))[1]):
                raise subprocess.CalledProcessError(done.returncode, text)
        print(f"{page.name}:{block.line}: {time.monotonic() - start:.1f} s", flush=True)


def main() -> None:
    """Run one page in a folder that is removed afterwards."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("page", type=Path)
    page = parser.parse_args().page.resolve()
    with tempfile.TemporaryDirectory() as folder:
        run(page, Path(folder).resolve())
        os.chdir(ROOT)


if __name__ == "__main__":
    main()
