"""Parse a calibration file in YAML, JSON, XML or TOML into plain values, and write YAML.

Files are untrusted: none can make the parser run for long, exhaust memory, or build anything but text, lists and
mappings. Numbers remain text until they are requested, since formats write them differently.
"""

# tests: tests/read/test_camera_files.py tests/read/test_cameras.py

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from typing import Any

from markergen.errors import InputError, brief, reason_of
from markergen.guard import KINDS, Content, text_of
from markergen.model.json_text import parsed_toml
from markergen.read.remarks import remark

DEEPEST = 20
"""Maximum nesting of lists and mappings; calibration files need four levels."""

_LONGEST_KEY = 40
"""Maximum length of keys that are looked for in any spelling; the longest has 23, distortion_coefficients."""
_UNIT = re.compile(r"_(px|pix|pixels?)$", re.IGNORECASE)
_TOML = re.compile(r"\[+[\w.\"-]+\]|[\w.\"-]+\s*=")
_OPENCV_HEADER = re.compile(r"\A\s*%YAML:1\.\d[^\n]*")  # Not YAML: OpenCV before 5 writes the directive with a colon.


NAMED = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Keys of single coefficients."""

KEYS: dict[str, tuple[str, ...]] = {
    "matrix": ("camera_matrix", "K", "intrinsic_matrix", "mtx", "M", "camera_intrinsics", "intrinsics_matrix",
               "intrinsic", "intrinsics", "matrix", "cam_K", "camera_intrinsic"),
    "coefficients": ("distortion_coefficients", "D", "dist_coeffs", "distortion_coeffs", "dist", "dist_coeff", "coeffs",
                     "distortion_coeff", "distortions", "distCoef", "distortion", "distortion_parameters",
                     "cameraExtrinsics", "distortion_coefs", "kc"),
    "radial": ("radial", "radial_distortion"),
    "tangential": ("tangential", "tangential_distortion"),
    "model": ("distortion_model",),
    "width": ("image_width", "width", "img_width", "w", "cols", "resolution_x"),
    "height": ("image_height", "height", "img_height", "h", "rows", "resolution_y"),
    "size": ("image_size", "resolution", "img_size", "camera_resolution", "image_resolution", "imagersize",
             "image_dimension", "size", "S"),
    "shape": ("image_shape", "img_shape", "shape"),
    "fx": ("fx", "fl_x", "focal_length_x"),
    "fy": ("fy", "fl_y", "focal_length_y"),
    "cx": ("cx", "ppx", "principal_point_x", "u0"),
    "cy": ("cy", "ppy", "principal_point_y", "v0"),
    "focal": ("focal_length", "focal_lengths", "focal", "fc", "camera_params"),
    "principal": ("principal_point", "center", "cc"),
    "part": ("x_offset", "y_offset", "height", "width"),
}  # fmt: skip
"""Keys by what they have, the first that messages name; `part` is the region of interest of a ROS message."""


def plain(key: str) -> str:
    """Return a key without what its spelling may vary in."""
    return re.sub(r"[\W_]", "", key.lower())


SIDES = frozenset(map(plain, (*KEYS["width"], *KEYS["height"])))
KNOWN = frozenset(map(plain, NAMED)).union(*(map(plain, KEYS[name]) for name in KEYS if name != "part"))
"""What `plain` makes of the keys of sides, and of all."""


class NoSizeError(InputError):
    """A camera file without the size of its images."""


def document_of(values: Mapping[str, Any], name: str) -> "Document":
    """Make a document from values as in a file or from a message's attributes; arrays and tuples are accepted too."""
    try:
        data = json.dumps(values, default=_listed).encode()
    except RecursionError:
        problem = "endless nesting"
    except (TypeError, ValueError) as error:
        problem = str(error)[:80]
    else:
        return Document(name, data)
    raise InputError(f"text, numbers, lists and dicts in {name}", problem, "give what the file holds")


def _listed(value: object) -> Any:
    """Convert arrays to lists and mappings to dicts, for json."""
    if isinstance(value, Mapping):
        return dict(value)
    if callable(getattr(value, "tolist", None)):  # Of numpy, and of array.array, which is what ROS 2 has for D.
        return value.tolist()  # type: ignore[attr-defined]
    raise TypeError(f"{type(value).__name__} {brief(value)}")


def yaml_text(values: Mapping[str, Any]) -> str:
    """YAML of tables in the given order, with the innermost lists and mappings on one line.

    Arrays (m, n) are written as ROS has them: rows, cols and data.
    """
    import yaml

    def stored(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: stored(item) for key, item in value.items()}
        if not hasattr(value, "shape"):
            return value
        return {"rows": value.shape[0], "cols": value.shape[1], "data": value.ravel().tolist()}

    return str(yaml.safe_dump(stored(values), sort_keys=False, default_flow_style=None, width=110))


@dataclass(frozen=True)
class Document:
    """A file's name and bytes; raises InputError if a requested text or value is not in it.

    `size` is the width and height in px that the user gave, for files without them; `tables` are those that a reader
    read, if it read by keys.
    """

    name: str
    data: bytes
    size: tuple[int, int] | None = None
    tables: "list[Fields]" = field(default_factory=list, compare=False, repr=False)

    @cached_property
    def text(self) -> str:
        """Entire text."""
        return text_of(Content(self.name, self.data))

    @cached_property
    def lines(self) -> list[str]:
        """Lines that are neither blank nor comments."""
        stripped = (line.strip() for line in self.text.splitlines())
        return [line for line in stripped if line and not line.startswith("#")]

    @property
    def fields(self) -> "Fields":
        """Values by key; empty if the file has no keys and values."""
        if isinstance(self._parsed, InputError):
            raise self._parsed
        return self._parsed

    @cached_property
    def _parsed(self) -> "Fields | InputError":
        """The values, or what is wrong with them, which every format asks for again."""
        try:
            if self.text.lstrip().startswith("<"):
                values = _xml(self.text, self.name)
            elif self.lines and _TOML.match(self.lines[0]):
                # tomllib takes a minute and 9 GB for 100 kB of one dotted key.
                if len(self.text) > KINDS["spec"].largest:
                    expected = f"at most {KINDS['spec'].size} of TOML in {self.name}"
                    raise InputError(expected, "a larger file", "check the path")
                values = parsed_toml(self.text, self.name)
            else:
                values = _yaml(self.text, self.name)
        except InputError as error:
            return error
        return Fields(self.name, values if isinstance(values, dict) else {}, size=self.size)


@dataclass(frozen=True)
class Fields:
    """A mapping at a place in a file; a missing or unfit value raises InputError with file and key.

    A key is found by any of the names given, ignoring case, underscores, hyphens and dots; keys that mean the same must
    have the same value. Of a key with dots, such as camera.fx, the last names count too. The places of values that are
    read are kept in `used`, which inner mappings share; `names` are those by which some keys are found.
    """

    file: str
    values: Mapping[str, Any]
    path: str = ""
    used: set[str] = field(default_factory=set, compare=False, repr=False)
    size: tuple[int, int] | None = None
    names: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)

    def place(self, key: str = "") -> str:
        """Return key and file, for messages."""
        where = ".".join(part for part in (self.path, key) if part)
        return f"{where} in {self.file}" if where else self.file

    def find(self, *names: str) -> str | None:
        """Return the key, as written in the file, for the first of these names that is present."""
        return next(iter(self._all(names)), None)

    def _all(self, names: Sequence[str]) -> list[str]:
        places = [name for name in names if name in self.values and ("." in name or name in self.names)]
        keys = (key for name in dict.fromkeys(map(plain, names)) for key in self._keys.get(name, []))
        return list(dict.fromkeys([*places, *keys]))

    def key(self, *names: str) -> str:
        """Return the key like `find`, but require it, and mark it as used; refuse others for it with another value."""
        keys = self._all(names)
        if not keys:
            raise InputError(f"the key {' or '.join(names[:2])} in {self.place()}", "none", "add it, or check the path")
        for key in keys[1:]:
            if _bare(self.values[key]) != _bare(self.values[keys[0]]):
                expected = f"one value at {self.place(keys[0])}"
                raise InputError(expected, f"another at {brief(key)}", "remove the wrong one")
        self.used.update(self.path_of(key) for key in keys)
        return keys[0]

    def unused(self) -> Iterator[tuple[str, Any]]:
        """Yield places and values that were not read, of inner mappings only where something of them was read."""
        inner = {name[:i] for name in self.used for i, mark in enumerate(name) if mark == "."}
        for key, value in self.values.items():
            path = self.path_of(key)
            tables = dict(tables_in(value)) if path in inner else {}
            for name, table in tables.items():
                place = f"{path}.{name}" if name else path
                if place in inner:
                    yield from Fields(self.file, table, place, self.used).unused()
            if not tables and path not in self.used:
                yield path, value

    def path_of(self, key: str) -> str:
        """Return the place of a key in the file, for `used`."""
        return f"{self.path}.{key}" if self.path else key

    def number(self, *names: str) -> float:
        """Return a finite number."""
        return self._number(key := self.key(*names), self.values[key])

    def whole(self, *names: str) -> int:
        """Return a whole number."""
        key, value = self.key(*names), self.number(*names)
        if not value.is_integer():
            raise InputError(f"a whole number at {self.place(key)}", brief(value), "correct the file")
        return int(value)

    def numbers(self, *names: str) -> list[float]:
        """Return finite numbers from a list, a list of rows, or text separated by blanks, commas or, in 640x480, x."""
        key = self.key(*names)
        items = self.values[key]
        if isinstance(items, str):
            items = re.sub(r"(?<=\d)\s*[x\u00d7]\s*(?=\d)", " ", items).replace(",", " ").split()
        if isinstance(items, list) and items and all(isinstance(row, list) for row in items):
            items = [item for row in items for item in row]
        if not isinstance(items, list):
            raise InputError(f"a list of numbers at {self.place(key)}", brief(items), "correct the file")
        return [self._number(key, item) for item in items]

    def words(self, *names: str) -> list[str]:
        """Return words from a list, or from text separated by blanks."""
        items = self.values[key := self.key(*names)]
        items = items.split() if isinstance(items, str) else items
        if not isinstance(items, list) or not items or not all(isinstance(item, str) for item in items):
            raise InputError(f"a list of names at {self.place(key)}", brief(items), "correct the file")
        return items

    def fields(self, *names: str) -> "Fields":
        """Return the mapping under a key."""
        key = self.key(*names)
        value = self.values[key]
        if not isinstance(value, dict):
            raise InputError(f"keys and values at {self.place(key)}", brief(value), "correct the file")
        return Fields(self.file, value, self.path_of(key), self.used, self.size)

    @cached_property
    def _keys(self) -> dict[str, list[str]]:
        keys: dict[str, list[str]] = {}
        for key in self.values:
            for name in endings_of(self.names.get(key, key)):
                keys.setdefault(name, []).append(key)
        return keys

    def _number(self, key: str, value: object) -> float:
        try:
            number = float(value) if isinstance(value, (str, int, float)) and not isinstance(value, bool) else None
        except (ValueError, OverflowError):
            number = None
        # YAML writes .nan and .inf, which `float` does not parse.
        if number is None or not isfinite(number):
            raise InputError(f"a finite number at {self.place(key)}", brief(value), "correct the file")
        return number


def opencv_matrix(name: str, values: Sequence[Sequence[float]], kind: str) -> str:
    """Write a matrix of type `kind`, OpenCV's ``d``, ``f`` or ``i``, as YAML of FileStorage."""
    size = f"   rows: {len(values)}\n   cols: {len(values[0])}\n   dt: {kind}\n"
    lines = [", ".join(map(repr, row)) for row in values]
    between = ",\n       " if len(values[0]) > 1 else ", "
    return f"{name}: !!opencv-matrix\n{size}   data: [ {between.join(lines)} ]\n"


def tables_in(value: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the tables of a value, with their number in a list, or the name before each; "" for a single one."""
    if isinstance(value, dict):
        yield "", value
    for index, item in enumerate(value if isinstance(value, list) else []):
        if isinstance(item, dict):
            yield str(index), item
        elif isinstance(item, list) and len(item) == 2 and isinstance(item[1], dict):
            yield str(item[0]), item[1]


def endings_of(place: str) -> list[str]:
    """Return the names by which a place such as camera.distortion.model is found: its last one, two and three words."""
    words = [_UNIT.sub("", word) for word in place.split(".")[-3:]]
    names = [plain("".join(words[i:])) for i in range(len(words)) if len("".join(words[i:])) <= _LONGEST_KEY]
    return list(dict.fromkeys(names))


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values with tables for keys with dots, such as Camera.fx."""
    result: dict[str, Any] = {}
    for key, value in values.items():
        table, mark, name = key.partition(".")
        inner = result.setdefault(table, {}) if mark and name and not isinstance(value, dict) else None
        if isinstance(inner, dict):
            inner[name] = value
        else:
            result[key] = value
    return result


def _bare(value: Any) -> Any:
    """Return a value such that equal ones are equal: its numbers without their layout, or its text."""
    if isinstance(value, dict):
        return _bare(value["data"]) if "data" in value else {key: _bare(item) for key, item in value.items()}
    if isinstance(value, list):
        items = [_bare(item) for item in value]
        return [part for item in items for part in (item if isinstance(item, list) else [item])]
    text = str(value).strip()
    try:
        return float(text) if " " not in text else [float(word) for word in text.split()]
    except ValueError:
        return text.lower()


def _damaged(syntax: str, name: str, problem: str) -> InputError:
    return InputError(f"complete {syntax} in {name}", problem, "the file is cut off or damaged: write it again")


def _yaml(text: str, name: str) -> Any:
    """Parse the first document of YAML (JSON is a subset); scalars are text, tags are ignored."""
    import yaml

    # Built from events: no recursion, no constructors, and no expansion of aliases and merges.
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    stack: list[tuple[Any, list[str]]] = [([], [])]
    anchors: dict[str, Any] = {}
    ended = False
    try:
        for event in yaml.parse(_OPENCV_HEADER.sub("", text, count=1), Loader=loader):
            if ended:  # What follows the last mark is an empty scalar.
                if isinstance(event, (yaml.CollectionStartEvent, yaml.AliasEvent)) or getattr(event, "value", None):
                    remark(f"not used of {name}: all documents but the first")
                    break
                continue
            if isinstance(event, yaml.DocumentEndEvent):
                ended = True
            elif isinstance(event, yaml.CollectionEndEvent):
                stack.pop()
            if not isinstance(event, yaml.NodeEvent):
                continue
            if isinstance(event, yaml.AliasEvent):
                if event.anchor not in anchors:
                    raise _damaged("YAML or JSON", name, f"line {event.start_mark.line + 1}: an alias of nothing")
                value: Any = anchors[event.anchor]
            else:
                value = event.value if isinstance(event, yaml.ScalarEvent) else []
                value = {} if isinstance(event, yaml.MappingStartEvent) else value
            problem: str | None = _put(value, *stack[-1])
            if not isinstance(event, yaml.AliasEvent):
                if event.anchor:
                    anchors[event.anchor] = value
                if not isinstance(event, yaml.ScalarEvent):
                    stack.append((value, []))
            if len(stack) > DEEPEST:
                problem = "endless nesting"
            if problem:
                raise _damaged("YAML or JSON", name, f"line {event.start_mark.line + 1}: {problem}")
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or "characters that are not text"
        raise _damaged("YAML or JSON", name, where + problem) from None
    return stack[0][0][0] if stack[0][0] else None


def _put(value: Any, container: Any, key: list[str]) -> str:
    """Add a value to a list, or, key first, to a mapping; return a description of the error, if any."""
    if isinstance(container, list):
        container.append(value)
    elif key:
        container[key.pop()] = value
    elif not isinstance(value, str):
        return "a key that is not text"
    elif value in container:
        return "a key twice"
    else:
        key.append(value)
    return ""


def _xml(text: str, name: str) -> dict[str, Any]:
    """Text of the elements below the root, or of their children; deeper levels of OpenCV's files do not matter."""
    from xml.etree import ElementTree

    # Entities need a document type, which no calibration has; nested entities grow exponentially.
    if re.search("<!(?!--)", text):
        raise InputError(f"plain XML in {name}", "a document type or CDATA", "remove it")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise _damaged("XML", name, reason_of(error)) from None
    values: dict[str, Any] = {}
    if root.tag != "opencv_storage":
        return values
    for element in root:
        if element.tag in values:
            raise _damaged("XML", name, f"the key {brief(element.tag)} twice")
        tags = [child.tag for child in element]
        if len(set(tags)) < len(tags) and set(tags) != {"_"}:  # Underscores stand for the items of a list.
            raise _damaged("XML", name, f"a key twice in {brief(element.tag)}")
        values[element.tag] = {child.tag: child.text or "" for child in element} or (element.text or "").strip()
    return values
