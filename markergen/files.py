"""Files are replaced atomically: whatever fails, the target is either as it was or complete."""

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from markergen.errors import InputError, OutputError


class Written(NamedTuple):
    """A file that was written, and sentences about it for whoever opens, prints or makes it."""

    path: Path
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return "\n  ".join([f"wrote {self.path}", *self.notes])


_IN_CHECKOUT = {"templates": "templates", "schemas": "docs"}
"""Folders of a checkout by their name in the wheel."""


def shipped_folder(name: str) -> Path:
    """Folder of files that come with markergen, ``templates`` or ``schemas``, from a wheel or from a checkout."""
    package = Path(__file__).parent
    folder = package / name
    return folder if folder.is_dir() else package.parent / _IN_CHECKOUT[name]


def schemas() -> dict[str, Path]:
    """Published JSON Schemas of markergen's files, by name.

    Examples
    --------
    >>> schemas()["marker-v1"].name
    'marker-v1.schema.json'
    """
    ending = ".schema.json"
    return {path.name.removesuffix(ending): path for path in sorted(shipped_folder("schemas").glob(f"*{ending}"))}


def exists(path: Path) -> bool:
    """Tell whether there is something at a path, also one that is no path or that may not be looked at."""
    try:
        return path.exists()
    except (OSError, ValueError):  # A name that is too long, a folder that is closed, a null character.
        return False


def write_atomic(path: Path, data: bytes) -> None:
    """Write `data` to a temporary file beside `path` and rename it over `path`.

    A link is followed, and what is no regular file, such as a pipe or a terminal, is written to as it is.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, or the disk is full; `path` is unchanged.
    """
    write_all({path: data})


def write_all(files: Mapping[Path, bytes]) -> None:
    """Write several files so that all are replaced or none (see `write_atomic`)."""
    staged: dict[Path, Path] = {}
    replaced: dict[Path, bytes | None] = {}
    target = Path()
    try:
        for target, data in files.items():
            if _is_special(target):
                target.write_bytes(data)
            else:
                staged[target] = _stage(target.resolve(), data)
        for target, temporary in staged.items():
            before = target.read_bytes() if target.exists() else None
            temporary.replace(target.resolve())
            replaced[target] = before
    except OSError as error:
        for done, before in replaced.items():
            _restore(done.resolve(), before)
        reason = error.strerror or str(error)
        raise _cannot_write(target, reason) from error
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def check_folder(path: Path) -> None:
    """Refuse a path that cannot be written, before any work is done for it; raises as `write_atomic` does."""
    folder = path.resolve().parent
    reason = ""
    if not folder.is_dir():
        reason = "No such file or directory" if not folder.exists() else "Not a directory"
    elif path.is_dir():
        reason = "Is a directory"
    elif not _is_special(path):
        try:
            # What the permissions say is not what some file systems do.
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            reason = error.strerror or str(error)
    if reason and not _is_special(path):
        raise _cannot_write(path, reason)


def check_outputs(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Refuse outputs that cannot be written, of which two are the same file, or of which one is also an input.

    An input such as ``plate.dxf#HOLES`` is a part of a file, unless there is a file of just that name.

    Raises
    ------
    OutputError
    """
    read = {_whole(path).resolve() for path in inputs}
    written = set[Path]()
    for path in outputs:
        check_folder(path)
        if _is_special(path):
            continue
        if path.resolve() in read:
            raise _cannot_write(path, "It is one of the inputs")
        if path.resolve() in written:
            raise _cannot_write(path, "It was asked for twice")
        written.add(path.resolve())


def _whole(path: Path) -> Path:
    before, _, _ = str(path).rpartition("#")
    return Path(before) if before and not exists(path) else path


def check_some(paths: Sequence[object]) -> None:
    """Refuse to write nothing, as a forgotten path would have it; raises InputError."""
    if not paths:
        raise InputError("a path to write to", "none", "give one or more")


def sorted_by_suffix(paths: Sequence[Path], kinds: Mapping[str, str]) -> list[tuple[str, Path]]:
    """Pair each path with what a file of its suffix holds.

    Raises
    ------
    InputError
        If `kinds` has no such suffix.
    """
    for path in paths:
        if path.suffix.lower() not in kinds:
            known = ", ".join(kinds)
            raise InputError(f"a file that ends in {known}", str(path), "choose such a name")
    return [(kinds[path.suffix.lower()], path) for path in paths]


def make_folder(path: Path) -> None:
    """Make a folder for outputs, and those that it lies in, unless it is there; raises as `check_folder` does."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(path, "Not a directory" if path.exists() else error.strerror or str(error)) from error
    check_folder(path / "any")


@contextmanager
def folders_for(paths: Iterable[Path]) -> Iterator[None]:
    """Make the folders that files are to lie in; if what is done with them fails, those that were made go again."""
    made: list[Path] = []
    try:
        for path in paths:
            folder = path.parent
            made += [each for each in (folder, *folder.parents) if not exists(each)]
            make_folder(folder)
        yield
    except BaseException:
        for folder in sorted(made, key=lambda each: -len(each.parts)):
            with suppress(OSError):  # Somebody else may have put something there.
                folder.rmdir()
        raise


def _cannot_write(path: Path, reason: str) -> OutputError:
    return OutputError(f"expected to write {path}, found: {reason}; nothing was changed, choose another path")


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()


def _stage(target: Path, data: bytes) -> Path:
    if target.is_dir():
        raise IsADirectoryError(21, "Is a directory", str(target))
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files private; an output has the mode any new file would have, or keeps its own.
        temporary.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def _restore(target: Path, before: bytes | None) -> None:
    if before is None:
        target.unlink(missing_ok=True)
    else:
        _stage(target, before).replace(target)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
