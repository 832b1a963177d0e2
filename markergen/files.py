"""Atomic file replacement: after a failure, each target is either unchanged or complete."""

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from markergen.errors import InputError, OutputError


class Written(NamedTuple):
    """A file that was written, with notes for whoever opens, prints or makes it."""

    path: Path
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return "\n  ".join([f"wrote {self.path}", *self.notes])

    @property
    def brief(self) -> str:
        """The file and its two most important notes, on one line."""
        return f"wrote {self.path}{': ' * bool(self.notes)}{' '.join(self.notes[:2])}"


_IN_CHECKOUT = {"templates": "templates", "schemas": "docs", "examples": "examples"}
"""Folders of a checkout by their name in the wheel."""


def shipped_folder(name: str) -> Path:
    """Return a folder of files shipped with markergen, such as ``templates``, from a wheel or a checkout."""
    package = Path(__file__).parent
    folder = package / name
    return folder if folder.is_dir() else package.parent / _IN_CHECKOUT[name]


def schemas() -> dict[str, Path]:
    """Return the published JSON Schemas of markergen's files by name.

    Examples
    --------
    >>> schemas()["marker-v1"].name
    'marker-v1.schema.json'
    """
    ending = ".schema.json"
    return {path.name.removesuffix(ending): path for path in sorted(shipped_folder("schemas").glob(f"*{ending}"))}


def exists(path: Path) -> bool:
    """Return whether something exists at a path; False for an invalid or inaccessible path."""
    try:
        return path.exists()
    except (OSError, ValueError):  # The name is too long, the folder is not accessible, or there is a null character.
        return False


def write_atomic(path: Path, data: bytes) -> None:
    """Write `data` to a temporary file beside `path` and rename it over `path`.

    Symbolic links are followed; special files such as pipes and terminals are written to directly.

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
            if before is None:
                done.resolve().unlink(missing_ok=True)
            else:
                _stage(done.resolve(), before).replace(done.resolve())
        reason = error.strerror or str(error)
        raise _cannot_write(target, reason) from error
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def check_folder(path: Path) -> None:
    """Refuse a path that cannot be written before any work is done for it; raises as `write_atomic` does."""
    folder = path.resolve().parent
    reason = ""
    if not folder.is_dir():
        reason = "Not a directory" if folder.exists() else "No such file or directory"
    elif path.is_dir():
        reason = "Is a directory"
    elif not _is_special(path):
        try:
            # On some file systems the permission bits do not show it.
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            reason = error.strerror or str(error)
    if reason and not _is_special(path):
        raise _cannot_write(path, reason)


def check_outputs(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Refuse outputs that cannot be written, name the same file twice, or are also inputs.

    An input such as ``plate.dxf#HOLES`` is part of a file, unless a file of exactly that name exists.

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


def sorted_by_suffix(paths: Sequence[Path], kinds: Mapping[str, str]) -> list[tuple[str, Path]]:
    """Pair each path with the kind of file that its suffix stands for.

    Raises
    ------
    InputError
        If `kinds` lacks a suffix.
    """
    for path in paths:
        if path.suffix.lower() not in kinds:
            suffixes = ", ".join(kinds)
            raise InputError(f"a file that ends in {suffixes}", str(path), "choose such a name")
    return [(kinds[path.suffix.lower()], path) for path in paths]


def make_folder(path: Path) -> None:
    """Make a folder for outputs, with its parents, unless it exists; raises as `check_folder` does."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(path, "Not a directory" if path.exists() else error.strerror or str(error)) from error
    check_folder(path / "any")


@contextmanager
def folders_for(paths: Iterable[Path]) -> Iterator[None]:
    """Make the folders that files will be written to; if the body fails, remove those that were made."""
    missing: list[Path] = []
    try:
        for path in paths:
            folder = path.parent
            missing += [parent for parent in (folder, *folder.parents) if not exists(parent)]
            make_folder(folder)
        yield
    except BaseException:
        for folder in sorted(missing, key=lambda path: -len(path.parts)):
            with suppress(OSError):  # Another process may have put something there.
                folder.rmdir()
        raise


def _cannot_write(path: Path, reason: str) -> OutputError:
    remedy = "choose another path"
    if not exists(path.parent):
        reason, remedy = f"the folder {path.parent} does not exist", "make it, or choose another path"
    return OutputError(f"expected to write {path}, found: {reason}; nothing was changed, {remedy}")


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
        _open_up(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def temporary_beside(path: Path) -> Path:
    """Make an empty file with the same suffix beside `path`, for a program that writes it; see `put_in_place`."""
    target = path.resolve()
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise _cannot_write(path, error.strerror or str(error)) from error
    os.close(handle)
    return Path(name)


def put_in_place(temporary: Path, path: Path) -> None:
    """Rename a finished temporary file over `path`; raises as `write_atomic` does."""
    try:
        _open_up(temporary, path.resolve())
        temporary.replace(path.resolve())
    except OSError as error:
        raise _cannot_write(path, error.strerror or str(error)) from error


def _open_up(temporary: Path, target: Path) -> None:
    # mkstemp makes files private; an output gets the default mode of a new file, or keeps its own.
    temporary.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
