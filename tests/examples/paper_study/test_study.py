import csv
import io
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from html_pages import check
from markergen_paper import estimated_seconds, run_paper
from markergen_paper import study as paper_study
from markergen_paper.claims import CLAIMS
from markergen_paper.options import COORDINATES, NOISE_PX, NUMBERS, OBJECTIVE_OF, PaperOptions
from markergen_paper.report import rows_csv, tables_of
from markergen_paper.study import cells_of, seconds_of

from markergen.errors import InputError
from markergen.studies.engines import ENGINES, engine_for


@pytest.fixture(scope="module", params=[pytest.param("written", marks=pytest.mark.long)])
def written(tmp_path_factory, tiny, fake):
    """The folder of a study of made-up results, and what was told of its progress."""
    folder = tmp_path_factory.mktemp("paper") / "out"
    output = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper_study, "work", fake)
        paths = run_paper(folder, tiny, ENGINES["serial"](), progress=lambda *told_now: output.append(told_now))
    return folder, paths, output


def test_the_time_is_told_first(written, tiny):
    _, _, output = written
    assert output[0][0] == 0
    assert output[0][2] == estimated_seconds(tiny)
    assert output[-1][0] == output[-1][1]


def test_runs_of_the_papers_own_number_take_longer():
    assert estimated_seconds(PaperOptions(runs=1000)) > 20 * estimated_seconds(PaperOptions())
    assert estimated_seconds(PaperOptions(), workers=1) == 2 * estimated_seconds(PaperOptions(), workers=2)


def test_everything_is_written_and_told(written):
    folder, paths, _ = written
    assert paths[0].name == "index.html"
    assert {path.name for path in folder.iterdir()} == {path.name for path in paths} | {"cells", "study.json"}


def test_figures_are_svg_and_on_the_page(written):
    folder, paths, _ = written
    files = {path.name for path in paths}
    page = check((folder / "index.html").read_bytes(), files)
    figures = {path.name for path in paths if path.suffix == ".svg"}
    assert len(figures) == 14
    for name in figures:
        ET.parse(folder / name)
    assert len(page.of("svg")) == len(figures)
    assert {a["href"] for a in page.of("a")} & files == {name for name in files if name.endswith(".csv")}


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
    assert page.count("<details>") == len(CLAIMS)


def test_the_same_results_give_the_same_tables(written, study):
    """Whether they come from files of cells or not."""
    folder, paths, _ = written
    tables = {f"{name}.csv": rows_csv(rows) for name, rows in tables_of(study).items()}
    assert {path.name for path in paths if path.suffix == ".csv"} == {*tables, "claims.csv"}
    for name, data in tables.items():
        assert (folder / name).read_bytes() == data


@pytest.mark.long
def test_the_same_options_give_the_same_files(written, tmp_path, tiny, fake, monkeypatch):
    folder = written[0]
    monkeypatch.setattr(paper_study, "work", fake)
    # Two figures do for all: each is drawn by the same function.
    every = paper_study.figures_of
    monkeypatch.setattr(paper_study, "figures_of", lambda study: dict(list(every(study).items())[:2]))
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
    assert rows_csv([{"a": np.pi, "b": np.nan, "c": 3, "d": "x", "e": np.inf}]) == b"a,b,c,d,e\n3.14159265,,3,x,inf\n"


@pytest.mark.long
def test_one_and_two_workers_give_the_same_files(tmp_path):
    options = PaperOptions(runs=2, scale=1e-4)
    one = run_paper(tmp_path / "1", options, engine_for(1))
    run_paper(tmp_path / "2", options, engine_for(2))
    for path in one:
        assert path.read_bytes() == (tmp_path / "2" / path.name).read_bytes()


def compared(options, everything):
    """Cells of the comparison, and poses by n."""
    cells = [c for c in cells_of(options) if c.kind == "conditioned" and c.settings["noise_px"] == NOISE_PX]
    return [c for c in cells if (len(c.settings["optimized"]) == len(OBJECTIVE_OF)) == everything]


def test_small_studies_have_few_cells_of_several_views():
    small, whole = (PaperOptions(scale=scale) for scale in (0.01, 1.0))
    # Instead of one for each view, number of points and noise.
    assert len(cells_of(small)) < len(cells_of(whole)) / 5
    for cell in cells_of(whole):
        if cell.kind in ("conditioned", "methods"):
            assert len({pose // 20 for pose in cell.settings["poses"]}) == 1


@pytest.mark.parametrize("scale", [1e-4, 0.01, 1.0])
def test_every_pose_is_compared_once_for_every_n(scale):
    options = PaperOptions(scale=scale)
    cells = cells_of(options)
    assert len(set(cells)) == len(cells)
    for everything, poses in ((False, options.poses), (True, options.fewer_poses)):
        for n in NUMBERS:
            ours = [c.settings["poses"] for c in compared(options, everything) if c.settings["n"] == n]
            assert [pose for block in ours for pose in block] == poses


def test_the_full_study_is_the_one_of_the_paper_and_fits_into_half_an_hour_of_two_cores():
    full = [c for c in compared(PaperOptions(), False) if c.settings["n"] == 6]
    assert {c.settings["starts"] for c in full} == {100}
    assert all(c.settings["optimized"] == {COORDINATES[0]: 100} for c in full)
    cells = cells_of(PaperOptions())
    assert sum(map(seconds_of, cells)) < 2 * 1800
    # Short cells lose little when they are interrupted, and keep all cores busy until the end.
    assert max(map(seconds_of, cells)) < 60


def test_the_cost_is_linear_in_poses_starts_n_and_runs():
    def cost(options):
        return sum(map(seconds_of, compared(options, False)))

    whole = cost(PaperOptions())
    # Half the starts are descended from in a batch half as large, whose steps cost a little more than half.
    assert cost(PaperOptions(scale=0.25)) == pytest.approx(whole / 4, rel=0.1)
    # Descents cost the same, whatever is done with the layouts afterwards.
    ten = cost(PaperOptions(runs=30)) - whole
    assert cost(PaperOptions(runs=1000)) == pytest.approx(whole + 98 * ten, rel=0.01)
    # The paper's own number of runs is cut into small cells, too, as far as one pose goes.
    assert max(map(seconds_of, compared(PaperOptions(runs=1000), False))) < 90


def test_the_seed_changes_every_cell():
    assert not set(cells_of(PaperOptions(scale=0.01))) & set(cells_of(PaperOptions(scale=0.01, seed=1)))
