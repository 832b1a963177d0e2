"""What is declared is what holds: defaults, names and kinds, everywhere that options go."""

import inspect
from dataclasses import fields

import pytest

from markergen.cli.commands import app
from markergen.detect import Detector
from markergen.detect.batch import detect_files
from markergen.detect.video import detect_video
from markergen.drawing.colors import BLACK_ON_WHITE, parse_colors
from markergen.drawing.paper import SheetOptions
from markergen.model.boundary import Circle
from markergen.model.fabrication import Fabrication
from markergen.model.poses import named_poses
from markergen.model.rescale import RULERS_MM
from markergen.model.spec import Spec
from markergen.model.substrate import Substrate
from markergen.options import GROUPS, declared, settle
from markergen.options.compare import CompareKeywords, StudyKeywords
from markergen.options.declarations import (
    DesignKeywords,
    DetectKeywords,
    DetectorKeywords,
    ExportKeywords,
    RescaleKeywords,
    ValidateKeywords,
    VerifyKeywords,
)
from markergen.options.kinds import KINDS
from markergen.read.spec_file import STORED, spec_from_mapping

TABLES = [
    CompareKeywords, DesignKeywords, DetectKeywords, ExportKeywords, RescaleKeywords, StudyKeywords, ValidateKeywords,
    VerifyKeywords,
]  # fmt: skip
EACH = [pytest.param(table, option, id=f"{table.__name__}-{name}") for table in TABLES
        for name, option in declared(table).items()]  # fmt: skip


@pytest.mark.parametrize(("table", "option"), EACH)
def test_an_option_is_declared_in_full(table, option):
    assert option.group in GROUPS
    assert option.kind in KINDS
    assert option.help.endswith((".", "..."))
    assert option.metavar or option.kind in ("int", "float", "bool")
    # Both only where the command line does otherwise, and the words name the default, too.
    assert not option.otherwise or option.default is None or option.default in option.otherwise
    # A flag of its own name, so that a keyword is the option with underscores.
    assert option.flag == "--" + option.name.replace("_", "-")


@pytest.mark.parametrize("table", TABLES)
def test_groups_stand_together_and_in_order(table):
    places = [GROUPS.index(option.group) for option in declared(table).values()]
    assert places == sorted(places)


def test_a_spec_without_wishes_has_the_defaults_that_are_declared():
    defaults = {
        STORED.get(name, name): option.default
        for name, option in declared(DesignKeywords).items()
        if option.default is not None
    }
    spec = Spec()
    for field in fields(Spec):
        if field.name in defaults:
            value = getattr(spec, field.name)
            assert spec_from_mapping({field.name: defaults[field.name]}) == spec, field.name
            assert type(value) in (int, float, str), field.name
    assert spec_from_mapping({"radius": defaults["radius"]}).boundary == Circle(0.15) == spec.boundary
    assert named_poses(defaults["poses"]).name == spec.poses


def test_a_plate_a_process_and_a_sheet_have_the_defaults_that_are_declared():
    settled = settle({}, ExportKeywords)
    made, plate, sheet = Fabrication(), Substrate(), SheetOptions()
    for thing in (made, plate, sheet):
        for field in fields(thing):
            if settled.get(field.name) is not None and field.name not in ("colors", "edge"):
                assert getattr(thing, field.name) == settled[field.name], field.name
    assert parse_colors(settled["colors"]) == BLACK_ON_WHITE
    assert plate.edge_around(Circle(0.1)) == settled["edge"]
    rulers = declared(RescaleKeywords)
    assert all(str(length) in rulers[f"nominal_{name}"].shown for name in "xy" for length in RULERS_MM)


@pytest.mark.parametrize("table", TABLES)
def test_commands_have_the_options_that_are_declared(table):
    import typer

    command = typer.main.get_command(app).commands[table.__name__.removesuffix("Keywords").lower()]
    flags = {flag for param in command.params for flag in (*param.opts, *param.secondary_opts)}
    assert {option.flag for option in declared(table).values()} <= flags
    repeated = {param.name for param in command.params if getattr(param, "multiple", False)}
    assert {name for name, option in declared(table).items() if KINDS[option.kind].repeatable} <= repeated


@pytest.mark.parametrize("table", TABLES)
def test_functions_show_the_keywords_that_are_declared(table):
    import markergen

    name = table.__name__.removesuffix("Keywords").lower()
    function = detect_files if name == "detect" else getattr(markergen, name)
    parameters = inspect.signature(function).parameters
    assert set(declared(table)) <= set(parameters)
    assert not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values())
    assert "Kind(" not in str(inspect.signature(function))


@pytest.mark.parametrize(
    ("function", "table"),
    [(Detector, DetectorKeywords), (detect_files, DetectKeywords), (detect_video, DetectKeywords)],
)
def test_a_detector_has_the_defaults_that_are_declared(function, table):
    parameters = inspect.signature(function).parameters
    for name, option in declared(table).items():
        assert parameters[name].default == option.default, name
    assert "Kind(" not in str(parameters)
