"""What holds for every engine that needs nobody else."""

import multiprocessing

import pytest
from study_work import cells, dying, noise

from markergen.errors import InputError, MarkergenError
from markergen.studies.engines import ENGINES, engine_for
from markergen.studies.run import run_cells


def test_the_address_of_a_scheduler_chooses_the_engine():
    assert type(engine_for(2)) is ENGINES["processes"]
    assert type(engine_for(2, "tcp://127.0.0.1:1")) is ENGINES["dask"]


@pytest.mark.parametrize("workers", [0, -1, 1000])
def test_a_number_of_workers_that_cannot_be_is_refused(workers):
    with pytest.raises(InputError, match="workers"):
        engine_for(workers).check()


def test_closing_early_ends_the_processes(tmp_path):
    run = ENGINES["processes"](workers=2).run(noise, cells(20))
    cell, result = next(run)
    assert cell in cells(20)
    assert set(result) == {"values", "product", "index"}
    run.close()
    assert multiprocessing.active_children() == []


def test_a_process_that_ends_early_is_told_in_a_line(tmp_path):
    with pytest.raises(MarkergenError, match="ended early"):
        run_cells(dying, cells(3), tmp_path, {}, engine_for(2))
