"""Measure the structure of the code, or compare it with that of another commit.

python -m benchmarks.structure --against HEAD~100 --without detect
python -m benchmarks.structure --list meaningless

- Lines are code, docstring (of a module, class or function), comment (nothing else on the line) or blank. Strings below
  a constant or field are code and also have a row of their own, as have comments after code, without `noqa` and `fmt`.
- An arrow leads from a module to one that it imports, also within a function, but not for TYPE_CHECKING alone. Floors
  are the modules of the longest chain of arrows. Sibling arrows join two of the packages in LEAVES.
- A single importer is the one module that imports another; listed is the module that it imports. Modules that nothing
  imports are entries of tables, or are run by name. An `__init__` is neither of the two.
- Doubles are names that two modules or more define at their top level.
- A binding is a parameter or an assigned name (by `=`, `for`, `with`, `:=`, a comprehension, a field of a class), not
  an attribute, a keyword of a call, an import, or the name of a function or class. Those in MEANINGLESS, in a second
  row those in WIDER, are words of grammar that name no thing.
- A tuned number is a constant of a module whose value is a number, arithmetic with numbers, or a tuple or list of them.
  It has a note if a string follows it, or if a comment stands above it or on its lines.
- Names given are what another module imports by name, or uses as attribute of the imported module. A pair of modules is
  cut in two if one gives the other MANY_NAMES or more that no third module uses.
- Prose is a string of PROSE_WORDS words or more, in the condition of an assert or in the `match=` of a call within the
  tests. A word is two letters or more between blanks, with marks around it: `--paper`, `0.2` and `m.pdf` are none.

`--without` leaves the modules of a package out, and their arrows; they still count as importers of the others.
"""

import argparse
import ast
import gc
import io
import re
import subprocess
import tarfile
import tempfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, cached_property
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1] / "markergen"
MEANINGLESS = frozenset(["each", "found", "own", "said", "known", "told", "shown", "given", "some", "near", "words"])
WIDER = MEANINGLESS | {"other", "one", "made"}
LEAVES = frozenset({"verification", "calibration", "comparison", "studies", "studio", "workshop"})
LARGE_LINES = 500
MANY_NAMES = 6
TOP_PAIRS = 15
PROSE_WORDS = 4
WORD = re.compile(r"""[("'^]*[A-Za-z][A-Za-z'-]+[.,:;!?)"'$]*""")
PRAGMAS = ("noqa", "fmt:", "type:", "pragma:")
NO_CODE = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER, tokenize.COMMENT}


class Place(NamedTuple):
    """One of the places behind a figure, and the heading that it is listed below."""

    heading: str
    text: str


class Figure(NamedTuple):
    """A row of the table: a count, its share in percent or what else it says, and the places that it counts."""

    number: int
    remark: str = ""
    places: tuple[Place, ...] = ()

    def __str__(self) -> str:
        return f"{self.number:9,} {self.remark}"


class Module:
    """What stands in one file."""

    def __init__(self, root: Path, path: Path) -> None:
        text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(text)
        self.nodes: dict[type[ast.AST], list[ast.AST]] = defaultdict(list)
        for node in ast.walk(self.tree):
            self.nodes[type(node)].append(node)
        self.path = path.relative_to(root).as_posix()
        self.package = Path(self.path).parts[0].removesuffix(".py")
        self.name = ".".join([root.name, *Path(self.path).with_suffix("").parts]).removesuffix(".__init__")
        self.text = text
        self.lines = len(text.splitlines())

    @cached_property
    def tokens(self) -> list[tokenize.TokenInfo]:
        return list(tokenize.generate_tokens(io.StringIO(self.text).readline))

    @cached_property
    def comments(self) -> dict[int, str]:
        """Comments by their lines."""
        tokens = (token for token in self.tokens if token.type == tokenize.COMMENT)
        return {token.start[0]: token.string for token in tokens if not token.string.lstrip("# ").startswith(PRAGMAS)}

    @cached_property
    def docstring_lines(self) -> set[int]:
        bodies = [node.body for node in self.of(ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)]
        return lines_of(body[0] for body in bodies if body and is_string(body[0]))

    @cached_property
    def string_lines(self) -> set[int]:
        return lines_of(filter(is_string, self.of(ast.Expr))) - self.docstring_lines

    @cached_property
    def code_lines(self) -> set[int]:
        tokens = (token for token in self.tokens if token.type not in NO_CODE)
        return {line for token in tokens for line in range(token.start[0], token.end[0] + 1)} - self.docstring_lines

    def of(self, *kinds: type[ast.AST]) -> Iterator[Any]:
        """Return the nodes of some kinds."""
        return chain.from_iterable(self.nodes[kind] for kind in kinds)

    def place(self, line: int, text: str) -> Place:
        return Place(self.package, f"{self.path}:{line}: {text}")

    def bindings(self) -> list[tuple[str, int]]:
        names = [(node.id, node.lineno) for node in self.of(ast.Name) if isinstance(node.ctx, ast.Store)]
        return names + [(node.arg, node.lineno) for node in self.of(ast.arg)]

    def rig_branches(self) -> list[Place]:
        calls = (node for node in self.of(ast.Call) if ast.unparse(node.func) == "isinstance")
        return [self.place(node.lineno, ast.unparse(node)) for node in calls if ast.unparse(node.args[1]) == "Rig"]

    def constants(self) -> list[tuple[ast.Name, ast.expr | None, bool]]:
        """Return the names assigned at top level with their values, and whether a note stands beside them."""
        constants = []
        for statement, following in pairwise([*self.tree.body, ast.Pass()]):
            if isinstance(statement, ast.Assign | ast.AnnAssign):
                targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                beside = lines_of([statement]) | {statement.lineno - 1} - self.code_lines
                has_note = is_string(following) or bool(beside & self.comments.keys())
                names = (node for target in targets for node in ast.walk(target) if isinstance(node, ast.Name))
                constants += [(name, statement.value, has_note) for name in names]
        return constants

    def definitions(self, *kinds: type[ast.stmt]) -> set[str]:
        return {node.name for node in self.tree.body if isinstance(node, kinds)}  # type: ignore[attr-defined]

    def import_statements(self) -> list[ast.Import | ast.ImportFrom]:
        """Return the imports of the module, wherever in it, without those that are for a type checker alone."""
        checks = [node for node in self.of(ast.If) if "TYPE_CHECKING" in ast.unparse(node.test)]
        types_only = {node for check in checks for statement in check.body for node in ast.walk(statement)}
        return [node for node in self.of(ast.Import, ast.ImportFrom) if node not in types_only]

    def imports(self, modules: Iterable[str]) -> dict[str, set[str]]:
        """Return the names taken from each of the modules that this one imports when it runs."""
        taken: dict[str, set[str]] = defaultdict(set)
        aliases: dict[str, str] = {}
        for node in self.import_statements():
            source = getattr(node, "module", None) or ""
            for alias in node.names:
                whole = f"{source}.{alias.name}" if source else alias.name
                if whole in modules:
                    aliases[alias.asname or alias.name] = whole
                    taken[whole].update()
                elif source in modules:
                    taken[source].add(alias.name)
        for node in self.of(ast.Attribute) if aliases else ():
            if isinstance(node.value, ast.Name) and node.value.id in aliases:
                taken[aliases[node.value.id]].add(node.attr)
        return {name: names for name, names in taken.items() if name != self.name}


class Arrow(NamedTuple):
    """An import, and the names that it takes."""

    importer: Module
    module: Module
    names: set[str]

    def place(self) -> Place:
        names = ", ".join(sorted(self.names))
        return Place("", f"{self.importer.path} <- {self.module.path}: {len(self.names)}: {names}")


def is_string(statement: ast.stmt) -> bool:
    """Return whether a statement is a string alone: a docstring, or what stands below a constant."""
    return isinstance(statement, ast.Expr) and isinstance(getattr(statement.value, "value", None), str)


def is_number(value: ast.expr | None) -> bool:
    """Return whether an expression is made of numbers alone."""
    match value:
        case ast.UnaryOp():
            return is_number(value.operand)
        case ast.BinOp():
            return is_number(value.left) and is_number(value.right)
        case ast.Tuple() | ast.List():
            return bool(value.elts) and all(map(is_number, value.elts))
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def lines_of(statements: Iterable[ast.stmt]) -> set[int]:
    return {line for node in statements for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}


def counted(places: Iterable[Place], remark: str = "", share_of: int = 0) -> Figure:
    places = tuple(places)
    return Figure(len(places), f"({len(places) / share_of:.1%})" if share_of else remark, places)


def doubles(definitions: Iterable[tuple[str, Module]]) -> Figure:
    """Count the names that two modules or more define."""
    paths = defaultdict(set)
    for name, module in definitions:
        paths[name].add(module.path)
    places = [Place("", f"{name}: {', '.join(sorted(paths[name]))}") for name in sorted(paths) if len(paths[name]) > 1]
    return counted(places)


def size_figures(modules: list[Module]) -> dict[str, Figure]:
    lines = sum(module.lines for module in modules)
    comments = [(m.place(line, m.comments[line]), line in m.code_lines) for m in modules for line in sorted(m.comments)]
    alone = [place for place, is_after_code in comments if not is_after_code]
    return {
        "modules": Figure(len(modules)),
        "lines": Figure(lines),
        "code-lines": Figure(sum(len(module.code_lines) for module in modules)),
        "docstring-lines": Figure(sum(len(module.docstring_lines) for module in modules)),
        "strings-below-names": Figure(sum(len(module.string_lines) for module in modules), "lines"),
        "comments": counted(alone, f"({1000 * len(alone) / lines:.1f} in 1,000 lines)"),
        "comments-after-code": counted(place for place, is_after_code in comments if is_after_code),
    }


def import_figures(modules: list[Module], arrows: list[Arrow]) -> dict[str, Figure]:
    importers: dict[str, list[Module]] = defaultdict(list)
    imports: dict[str, list[str]] = defaultdict(list)
    users: dict[str, Counter[str]] = defaultdict(Counter)
    for arrow in arrows:
        importers[arrow.module.name].append(arrow.importer)
        imports[arrow.importer.name].append(arrow.module.name)
        users[arrow.module.name].update(arrow.names)

    @cache
    def longest_chain(name: str) -> tuple[str, ...]:
        return (name, *max(map(longest_chain, imports[name]), key=len, default=()))

    arrows = [arrow for arrow in arrows if arrow.importer in modules]
    crossing = [arrow for arrow in arrows if arrow.importer.package != arrow.module.package]
    siblings = [arrow for arrow in crossing if {arrow.importer.package, arrow.module.package} <= LEAVES]
    floors = max((longest_chain(module.name) for module in modules), key=len)
    files = [module for module in modules if not module.path.endswith("__init__.py")]
    singles = [module for module in files if len(importers[module.name]) == 1]
    exchanges = sorted(arrows, key=lambda arrow: -len(arrow.names))
    many = [arrow for arrow in exchanges if len(arrow.names) >= MANY_NAMES]
    unshared = [
        arrow._replace(names={name for name in arrow.names if users[arrow.module.name][name] == 1}) for arrow in arrows
    ]
    large = [module for module in modules if module.lines > LARGE_LINES]
    return {
        "arrows": Figure(len(arrows), f"({len(crossing):,} between packages)"),
        "sibling-arrows": counted(map(Arrow.place, siblings)),
        "floors": counted(Place("", name) for name in floors),
        "single-importers": counted(
            (Place(m.package, f"{m.path} ({m.lines} lines) <- {importers[m.name][0].path}") for m in singles),
            f"({sum(module.lines for module in singles):,} lines)",
        ),
        "never-imported": counted(Place(module.package, module.path) for module in files if not importers[module.name]),
        "names-given": Figure(
            sum(len(arrow.names) for arrow in arrows), "", tuple(map(Arrow.place, exchanges[:TOP_PAIRS]))
        ),
        "givers-of-many": counted(map(Arrow.place, many), f"pairs of {len({arrow.module for arrow in many})} modules"),
        "cut-in-two": counted(map(Arrow.place, (arrow for arrow in unshared if len(arrow.names) >= MANY_NAMES))),
        "large": counted(
            Place(m.package, f"{m.path}: {m.lines} lines, {len(users[m.name])} names used outside") for m in large
        ),
    }


def name_figures(modules: list[Module]) -> dict[str, Figure]:
    classes = [(name, module) for module in modules for name in module.definitions(ast.ClassDef)]
    functions = [(n, m) for m in modules for n in m.definitions(ast.FunctionDef, ast.AsyncFunctionDef)]
    constants = [(module, *constant) for module in modules for constant in module.constants()]
    public = [(name, module) for name, module in classes + functions if not name.startswith("_")]
    public_constants = [(name.id, module) for module, name, *_ in constants if not name.id.startswith("_")]
    numbers = [(m.place(name.lineno, name.id), note) for m, name, value, note in constants if is_number(value)]
    bindings = [(name, module.place(line, name)) for module in modules for name, line in module.bindings()]
    meaningless = [place for name, place in bindings if name in MEANINGLESS]
    wider = [place for name, place in bindings if name in WIDER]
    return {
        "double-classes": doubles(classes),
        "double-public": doubles(public),
        "doubles": doubles(public + public_constants),
        "bindings": Figure(len(bindings)),
        "meaningless": counted(meaningless, share_of=len(bindings)),
        "meaningless-wider": counted(wider, share_of=len(bindings)),
        "rig-branches": counted(place for module in modules for place in module.rig_branches()),
        "numbers": counted(place for place, _ in numbers),
        "numbers-without-note": counted((place for place, note in numbers if not note), share_of=len(numbers)),
    }


def has_prose(expression: ast.expr) -> bool:
    """Return whether one of the strings in an expression is a sentence, or a good part of one."""
    strings = (node.value for node in ast.walk(expression) if isinstance(node, ast.Constant))
    texts = (string for string in strings if isinstance(string, str))
    return any(sum(map(bool, map(WORD.fullmatch, text.split()))) >= PROSE_WORDS for text in texts)


def prose_figures(tests: Path, left_out: Sequence[str] = ()) -> dict[str, Figure]:
    asserts: list[Place] = []
    matches: list[Place] = []
    for file in (path.relative_to(tests) for path in sorted(tests.rglob("*.py"))):
        if file.parts[0] in left_out:
            continue
        for node in ast.walk(ast.parse((tests / file).read_text(encoding="utf-8"))):
            match node:
                case ast.Assert(test=expression) if has_prose(expression):
                    places = asserts
                case ast.keyword(arg="match", value=expression) if has_prose(expression):
                    places = matches
                case _:
                    continue
            places.append(Place(file.parts[0], f"{file.as_posix()}:{node.lineno}: {ast.unparse(expression)}"))
    return {"prose-asserts": counted(asserts), "prose-matches": counted(matches)}


@contextmanager
def no_search_for_garbage() -> Iterator[None]:
    """In trees it finds none, and takes as long as parsing them."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def package(root: Path, left_out: Sequence[str] = ()) -> tuple[list[Module], list[Arrow]]:
    """Return the modules of the package in a folder, and who imports them."""
    with no_search_for_garbage():
        every = {module.name: module for module in (Module(root, path) for path in sorted(root.rglob("*.py")))}
    modules = [module for module in every.values() if module.package not in left_out]
    arrows = [
        Arrow(importer, every[name], names)
        for importer in every.values()
        for name, names in sorted(importer.imports(every).items())
        if every[name] in modules
    ]
    return modules, arrows


def structure(root: Path, left_out: Sequence[str] = ()) -> dict[str, Figure]:
    """Return the figures of the package in a folder and of the tests beside it, by their keys."""
    modules, arrows = package(root, left_out)
    tests = prose_figures(root.parent / "tests", left_out)
    return size_figures(modules) | import_figures(modules, arrows) | name_figures(modules) | tests


def main() -> None:
    """Print the figures, beside those of another commit if asked, and the lists."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="REV", help="a commit, whose figures stand in front")
    parser.add_argument("--without", metavar="PACKAGE", action="append", default=[], help="leave a package out")
    parser.add_argument("--list", metavar="KEY", action="append", default=[], help="list the places behind a figure")
    options = parser.parse_args()
    columns = [structure(ROOT, options.without)]
    if unlisted := set(options.list) - columns[0].keys():
        parser.error(f"there is no {min(unlisted)!r}; there are {', '.join(columns[0])}")
    if options.against:
        with tempfile.TemporaryDirectory() as folder:
            command = ["git", "-C", str(ROOT.parent), "archive", options.against, ROOT.name, "tests"]
            archive = subprocess.run(command, check=True, capture_output=True).stdout
            with tarfile.open(fileobj=io.BytesIO(archive)) as files:
                files.extractall(folder, filter="data")
            columns.insert(0, structure(Path(folder) / ROOT.name, options.without))
    for key in columns[-1]:
        print(f"{key:22}", *(f"{column[key]!s:36}" for column in columns))
    for key in options.list:
        print(f"\n== {key} ==")
        for heading, places in groupby(columns[-1][key].places, key=lambda place: place.heading):
            texts = [place.text for place in places]
            print(*([f"{heading}: {len(texts)}"] if heading else []), *texts, sep="\n")


if __name__ == "__main__":
    main()
