import csv
import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.studies.engines import ENGINES, engine_for
from markergen.studies.paper import estimated_seconds, run_paper
from markergen.studies.paper import run as paper_run
from markergen.studies.paper.claims import CLAIMS
from markergen.studies.paper.options import PaperOptions
from markergen.studies.paper.tables import csv_bytes, tables_of


@pytest.fixture(scope="module")
def written(tmp_path_factory, tiny, fake):
    """The folder of a study of made-up results, and what was told of its progress."""
    folder = tmp_path_factory.mktemp("paper") / "out"
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_run, "work", fake)
        paths = run_paper(folder, tiny, ENGINES["serial"](), progress=lambda *told_now: told.append(told_now))
    return folder, paths, told


def test_the_time_is_told_first(written, tiny):
    _, _, told = written
    assert told[0][0] == 0
    assert told[0][2] == estimated_seconds(tiny)
    assert told[-1][0] == told[-1][1]


def test_runs_of_the_papers_own_number_take_longer():
    assert estimated_seconds(PaperOptions(runs=1000)) > 25 * estimated_seconds(PaperOptions())
    assert estimated_seconds(PaperOptions(), workers=1) == 2 * estimated_seconds(PaperOptions(), workers=2)


def test_everything_is_written_and_told(written):
    folder, paths, _ = written
    assert paths[0].name == "index.html"
    assert {path.name for path in folder.iterdir()} == {path.name for path in paths} | {"cells", "study.json"}


def test_figures_are_svg_and_on_the_page(written):
    folder, paths, _ = written
    page = (folder / "index.html").read_text()
    figures = {path.name for path in paths if path.suffix == ".svg"}
    assert len(figures) == 14
    for name in figures:
        ET.parse(folder / name)
    assert set(re.findall(r'src="([^"]+)"', page)) == figures
    links = set(re.findall(r'href="([^"]+)"', page))
    assert links == {path.name for path in paths if path.suffix == ".csv"}


def test_tables_are_tidy(written):
    for path in written[1]:
        if path.suffix == ".csv":
            rows = list(csv.reader(io.StringIO(path.read_text())))
            assert len(rows) > 1
            assert {len(row) for row in rows} == {len(rows[0])}
            assert "nan" not in path.read_text()


def test_claims_are_in_all_three_places(written):
    folder, _, _ = written
    text, page = (folder / "claims.md").read_text(), (folder / "index.html").read_text()
    with (folder / "claims.csv").open() as file:
        names = {row["claim"] for row in csv.DictReader(file)}
    assert names == {claim.name for claim in CLAIMS}
    for claim in CLAIMS:
        assert f"## {claim.words}" in text
    assert page.count("<h3>") == len(CLAIMS)


def test_the_same_results_give_the_same_tables(written, study):
    """Whether they come from files of cells or not."""
    folder, paths, _ = written
    tables = {f"{name}.csv": csv_bytes(rows) for name, rows in tables_of(study).items()}
    assert {path.name for path in paths if path.suffix == ".csv"} == {*tables, "claims.csv"}
    for name, data in tables.items():
        assert (folder / name).read_bytes() == data


@pytest.mark.long
def test_the_same_options_give_the_same_files(written, tmp_path, tiny, fake, monkeypatch):
    folder = written[0]
    monkeypatch.setattr(paper_run, "work", fake)
    # Two figures do for all: each is drawn by the same function.
    every = paper_run.figures_of
    monkeypatch.setattr(paper_run, "figures_of", lambda study: dict(list(every(study).items())[:2]))
    for path in run_paper(tmp_path / "again", tiny, ENGINES["serial"]()):
        if path.suffix == ".html":
            continue
        assert path.read_bytes() == (folder / path.name).read_bytes()


def test_another_study_is_refused(written, tiny):
    folder, _, _ = written
    with pytest.raises(InputError, match="runs 2 there, 3 here"):
        run_paper(folder, PaperOptions(runs=3, scale=tiny.scale), ENGINES["serial"](), resume=True)
    with pytest.raises(InputError, match="--resume"):
        run_paper(folder, tiny, ENGINES["serial"]())


def test_numbers_in_tables_have_nine_digits_and_gaps_are_empty():
    assert csv_bytes([{"a": np.pi, "b": np.nan, "c": 3, "d": "x"}]) == b"a,b,c,d\n3.14159265,,3,x\n"


@pytest.mark.long
def test_one_and_two_workers_give_the_same_files(tmp_path):
    options = PaperOptions(runs=2, scale=1e-4)
    one = run_paper(tmp_path / "1", options, engine_for(1))
    run_paper(tmp_path / "2", options, engine_for(2))
    for path in one:
        assert path.read_bytes() == (tmp_path / "2" / path.name).read_bytes()
