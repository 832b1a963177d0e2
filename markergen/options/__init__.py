"""All options, declared once: name, type, unit, default, help and group of every option.

The command line's options and its help, the keys of a spec file and their JSON Schema, and the keyword arguments of
`markergen.design`, `export`, `validate` and the others are all made of the tables here; a new option is a new line.
Each table is a ``TypedDict``, so that type checkers know the keywords, too.
"""

from markergen.options.base import Option, declared, signature_of
from markergen.options.making import OUTSIDE_FILES, DesignKeywords, ExportKeywords, PlateKeywords
from markergen.options.proving import (
    CompareKeywords,
    DetectKeywords,
    RescaleKeywords,
    StudyKeywords,
    ValidateKeywords,
    VerifyKeywords,
)
from markergen.options.reading import as_list, check_progress, given, read_as, settle

__all__ = [
    "OUTSIDE_FILES",
    "CompareKeywords",
    "DesignKeywords",
    "DetectKeywords",
    "ExportKeywords",
    "Option",
    "PlateKeywords",
    "RescaleKeywords",
    "StudyKeywords",
    "ValidateKeywords",
    "VerifyKeywords",
    "as_list",
    "check_progress",
    "declared",
    "given",
    "read_as",
    "settle",
    "signature_of",
]
