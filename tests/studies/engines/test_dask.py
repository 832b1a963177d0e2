import socket
import threading
import time
from contextlib import suppress

import pytest
from study_work import cells, noise, refusing, slow_noise

from markergen.errors import InputError, MarkergenError
from markergen.studies.engines import ENGINES, dask, engine_for
from markergen.studies.run import run_cells

IDENTITY = {"study": "test"}


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    run_cells(noise, cells(60), folder, IDENTITY, ENGINES["serial"]())
    return folder


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_gets_the_same_files(cluster, alone, tmp_path):
    """Its workers have two threads of BLAS at their start, and one of them is killed in the middle."""

    def progress(done, total, seconds):
        if done == 15:
            cluster.workers[0].kill()

    engine = engine_for(scheduler=cluster.address)
    engine.check()
    run_cells(slow_noise, cells(60), tmp_path, IDENTITY, engine, progress=progress)
    assert cluster.workers[0].wait() != 0
    assert files(tmp_path) == files(alone)


@pytest.mark.long
def test_a_scheduler_that_is_lost_is_told_and_the_study_goes_on_elsewhere(cluster, alone, tmp_path):
    def progress(done, total, seconds):
        if done == 15:
            cluster.scheduler.kill()

    with pytest.raises(MarkergenError, match=r"finished cells remain.*--resume"):
        run_cells(slow_noise, cells(60), tmp_path, IDENTITY, engine_for(scheduler=cluster.address), progress=progress)
    kept = len(list((tmp_path / "cells").iterdir()))
    assert 15 <= kept < 60
    run_cells(noise, cells(60), tmp_path, IDENTITY, engine_for(1), resume=True)
    assert files(tmp_path) == files(alone)


def test_an_error_of_a_cell_comes_back_as_it_is(cluster, tmp_path):
    with pytest.raises(InputError, match="below 3, found index=3;"):
        run_cells(refusing, cells(6), tmp_path, IDENTITY, engine_for(scheduler=cluster.address))


@pytest.mark.long
def test_a_cluster_without_markergen_is_told_what_it_lacks(strangers, tmp_path):
    with pytest.raises(InputError, match="scheduler and its workers"):
        run_cells(noise, cells(6), tmp_path, IDENTITY, engine_for(scheduler=strangers.address))


def check_seconds(address):
    begin = time.monotonic()
    with pytest.raises(InputError) as caught:
        engine_for(scheduler=address).check()
    return time.monotonic() - begin, str(caught.value)


@pytest.mark.long
def test_a_scheduler_that_does_not_answer_is_told_within_ten_seconds(mute_address):
    pytest.importorskip("distributed")
    seconds, message = check_seconds(mute_address)
    assert seconds < 10
    assert f"scheduler at {mute_address}, found no answer in 5 s;" in message


@pytest.mark.parametrize("phrase", [b"HTTP/1.0 400 Bad Request\r\n\r\n" * 9, b"\xff" * 64], ids=["http", "ones"])
def test_what_answers_and_is_no_scheduler_is_told(phrase):
    """Taken for lengths of frames, these words ask for exbibytes, or for more dimensions than there are."""
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            with suppress(OSError):
                while True:
                    with server.accept()[0] as connection:
                        connection.sendall(phrase)

        threading.Thread(target=answer, daemon=True).start()
        seconds, message = check_seconds(f"tcp://127.0.0.1:{server.getsockname()[1]}")
    assert seconds < 10
    assert "Dask scheduler at tcp://127.0.0.1" in message


@pytest.mark.parametrize(
    "address", ["nonsense", "tcp://", "udp://127.0.0.1:8786", "tcp://127.0.0.1:port", "tls://127.0.0.1:1"]
)
def test_what_is_no_address_is_told_at_once(address, monkeypatch):
    """Nothing is waited for, however slow the machine."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(dask, "ANSWER_SECONDS", 100.0)
    begin = time.process_time()
    seconds, message = check_seconds(address)
    # Work counts apart from waiting: other people's load makes the one longer, but not the other.
    assert time.process_time() - begin < 3
    assert seconds < 50
    assert "tcp://HOST:PORT" in message
