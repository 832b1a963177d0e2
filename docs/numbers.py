"""Run the commands that README and docs name, and compare every number in the text with what they print.

    python -m docs.numbers                       all of them, the quick ones first
    python -m docs.numbers --only docs/paper.md  those of one file
    python -m docs.numbers --quick 60            only commands that take less than a minute

`docs/number_table.py` has an entry for each place with numbers, `docs/given_numbers.py` for those without a command.
A number that the text rounds must be what its command prints, rounded alike. Times depend on the machine, so they may
differ by a factor.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *(f"docs/{path.name}" for path in sorted(Path(__file__).parent.glob("*.md"))))
"""Files that are searched for numbers."""

ENVIRONMENT = {
    **os.environ,
    "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
    "ROOT": str(ROOT),
    "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path]),
}
"""Variables with which commands of pages find the program and the checkout."""

GENERATED = ("docs/cli.md", "docs/damage.md", "docs/templates.md")
"""Files that `make docs` writes."""

_NUMBER = r"-?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?"
_UNITS = (
    "%|deg|degrees?|um|mm|cm|m|px|ms|s|seconds?|min|minutes?|hours?|kB|MB|GB|times|dpi|rad|grey levels|kg|micrometers?"
)
_CLAIMED = re.compile(
    rf"(?<![\w.^-]){_NUMBER}(?!\w|\.\d|,\d)(?=\s*(?:{_UNITS})(?!\w))"
    r"|(?<![\w.,^-])-?\d[\d,]*\.\d+(?!\w|\.\d)"
)
"""Numbers with a unit, and numbers with decimals."""


@dataclass(frozen=True)
class Command:
    """Command line, run by the shell in an empty folder with the examples; and its typical time in s on one core."""

    line: str
    seconds: float


@dataclass(frozen=True)
class Number:
    """Place with numbers, and the output that has them.

    Attributes
    ----------
    file, place : str
        Text of the file, with # for each number that is compared, and @ for others.
    named : str
        Words of the file that name the command.
    sources : sequence of (Command, str)
        Commands, and the text of their outputs in the same way: # is compared, @ is not, and ... is anything on a line.
    compute : callable or None
        Numbers of the place from those of the outputs; as they are if None.
    factor : float
        Largest ratio of a number and the command's, for what depends on the machine; 0 for equal after rounding.
    """

    file: str
    place: str
    named: str
    sources: Sequence[tuple[Command, str]]
    compute: Callable[..., Sequence[float]] | None = None
    factor: float = 0.0


@dataclass(frozen=True)
class Block:
    """Lines of a file between two lines that must be in the output, such as a table of results.

    They are there as they are; with a factor, their numbers may differ by it, and counts by one.
    """

    file: str
    begin: str
    end: str
    named: str
    command: Command
    factor: float = 0.0


@dataclass(frozen=True)
class Given:
    """Numbers that no command gives: definitions, defaults, conditions of other numbers; # stands for each."""

    file: str
    place: str
    reason: str


Entry = Number | Block


def main() -> None:
    """Run the commands, print what differs, and exit with 1 if anything does."""
    from docs.number_table import MEASURED

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PAGES, help="one file")
    parser.add_argument(
        "--quick", type=float, default=float("inf"), metavar="S", help="commands of less than S seconds"
    )
    options = parser.parse_args()
    entries = [entry for entry in MEASURED if options.only in (None, entry.file)]
    commands = sorted({c for entry in entries for c in commands_of(entry)}, key=lambda c: (c.seconds, c.line))
    left = [command for command in commands if command.seconds < options.quick]
    outputs: dict[Command, str] = {}
    print(f"{len(left)} of {len(commands)} commands, about {sum(c.seconds for c in left) / 120:.0f} min", flush=True)
    with ThreadPoolExecutor(2) as pool:
        begin = time.monotonic()
        futures = {pool.submit(output_of, command): command for command in left}
        for done, future in enumerate(as_completed(futures), start=1):
            command = futures[future]
            outputs[command] = future.result()
            print(f"{done} of {len(left)}, {time.monotonic() - begin:.0f} s: {command.line}", flush=True)
    wrong = [fault for entry in entries for fault in faults(entry, outputs)]
    checked = sum(all(command in outputs for command in commands_of(entry)) for entry in entries)
    print(*wrong, f"{checked} of {len(entries)} places checked, {len(wrong)} differ", sep="\n")
    sys.exit(bool(wrong))


def commands_of(entry: Entry) -> list[Command]:
    """Commands of an entry."""
    return [entry.command] if isinstance(entry, Block) else [command for command, _ in entry.sources]


def output_of(command: Command) -> str:
    """Both outputs of a command, in a new folder from which the examples can be reached."""
    # Wide enough for every table.
    settings = {"OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        done = subprocess.run(
            command.line,
            shell=True,
            cwd=folder,
            env=ENVIRONMENT | settings,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
    return done.stdout


def faults(entry: Entry, outputs: dict[Command, str]) -> Iterator[str]:
    """Sentences about what differs from the outputs; nothing for commands that were not run."""
    if not all(command in outputs for command in commands_of(entry)):
        return
    if isinstance(entry, Block):
        have = [line.strip() for line in outputs[entry.command].splitlines()]
        for line in block(entry).splitlines():
            if line.strip() and not any(alike(line.strip(), other, entry.factor) for other in have):
                yield f"{entry.file}: not in what {entry.named} gives: {line}"
        return
    results = numbers_in(text_of(entry.file), entry.place)
    if results is None:
        yield f"{entry.file}: this place is not there any more: {entry.place}"
        return
    values: list[float] = []
    for command, output in entry.sources:
        stated = numbers_in(outputs[command], output)
        if stated is None:
            yield f"{entry.file}: {command.line} does not print: {output}\n{outputs[command][-500:]}"
            return
        values += map(value_of, stated)
    if entry.compute:
        values = list(entry.compute(*values))
    if len(results) != len(values):
        yield f"{entry.file}: {len(results)} numbers, but {len(values)} of the command, in: {entry.place}"
    for printed, value in zip(results, values, strict=False):
        if not agree(printed, value, entry.factor):
            yield f"{entry.file}: {printed} in the text, {value:.6g} by {entry.named}: {entry.place}"


def alike(line: str, other: str, factor: float) -> bool:
    """True if two lines are equal, or differ only in numbers, by a factor or in counts by one."""
    if line == other or not factor or re.sub(_NUMBER, "#", line) != re.sub(_NUMBER, "#", other):
        return line == other
    return all(
        one == two
        or agree(one, value_of(two), factor)
        or (one.isdigit() and two.isdigit() and abs(int(one) - int(two)) == 1)
        for one, two in zip(re.findall(_NUMBER, line), re.findall(_NUMBER, other), strict=True)
    )


def agree(printed: str, value: float, factor: float = 0.0) -> bool:
    """True if a number as shown is a value, rounded alike, or lies within a factor of it."""
    number = value_of(printed)
    if factor:
        return bool(value / factor <= number <= value * factor)
    decimals = len(printed.partition(".")[2])
    # A value that the output has rounded already may be a half.
    return abs(number - value) <= 0.5 * 10.0**-decimals * (1 + 1e-6)


def value_of(printed: str) -> float:
    """Value of a number with or without thousands separators."""
    return float(printed.replace(",", ""))


@cache
def text_of(file: str) -> str:
    """Text of a file of this repository."""
    return (ROOT / file).read_text(encoding="utf-8")


def numbers_in(text: str, place: str) -> list[str] | None:
    """Numbers at the # of a place in a text, whose white space does not matter; None if it is not there."""
    optimum = pattern(place).search(text)
    return list(optimum.groups()) if optimum else None


@cache
def pattern(place: str) -> re.Pattern[str]:
    """Regular expression of a place: # and @ are numbers, ... is anything on a line, white space is any."""
    phrase = (re.escape(word).replace(r"\.\.\.", r"[^\n]*?") for word in place.split())
    number = rf"(?<![\d.]){_NUMBER}(?:e[-+]?\d+)?"
    return re.compile(r"\s+".join(phrase).replace(r"\#", f"({number})").replace("@", f"(?:{number})"))


def block(entry: Block) -> str:
    """Text of a block."""
    _, result, rest = text_of(entry.file).partition(entry.begin)
    inside, ended, _ = rest.partition(entry.end)
    if not (result and ended):
        raise ValueError(f"{entry.file} has no block from {entry.begin!r} to {entry.end!r}")
    return inside


def uncovered(file: str, entries: Sequence[Number | Block | Given]) -> list[str]:
    """Numbers of a file with a unit or decimals, each with its line, that no entry stands for.

    Code is left out, except for its comments.
    """
    text = text_of(file)
    covered = [False] * len(text)
    for entry in entries:
        if entry.file != file:
            continue
        if isinstance(entry, Block):
            start = text.index(entry.begin)
            spans = [(start, start + len(entry.begin) + len(block(entry)))]
        else:
            optimum = pattern(entry.place).search(text)
            if not optimum:
                raise ValueError(f"{file}: this place is not there any more: {entry.place}")
            spans = [optimum.span(i + 1) for i in range(len(optimum.groups()))]
        for begin, end in spans:
            covered[begin:end] = [True] * (end - begin)
    prose = _prose(text)
    return [
        f"{file}:{prose.count(chr(10), 0, match.start()) + 1}: {match.group()} in "
        f"'{' '.join(text[max(0, match.start() - 40) : match.end() + 20].split())}'"
        for match in _CLAIMED.finditer(prose)
        if not covered[match.start()]
    ]


def _prose(text: str) -> str:
    """Text with code, links and tags blanked out, at the same places."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", match.group())

    def code(match: re.Match[str]) -> str:
        line, mark, comment = match.group().partition(" # ")
        return " " * len(line + mark) + comment

    text = re.sub(r"```.*?```", blank, text, flags=re.DOTALL)
    text = re.sub(r"(?m)^    .*$", code, text)
    for item in (r"`[^`\n]*`", r"\]\([^)]*\)", r"<[^>]*>"):
        text = re.sub(item, blank, text)
    return text


if __name__ == "__main__":
    # As the table imports it, so that its entries are of the same classes.
    from docs.numbers import main as imported

    imported()
