"""Saving of markers and families of markers to files, each in the format of its suffix, all files or none."""
# tests: tests/exporters/test_save.py tests/exporters/test_family.py

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from markergen.drawing.sheet_layout import check_paper
from markergen.errors import InputError, OutputError
from markergen.exporters import (
    EXPORTERS,
    RECORD,
    Exporter,
    ExportOptions,
    Output,
    exporter_of,
    stem_of,
    suffix_of,
)
from markergen.files import Written, check_folder, folders_for, write_all
from markergen.files import check_outputs as check_files
from markergen.model.body import Body
from markergen.model.marker import LIGHT_DOTS, Marker, check_supported
from markergen.units import format_length

if TYPE_CHECKING:
    from markergen.model.spec import Spec


def save(
    bodies: Body | Sequence[Body],
    paths: Sequence[Path],
    options: ExportOptions | None = None,
    inputs: Sequence[Path] = (),
) -> list[Written]:
    """Write one or more markers, or a rig, to each path, in the format of its suffix: all files or none.

    Parameters
    ----------
    bodies : Marker, Rig, or sequence of Marker
    options : ExportOptions, optional
    inputs : sequence of Path
        Files that must not be overwritten, not even by accompanying files.

    Returns
    -------
    list of Written
        Paths and notes in the given order, followed by accompanying files.

    Raises
    ------
    InputError
        If a suffix is unknown (the message lists the known ones), a path is given twice, or a format rejects the
        markers; nothing is written.
    OutputError
        If a file cannot be written, or two have the same name; every target is unchanged.
    """
    return write(outputs_of(bodies, paths, options), inputs)


def outputs_of(
    bodies: Body | Sequence[Body], paths: Sequence[Path], options: ExportOptions | None = None
) -> dict[Path, Output]:
    """Make the outputs of `save`, by path; raises as `save` does."""
    choices = options or ExportOptions()
    bodies = (bodies,) if isinstance(bodies, Body) else bodies
    frame = frame_of(bodies)
    check_exports(paths, choices, frame=frame)
    choices = choices.beside([path.name for path in paths if suffix_of(path, frame) == RECORD][:1])
    exporters = {path: exporter_of(suffix_of(path, frame), frame) for path in paths}
    for path, exporter in exporters.items():
        suffix = suffix_of(path, frame)
        for plate in (plate for body in bodies for plate in body.plates if suffix != RECORD):
            check_supported(plate.marker, f"for {suffix}", light=holds_light(exporter))
    return {path: exporter(bodies, replace(choices, stem=stem_of(path, frame))) for path, exporter in exporters.items()}


def frame_of(bodies: Sequence[Body]) -> str:
    """Return ``rig`` for the only rig, and ``marker`` for markers.

    Raises
    ------
    InputError
        If there is a rig among several bodies.
    """
    frames = {body.frame for body in bodies}
    if "rig" in frames and len(bodies) > 1:
        raise InputError("markers, or one rig", f"{len(bodies)} files, a rig among them", "export each rig by itself")
    return frames.pop() if frames else "marker"


def write(outputs: Mapping[Path, Output], inputs: Sequence[Path] = ()) -> list[Written]:
    """Write outputs and their accompanying files, all or none; see `save`."""
    files = {path: output.data for path, output in outputs.items()}
    beside = _beside(outputs)
    check_files(list(outputs), inputs)
    notes = {path: (*output.notes, *_of_others(path, output)) for path, output in outputs.items()}
    with folders_for(beside):
        check_files(list(beside), inputs)
        write_all({**files, **beside})
    return [Written(path, notes[path]) for path in outputs] + [Written(path) for path in beside]


def _of_others(path: Path, output: Output) -> list[str]:
    """Notes about accompanying files of another model in the same folder, which are replaced."""
    targets = [path.parent / name for name in output.beside if stem_of(path) not in name]
    return [
        f"{target} was that of another model, and is now that of {path.name}: give each model a folder of its own."
        for target in targets
        if target.is_file() and path.name.encode() not in target.read_bytes()
    ]


def _beside(outputs: Mapping[Path, Output]) -> dict[Path, bytes]:
    """Accompanying files of outputs, by path, except those that are outputs themselves.

    Raises
    ------
    OutputError
        If two outputs bring different files of the same name, or one conflicts with a requested output.
    """
    asked = {path.resolve(): output.data for path, output in outputs.items()}
    companions: dict[Path, tuple[Path, bytes]] = {}
    for path, output in outputs.items():
        for name, data in output.beside.items():
            target = path.parent / name
            _, earlier = companions.setdefault(target.resolve(), (target, asked.get(target.resolve(), data)))
            if earlier != data:
                raise OutputError(
                    f"expected to write {target}, which comes with {path}, found another output of that name; "
                    "nothing was changed, choose another path for one of them"
                )
    return {target: data for real, (target, data) in companions.items() if real not in asked}


def with_record(paths: Sequence[Path], frame: str = "marker") -> list[Path]:
    """Add the JSON that always accompanies a design, named after the first path, if it is missing."""
    first = paths[0]
    if not first.name:
        return list(paths)
    record = first.with_name(first.name.removesuffix(_ending(first, frame)) + RECORD)
    return list(paths) if record.resolve() in {path.resolve() for path in paths} else [*paths, record]


def _ending(path: Path, frame: str) -> str:
    """Suffix as written, known or not."""
    try:
        return path.name[-len(suffix_of(path, frame)) :]
    except InputError:
        return path.suffix


def check_exports(
    paths: Sequence[Path],
    options: ExportOptions,
    spec: "Spec | None" = None,
    frame: str = "marker",
    count: int = 1,
) -> None:
    """Reject invalid outputs before any work is done; raises as `save` does.

    With a spec, also reject formats that cannot represent its marker or that need a missing library, and paper that is
    too small for a number of such markers.
    """
    seen: set[Path] = set()
    for path in paths:
        exporter = exporter_of(suffix_of(path, frame), frame)
        if path.resolve() in seen:
            raise InputError("each output path once", f"{path} twice", "give each a different name")
        seen.add(path.resolve())
        check_folder(path)
        if spec and exporter.holds != "points" and spec.dot == 0:
            remedy = "write it to marker.json, or leave out --dot 0"
            raise InputError("dots for a drawing or a solid", f"bare points for {path}", remedy)
        if spec and exporter.holds == "flat" and spec.relief:
            remedy = "write it to marker.json or as a solid such as .step, or leave out --relief"
            raise InputError("dots in one plane", f"a relief of {format_length(spec.relief)} for {path}", remedy)
        if spec and options.sheet.colors.inverted and not holds_light(exporter):
            raise InputError(f"dark dots for {path}", "--colors inverted", f"{LIGHT_DOTS}; leave one of both out")
        if spec and exporter.kernel:
            from markergen.occt import import_kernel

            import_kernel()  # Fail now, not after minutes of optimization.
        exporter.refuse(options)
        if exporter.sheet and spec is not None:
            # A format of one page cannot hold tiles.
            sized = spec.dot in (None, "auto") and not (spec.tag or spec.keep_outs or spec.points or spec.target)
            check_paper(spec.boundary, options.sheet, exporter.many_pages, count, sized)


def holds_light(exporter: Exporter) -> bool:
    """True if a format can hold light dots: as a sheet, as points, or as the marker itself."""
    return exporter.sheet or exporter.holds == "points"


def family_paths(paths: Sequence[Path], ids: Sequence[int]) -> list[Path]:
    """Paths written by `save_family` for these paths: for ``stem.json`` a ``stem-<id>.json`` for each id, and so on."""
    return [target for path in paths for target in ([path] if _is_sheet(path) else [_own(path, k) for k in ids])]


def save_family(
    markers: Sequence[Marker], paths: Sequence[Path], options: ExportOptions, inputs: Sequence[Path] = ()
) -> list[Written]:
    """Write markers that differ by the ids of their tags: sheets for all together, all other files one by one.

    Returns paths and notes, and raises, as `save` does: all files are written or none.
    """
    ids = [marker.tag.id for marker in markers if marker.tag]
    if len(ids) < len(markers):
        raise InputError("markers with tags", "one without", "design them with --tag")
    sheets = [path for path in paths if _is_sheet(path)]
    records = [_own(path, number).name for path in paths if suffix_of(path) == RECORD for number in ids][: len(ids)]
    made = outputs_of(markers, sheets, options.beside(records)) if sheets else {}
    for marker, number in zip(markers, ids, strict=True):
        made |= outputs_of(marker, [_own(path, number) for path in paths if not _is_sheet(path)], options)
    return write(made, inputs)


def _is_sheet(path: Path) -> bool:
    return EXPORTERS[suffix_of(path)].sheet


def _own(path: Path, number: int) -> Path:
    suffix = path.name[-len(suffix_of(path)) :]
    return path.with_name(f"{path.name.removesuffix(suffix)}-{number}{suffix}")
