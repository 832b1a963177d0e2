"""Tables of named things (objectives, estimators, exporters): a new entry is a new file, here or in another package.

An entry comes from one of three places:

- a module of the table's own package, which registers it when it is imported;
- an entry point of another distribution, with the name and the object of the entry;
- a user's own script, which calls `Registry.register`. Such entries travel to worker processes (`outside`, `receive`).

`door` does the same for a single method: it calls a function of a higher layer, imported by name at the call.
"""

import importlib
import logging
import pickle
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from traceback import format_exception
from typing import TYPE_CHECKING, Any, Generic, TypeVar, get_args, get_origin

from markergen.errors import InputError, among, enumerated

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")
Luggage = Mapping[str, Sequence[tuple[str, bytes]]]
"""Names and pickled entries by the entry-point group of their table."""

LOG = logging.getLogger("markergen")

_TABLES: dict[str, "Registry[Any]"] = {}
"""Tables that other packages may extend, by entry-point group."""

_RECEIVED: dict[str, Sequence[tuple[str, bytes]]] = {}
"""Entries received with the work that this process is doing."""


class Registry(Generic[T]):
    """Entries by name; nothing is imported before the first look-up.

    Looking up one of markergen's own entries never reads the entry points. A plug-in that does not work (it cannot be
    imported, is of the wrong type, or has a name that is taken) is left out: a warning is logged under ``markergen``,
    and looking up its name raises an error that says why. No plug-in replaces one of markergen's own entries.

    Parameters
    ----------
    kind : str
        Name of an entry in messages ("objective").
    packages : str
        Dotted names of the packages (or single modules) that hold the entries, separated by blanks; imported at the
        first look-up.
    entry_points : str
        Group of the entry points that add entries; empty for a closed table.
    entry : type
        Class that entries are instances of, or ``type[C]`` if they are subclasses of C.

    Examples
    --------
    >>> from markergen.objectives import OBJECTIVES
    >>> "pose" in OBJECTIVES
    True
    """

    def __init__(self, kind: str, packages: str, entry_points: str = "", entry: Any = object) -> None:
        self.kind, self._packages, self._group, self._entry = kind, packages.split(), entry_points, entry
        self._entries: dict[str, T] = {}
        self._outside: dict[str, str] = {}
        """Modules outside markergen that registered an entry, by its name."""
        self._broken: dict[str, str] = {}
        """Errors of plug-ins by their names."""
        self._luggage: Sequence[tuple[str, bytes]] = ()
        self._received: set[str] = set()
        """Names received from another process."""
        self._loaded = self._listed = False
        self.__module__ = _caller()
        if entry_points:
            _TABLES[entry_points] = self

    def register(self, *names: str) -> Callable[[T], T]:
        """Decorate an entry to add it under each name; a name that is taken is a programming error.

        Entries of user scripts and modules are also known to worker processes, provided that they can be pickled:
        define them at top level. A notebook cell may be run again.
        """
        module = _caller()
        mine = module.partition(".")[0] != "markergen"
        if mine:
            # So that a taken name is refused here, and not when the table's own module is imported.
            self._load()

        def add(entry: T) -> T:
            for name in names:
                again = module == "__main__" == self._outside.get(name)
                if name in self._entries and not again:
                    raise ValueError(f"{self.kind} {name!r} is registered twice")
                if mine and (wrong := self._wrong(name, entry)):
                    raise ValueError(f"{self.kind} {name!r} {wrong}")
                self._entries[name] = entry
                if mine:
                    self._outside[name] = module
            return entry

        return add

    def take(self, name: str, entry: T) -> None:
        """Add an entry that a caller made, or replace the one of before.

        Raises
        ------
        InputError
            If markergen has one of that name, or the entry is of another type.
        """
        taken = name in self and name not in self._outside
        if wrong := "has the name of one of markergen's" if taken else self._wrong(name, entry):
            raise InputError(f"an entry of its own name for the {self.kind} {name!r}", wrong, "rename or correct it")
        self._entries[name] = entry
        self._outside[name] = getattr(entry, "__module__", "")

    def names(self) -> list[str]:
        """Return all names, sorted, without those of plug-ins that do not work."""
        self._load()
        if not self._listed:
            self._listed = True
            for name in self._installed():
                self._plug_in(name)
            self._complain()
        return sorted(self._entries)

    def items(self) -> list[tuple[str, T]]:
        """Return names and entries in the order of registration."""
        self.names()
        return list(self._entries.items())

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        self._load()
        return name in self._entries or name in self._broken or name in self._installed()

    def __getitem__(self, name: str) -> T:
        """Return the entry with that name.

        Raises
        ------
        InputError
            If there is none, with the known names and the nearest one in the message; or if it belongs to a plug-in
            that does not work, with the reason.
        """
        if name in self:
            self._plug_in(name)
            if name in self._entries:
                return self._entries[name]
            raise InputError(f"a working {self.kind} {name!r}", self._broken[name], "fix or uninstall the plug-in")
        raise InputError(f"a known {self.kind}", repr(name), among(name, self.names()))

    def __reduce__(self) -> str:
        # Pickled by reference: entries that use a table must not take all of it along.
        return next((name for name, value in vars(sys.modules[self.__module__]).items() if value is self), self.kind)

    def _load(self) -> None:
        if not self._loaded:
            for name in self._packages:
                package = importlib.import_module(name)
                for module in pkgutil.iter_modules(getattr(package, "__path__", [])):
                    importlib.import_module(f"{name}.{module.name}")
            self._loaded = True
        luggage = _RECEIVED.get(self._group, ())
        if luggage is not self._luggage:
            self._luggage = luggage
            self._unpack(luggage)

    def _installed(self) -> "Mapping[str, Sequence[EntryPoint]]":
        return _installed(self._group) if self._group else {}

    def _plug_in(self, name: str) -> None:
        """Load the entry point of that name, if there is one that has not been loaded."""
        points = self._installed().get(name, ())
        if not points or name in self._entries or name in self._broken:
            return
        wrong = f"it in {' and in '.join(map(_words, points))}" if len(points) > 1 else ""
        if not wrong:
            try:
                entry = points[0].load()
                wrong = self._wrong(name, entry)
            # Other packages' code may raise anything.
            except Exception as error:
                wrong = f"fails with {type(error).__name__}: {error}"
            wrong = wrong and f"{_words(points[0])} {wrong}"
        if wrong:
            self._broken[name] = " ".join(wrong.split())
        elif name not in self._entries:
            # Importing it may have registered it as well.
            self._entries[name] = entry
            self._outside[name] = ""

    def _complain(self) -> None:
        """Log a warning for each plug-in left out."""
        for name, points in self._installed().items():
            reason = self._broken.get(name)
            if name in self._entries and name not in self._outside:
                reason = f"{_words(points[0])}, but markergen has one of that name"
            if reason:
                LOG.warning("left out a plug-in, the %s %r: %s", self.kind, name, reason)

    def _wrong(self, name: str, entry: object) -> str:
        """Return the reason why an object cannot be an entry; empty if it can."""
        if get_origin(self._entry) is type:
            (base,) = get_args(self._entry)
            fits, wanted = isinstance(entry, type) and issubclass(entry, base), f"a subclass of {base.__name__}"
        else:
            fits = isinstance(entry, self._entry)
            kinds = get_args(self._entry) or (self._entry,)
            wanted = f"an instance of {' or '.join(kind.__name__ for kind in kinds)}"
        if not fits:
            return f"is {type(entry).__name__} {getattr(entry, '__name__', '')}".rstrip() + f", and not {wanted}"
        stated = getattr(entry, "name", name)
        return "" if stated == name else f"calls itself {stated!r}"

    def _pack(self) -> list[tuple[str, bytes]]:
        """Pack entries registered outside markergen, except those that any process finds by entry points."""
        packed = []
        for name, module in self._outside.items():
            if module:
                try:
                    packed.append((name, _pickler()(self._entries[name])))
                except Exception:  # An entry that cannot be pickled is reported missing when it is looked up.
                    LOG.debug("the %s %r stays in this process", self.kind, name, exc_info=True)
        return packed

    def _unpack(self, luggage: Sequence[tuple[str, bytes]]) -> None:
        # Workers of a cluster outlive a script: neither old versions of its entries nor another script's may stay.
        for name in self._received:
            self._entries.pop(name, None)
            self._broken.pop(name, None)
        self._received = set()
        for name, data in luggage:
            if name in self._entries:  # The script itself was imported here, too.
                continue
            try:
                entry = pickle.loads(data)
            except Exception as error:
                self._broken[name] = f"it in no module that a worker process can import ({error})"
                self._received.add(name)
                continue
            # Importing its module may have registered it.
            if name not in self._entries:
                self._entries[name] = entry
                self._received.add(name)


def door(room: str) -> Callable[..., Any]:
    """Return a late-bound function of a higher layer, for a method such as `Marker.save` of a class in a lower one.

    A class is loaded, saved and drawn through its own methods, although readers and writers depend on the class. These
    few methods import their function by name when they are called; the layer test lists them all.

    Parameters
    ----------
    room : str
        Module and function, without the package's name: ``read.cameras.load_camera``.
    """
    module, _, name = room.rpartition(".")
    function: Callable[..., Any] = getattr(importlib.import_module(f"markergen.{module}"), name)
    return function


def outside() -> Luggage:
    """Pack entries registered outside markergen, for worker processes to `receive`."""
    return {group: packed for group, table in _TABLES.items() if (packed := table._pack())}


def receive(luggage: Luggage) -> None:
    """Take entries packed by `outside` in the process that hands out work, replacing those of earlier work.

    They are unpacked when their table is next used.
    """
    _RECEIVED.clear()
    _RECEIVED.update(luggage)


def unforeseen(error: BaseException, remedy: str) -> str:
    """Return the sentence about an error that nothing expects: the plug-in it was raised in, its author, and a remedy.

    >>> unforeseen(ZeroDivisionError("division by zero"), "report it")
    'this should not happen: ZeroDivisionError: division by zero; report it'
    """
    entry, source = plug_in_of(error)
    subject, author = (f"{entry} failed", f" to the author of {source}") if entry else ("this should not happen", "")
    return f"{subject}: {type(error).__name__}: {error}; {remedy}{author}"


def plug_in_of(error: BaseException) -> tuple[str, str]:
    """Return which entry of another package an error was raised in, and its object and package; empty if in none.

    Entries whose code is in the same file are told apart by nothing, and all of them are returned.
    """
    # Includes the traceback of a worker process, which its error has as a note.
    text = "".join(format_exception(error))
    plug_ins: dict[int, list[tuple[str, str]]] = {}
    for table in _TABLES.values():
        for name in table._outside:
            for point in table._installed().get(name, ()):
                place = max(text.rfind(f'File "{file}"') for file in _files(point, table._entries[name]))
                if place >= 0 and not (point.dist and point.dist.name == "markergen"):
                    plug_ins.setdefault(place, []).append((f"the {table.kind} {name!r}", _words(point)))
    if not plug_ins:
        return "", ""
    entries, sources = zip(*plug_ins[max(plug_ins)], strict=True)
    return enumerated(entries), enumerated(sources)


def _files(point: "EntryPoint", entry: object) -> set[str]:
    """Files of the entry point's package that have the parts of its entry."""
    values = (entry, type(entry), *getattr(entry, "__dict__", {}).values())
    modules = {point.module, *(str(getattr(value, "__module__", "")) for value in values)}
    package = point.module.partition(".")[0]
    return {
        str(getattr(sys.modules.get(module), "__file__", ""))
        for module in modules
        if module.partition(".")[0] == package
    }


def _caller() -> str:
    """Return the name of the module that called the caller."""
    return str(sys._getframe(2).f_globals.get("__name__", ""))


def _pickler() -> Callable[[object], bytes]:
    try:
        # Comes with Dask, whose workers do not import the script that they work for.
        import cloudpickle
    except ImportError:
        return pickle.dumps
    return cloudpickle.dumps


@cache
def _installed(group: str) -> "dict[str, list[EntryPoint]]":
    """Return the entry points of installed distributions in a group, by name; read once."""
    from importlib.metadata import entry_points

    points: dict[str, list[EntryPoint]] = {}
    for point in sorted(entry_points(group=group), key=lambda point: (point.name, point.value)):
        points.setdefault(point.name, []).append(point)
    return points


def _words(point: "EntryPoint") -> str:
    """Return ``pkg.module:object of the package dist``."""
    return f"{point.value}{f' of the package {point.dist.name}' if point.dist else ''}"
