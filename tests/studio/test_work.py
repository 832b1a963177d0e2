"""Searches that are told as they go, and that end when nobody listens."""

import asyncio
import json
import os
import threading
import time
from itertools import count

import pytest

import markergen as mg
from markergen.optimize.certificate import Certificate
from markergen.optimize.design import Design
from markergen.studio.server import Latest, Teller, settled_options, streamed

from .conftest import TOKEN

QUICK = {"n": 4, "radius": "100mm", "restarts": 1, "poses": "cone:count=3", "seed": 3}


def test_the_search_is_told_and_ends_in_a_state(studio, monkeypatch):
    # Bounds take longer than such a search.
    monkeypatch.setattr(Design, "certify", lambda self, progress=None: Certificate(4, 1.0, 0.25))
    bare = {**QUICK, "dot": 0.0}
    answer = studio.post("optimize", {"options": {**bare, "points": [[0, 0]], "title": None}})
    assert answer.headers["content-type"] == "application/x-ndjson"
    *output, last = answer.lines
    assert {"polish", "regular"} <= {line["stage"] for line in output}
    printed = [line for line in output if "dots" in line]
    assert printed
    assert all(len(line["dots"]) == 4 for line in printed)
    values = [line["value"] for line in printed]
    assert values == sorted(values, reverse=True)
    design = mg.design(**bare)
    assert values[-1] >= design.value * (1 - 1e-9)
    kept = {name: value for name, value in QUICK.items() if name != "n"}
    assert last["options"] == {**kept, "points": design.marker.xyz[:, :2].tolist(), "dot": "0mm"}
    assert last["summary"] == design.summary
    assert last["certificate"] == {"sentence": Certificate(4, 1.0, 0.25).sentence, "gap": 0.75}


LONG = [
    {},
    {"dot": "auto"},
    {"relief": "10mm"},
    {"radius": "fit", "paper": "A5"},
    {"radius": None, "boundary": "rect:200mmx150mm"},
    {"n": "auto", "poses": "cone:count=12,distance=0.9..1m"},
    {"n": None, "target": "0.5deg@0.7m"},
]


@pytest.mark.parametrize("more", [{"dot": "0mm"}, *(pytest.param(each, marks=pytest.mark.long) for each in LONG)])
def test_the_state_after_a_search_gives_the_same_dots(more):
    options = {name: value for name, value in {**QUICK, **more}.items() if value is not None}
    design = mg.design(**options)
    again = mg.design(**json.loads(json.dumps(settled_options(options, design))))
    assert again.marker.control_points == design.marker.control_points
    assert again.marker.boundary == design.marker.boundary
    assert again.value == pytest.approx(design.value, rel=1e-9)


def test_what_the_search_refuses_is_its_last_line(studio):
    assert studio.post("optimize", {"options": {"n": 3}}).lines[-1]["error"]["found"] == "n=3"
    assert "shape of a rig" in studio.post("rig", {"shape": "plates.csv", "options": {}}).lines[-1]["error"]["line"]
    assert "--camera" in studio.post("rig", {"shape": "cube", "options": {"camera": "x"}}).lines[-1]["error"]["line"]


@pytest.mark.long
def test_dots_of_several_sizes_come_as_a_marker_and_can_be_shown(studio):
    pad = {"n": "auto", "radius": "400mm", "poses": "cone:distance=0.5..10m,tilt=0..30,count=40"}
    last = studio.post("optimize", {"options": pad}).lines[-1]
    assert last["options"] is None
    marker = {"marker": last["marker"]}
    assert len({point["feature"]["diameter"] for point in last["marker"]["control_points"]}) > 1
    assert studio.post("view", {**marker, "pose": 3}).status == 200
    assert studio.post("scene", marker).json["poses"]["distance"][0] >= 0.5
    assert studio.post("export", {**marker, "suffix": ".json"}).json == last["marker"]
    assert studio.post("open", json.dumps(last["marker"]).encode(), X_Name="pad.json").json["options"] is None


@pytest.mark.long
def test_a_rig_is_designed_from_texts(studio):
    options = {"n": "4", "plate": "100mm", "restarts": "1", "poses": "cone:distance=0.3..0.8m,tilt=0..60,count=30"}
    last = studio.post("rig", {"shape": "pair", "options": {**options, "tag": "aruco:DICT_4X4_50"}}).lines[-1]
    assert [item["name"] for item in last["rig"]["markers"]] == ["left", "right"]
    assert studio.post("view", {"rig": last["rig"], "pose": 3}).status == 200


def test_a_listener_who_leaves_ends_the_work(studio, monkeypatch):
    """As a page does that is closed, or whose "stop" was pressed."""
    ended = threading.Event()

    def endless(options, tell):
        try:
            for number in count():
                tell.progress("search", number, -1)
                time.sleep(0.01)
        finally:
            ended.set()

    monkeypatch.setattr("markergen.studio.server.optimize", endless)
    with studio.connect("POST", f"/{TOKEN}/optimize", b'{"options": {}}') as response:
        assert json.loads(response.readline())["stage"] == "search"
        assert not ended.is_set()
    assert ended.wait(10)


def test_a_real_search_can_be_stopped():
    """It ends without a result, long before n = 60 would have one."""
    ended, finished = threading.Event(), []

    async def first_lines():
        def job(tell):
            try:
                finished.append(mg.design(n=60, progress=tell.progress, watch=tell.watch))
            finally:
                ended.set()
            return {}

        lines = streamed(job)
        first = [json.loads(await anext(lines)) for _ in range(2)]
        await lines.aclose()
        return first

    assert [line["stage"] for line in asyncio.run(first_lines())] == ["regular"] * 2
    assert ended.wait(60)
    assert not finished


@pytest.mark.long
def test_the_newest_question_is_answered_by_a_process_that_is_kept():
    """As the page asks for more while another layout is still being worked on."""
    latest, refused = Latest(wait_for), threading.Event()

    def ask_first():
        with pytest.raises(mg.InputError, match="the newest request"):
            latest(600)
        refused.set()

    first = threading.Thread(target=ask_first)
    first.start()
    while latest._served is None:
        time.sleep(0.01)
    number = latest(0)
    assert refused.wait(10)
    first.join()
    assert latest(0) == number != os.getpid()
    with pytest.raises(ValueError, match="negative"):
        latest(-1)
    assert latest(0) == number
    latest.end()


@pytest.mark.long
def test_a_page_waits_for_another_and_ends_its_own_questions_alone():
    latest, answers = Latest(wait_for), []
    other = threading.Thread(target=lambda: answers.append(latest(1.0, "other")))
    other.start()
    while latest._served is None:
        time.sleep(0.01)

    def ask_in_vain():
        with pytest.raises(mg.InputError, match="the newest request"):
            latest(600, "mine")
        answers.append("older")

    older = threading.Thread(target=ask_in_vain)
    older.start()
    while "mine" not in latest._newest:
        time.sleep(0.01)
    answers.append(latest(0, "mine"))
    older.join()
    other.join()
    # The older one of this page never began; the other page's was answered by the same process.
    assert answers == ["older", answers[1], answers[1]]
    latest.end()


def test_pages_that_are_gone_and_the_end_of_the_server_leave_nothing_to_do():
    latest, ended = Latest(wait_for), []

    def ask(page):
        with pytest.raises(mg.InputError, match="the newest request"):
            latest(600, page)
        ended.append(page)

    calls = [threading.Thread(target=ask, args=(page,)) for page in ("first", "second")]
    for call, page in zip(calls, ("first", "second"), strict=True):
        call.start()
        while latest._served is None or page not in latest._newest:
            time.sleep(0.01)
    latest.give_up("first", object())
    assert latest._served == "first"
    latest.give_up("first")
    calls[0].join(60)
    assert ended == ["first"]
    while latest._served is None:
        time.sleep(0.01)
    assert latest._served == "second"
    latest.end()
    calls[1].join(60)
    assert ended == ["first", "second"]


def wait_for(seconds):
    time.sleep(seconds)
    return os.getpid()


def test_lines_are_few_and_the_last_of_a_stage_is_always_among_them():
    output = []
    teller = Teller(output.append, threading.Event())
    for done in range(1001):
        teller.progress("search", done, 1000)
    teller.progress("polish", 0, 1)
    assert len(output) < 100
    assert [(line["stage"], line["done"]) for line in output][-2:] == [("search", 1000), ("polish", 0)]
    assert output[0]["done"] == 0
