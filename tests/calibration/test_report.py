"""The report of a calibration has the numbers of the object, and leaves out what is not there."""

import html as markup
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from html_pages import Page, check
from matplotlib.collections import EllipseCollection
from matplotlib.quiver import Quiver
from sentences import sentence

from benchmarks.calibration_sets import CAMERA
from markergen.calibration.adjustment import Adjustment
from markergen.calibration.calibration import Known
from markergen.calibration.coverage import view_angles
from markergen.calibration.judging import CrossValidation, Halves, NotJudged
from markergen.calibration.network import Length
from markergen.calibration.report import (
    Quantities,
    calibration_page,
    draw_directions,
    draw_print_map,
    enlargement,
    round_factor,
)
from markergen.calibration.sentences import (
    closing_sentence,
    errors,
    summary,
    unused,
    verdict,
    what_is_left,
)
from markergen.files import Written
from markergen.maths.rotation import exponential
from markergen.presentation.tables import number


def verdict_sentence(calibration):
    """The headline."""
    return verdict(calibration)[0]


SECTIONS = ("answer", "print", "judged", "camera", "photos", "coverage", "next", "method")


@pytest.fixture(scope="module")
def made(both):
    return calibration_page(both)


def test_is_one_whole_page_that_loads_nothing_and_says_in_words_what_it_shows(both, made):
    result, asked = check(made), both.next_photos
    assert not result.scripts
    assert len(made) < 2_000_000
    assert len(result.of("svg")) == 8 + len(asked.photos) * asked.helps


def test_foreign_text_stays_text(made):
    assert b"<script" not in made
    assert b"&lt;script&gt;alert(1)" in made


def test_is_written_with_the_calibration_the_same_each_time(both, made, tmp_path):
    both.save(report=tmp_path / "calibration.html")
    assert (tmp_path / "calibration.html").read_bytes() == made


def test_has_a_section_for_everything_that_was_found(made, two_markers, nominal):
    assert Page(made).sections == SECTIONS
    unjudged = NotJudged("too few photographs")
    exact = Page(calibration_page(replace(two_markers, cross_validation=unjudged)))
    assert exact.sections == tuple(item for item in SECTIONS if item != "camera")
    assert not [title for title in exact.titles if title.startswith(("Left-out", "Two halves", "Rejected"))]
    held = Page(calibration_page(nominal))
    assert held.sections == tuple(item for item in SECTIONS if item != "next")
    assert len(held.table("Dots")[0]) == 4
    assert not [a for tag, a in held.elements if tag == "svg" and a["aria-label"].startswith("Map")]


def test_verdict_is_first_and_is_that_of_the_object(both, made):
    text = markup.unescape(made.decode())
    assert text.index(verdict_sentence(both)) < text.index(both.scale_source) < text.index("<table")
    assert errors(both.after) in verdict_sentence(both)
    assert errors(both.before) in verdict_sentence(both)
    rows = Page(made).table("Expected pose error")
    assert rows[1][2:] == [
        number(both.after.rotation_deg),
        *(number(getattr(both.after, name)[0]) for name in ("image", "print", "camera")),
    ]
    assert rows[3][2] == number(1e3 * both.after.translation)


def test_tables_hold_the_numbers_of_the_object(both, made):
    result, output, adjustment = Page(made), both.as_dict(), both.adjustment
    rows = result.table("Dots of the print")
    for row, dot in zip(rows, output["dots"], strict=True):
        assert row[0] == str(dot["id"])
        assert [float(cell) for cell in row[1:4]] == pytest.approx(1e6 * np.array(dot["moved"]), abs=0.051)
        assert [float(cell) for cell in row[4:7]] == pytest.approx(1e6 * np.array(dot["sigma"]), abs=0.051)
        assert row[7:9] == [str(dot["views"]), str(dot["rejected"])]
    rows = result.table("Photographs")
    for row, photo in zip(rows, output["photos"], strict=True):
        assert row[0] == photo["photo"]
        assert row[2:4] == [str(photo["dots"]), str(len(photo["rejected"]))]
        assert float(row[4]) == pytest.approx(photo["rms_px"], abs=6e-4)
    rows = result.table("Camera")
    assert [float(row[1]) for row in rows][:4] == pytest.approx(
        [adjustment.camera.fx, adjustment.camera.fy, adjustment.camera.cx, adjustment.camera.cy], rel=1e-6
    )
    sigma = output["camera"]["sigma"]
    assert [row[2] for row in rows] == [number(sigma[row[0]]) if sigma[row[0]] else "held" for row in rows]


def test_tells_what_was_rejected_and_by_how_much(both, made):
    rows = Page(made).table("Rejected dots")
    assert len(rows) == int(both.dropped.sum()) == 3
    assert {row[1] for row in rows} == {"1"}
    # They are 3.16 px off, which is 100 sigma.
    assert [float(row[2]) for row in rows] == pytest.approx([10**0.5] * 3, abs=0.3)
    assert all(float(row[3]) > 50 for row in rows)
    left = Page(made).table("Photographs not used")
    assert [row[1] for row in left] == ["no marker found"]
    assert len(left[0][0]) == 60


def test_asks_for_the_next_photographs(two_markers):
    asked = two_markers.next_photos
    assert asked.helps
    result, text = Page(calibration_page(two_markers)), markup.unescape(calibration_page(two_markers).decode())
    assert text.count(asked.sentence) == 2
    assert asked.sentence in summary(two_markers)
    assert all(f"expect {number(photo.after.rotation_deg)} deg and" in text for photo in asked.photos)
    pictures = [a["aria-label"] for tag, a in result.elements if tag == "svg" and "to take next" in a["aria-label"]]
    assert pictures == [f"Picture {k + 1} to take next: {photo.request}." for k, photo in enumerate(asked.photos)]


def test_chi2_of_the_photographs_adds_up_to_that_of_the_adjustment(both):
    subject, adjustment = Quantities(both), both.adjustment
    inverse = np.linalg.inv(adjustment.views.covariance)
    ours = inverse @ adjustment.residual_covariance()
    freedom = (np.trace(ours, axis1=2, axis2=3) * subject.taken).sum(axis=1)
    # What is known of a print before, about as designed, has a share of both: a thousandth here.
    assert freedom.sum() == pytest.approx(adjustment.degrees_of_freedom, rel=3e-3)
    assert subject.variance_factors @ freedom == pytest.approx(adjustment.chi2, rel=1e-2)


def test_dots_of_two_markers_are_told_apart(two_markers):
    result = Page(calibration_page(two_markers))
    assert [row[0] for row in result.table("Dots")] == [*(f"1:{k}" for k in range(5)), *(f"2:{k}" for k in range(6))]
    assert len(result.table("Photographs")) == 8
    maps = [a["aria-label"] for tag, a in result.elements if tag == "svg" and "in the print" in a["aria-label"]]
    assert [text[:15] for text in maps] == ["Map of marker 1", "Map of marker 2"]


def test_summary_is_some_ten_lines(both, two_markers, nominal):
    for result in (both, two_markers, nominal):
        assert ". " not in verdict_sentence(result)
        lines = summary(result)
        assert lines[0] == verdict_sentence(result)
        assert result.scale_source in lines
        assert 5 <= len(lines) - len(result.notes) <= 10
        assert all("  " not in line and "nan" not in line for line in lines)


def _with_misfit(result, design, factor):
    """A calibration whose residuals are larger than noise by a factor, with the design's left-out residuals."""
    adjustment = replace(result.adjustment, chi2=factor * result.adjustment.degrees_of_freedom)
    return replace(result, adjustment=adjustment, cross_validation=replace(result.cross_validation, nominal=design))


def test_verdict_says_what_to_do(both, two_markers, nominal):
    cross, halves = both.cross_validation, both.halves
    assert isinstance(cross, CrossValidation)
    assert isinstance(halves, Halves)
    agreeing = replace(both, halves=replace(halves, chance=0.5))
    assert verdict_sentence(agreeing).startswith(sentence("use measured") + ": expect")
    assert verdict_sentence(agreeing).endswith("confirm it.")
    assert "with care" in verdict_sentence(replace(both, halves=replace(halves, chance=1e-4)))
    gain = replace(cross.gain, low=0.9, high=1.2)
    doubtful = replace(agreeing, cross_validation=replace(cross, gain=gain))
    assert verdict_sentence(doubtful).startswith(sentence("not yet") + " not significantly better")
    worse = replace(doubtful, cross_validation=replace(cross, gain=replace(gain, low=0.5, high=0.8)))
    assert verdict_sentence(worse).startswith(sentence("not yet") + " worse")
    unjudged = replace(agreeing, cross_validation=NotJudged("too few"), halves=NotJudged("too few"))
    assert "too few photographs" in verdict_sentence(unjudged)
    assert verdict_sentence(replace(both, after=both.before)).startswith(sentence("use measured") + ": it predicts")
    assert verdict_sentence(replace(doubtful, after=both.before)).startswith("Keep the marker")
    assert verdict_sentence(nominal).startswith("The camera is")
    assert verdict_sentence(replace(nominal, cause="")).endswith("as designed.")
    assert ", or more, since residuals are larger than noise, chi2 15, most" in verdict_sentence(nominal)
    assert verdict_sentence(nominal).startswith("The camera is calibrated, and to be used with care: expect")
    adjustment = both.adjustment
    far = replace(agreeing, after=replace(both.after, translation=1.1 * both.before.translation))
    assert verdict_sentence(far).startswith("Take more photographs")
    ruled = replace(adjustment, network=replace(adjustment.network, lengths=(Length(0, 1, 0.07, 1e-4),)))
    assert verdict_sentence(replace(far, adjustment=ruled)).startswith(sentence("use measured"))
    assert verdict_sentence(replace(far, adjustment=ruled)).endswith("print is known.")
    assert "first marker" not in verdict_sentence(both)
    assert "first marker" in verdict_sentence(two_markers)
    exact = replace(cross.best_nominal, chi2=1.5 * cross.best_nominal.degrees_of_freedom)
    as_designed = replace(agreeing, cross_validation=replace(cross, gain=gain, nominal=exact, refitted=None))
    assert verdict_sentence(as_designed).startswith(sentence("use measured") + " or the design")
    assert as_designed.to_use
    network = replace(adjustment.network, lengths=(Length(0, 1, 0.07, 1e-5),))
    for scale, phrase in (
        (1.004, "it is 0.4 % larger than designed"),
        (0.996, "0.4 % smaller"),
        (1.0, "or the design"),
    ):
        scaled = replace(adjustment, network=network, places=scale * network.design)
        assert phrase in verdict_sentence(replace(as_designed, adjustment=scaled))
        assert replace(as_designed, adjustment=scaled).to_use
    relation = SimpleNamespace(rig=object(), is_as_designed=False, deviation="1 deg off")
    assert "Use the measured rig: its markers are 1 deg off; " in verdict_sentence(
        replace(as_designed, relation=relation)
    )
    noisy = replace(exact, chi2=15 * exact.degrees_of_freedom)
    assert verdict_sentence(_with_misfit(as_designed, noisy, 8.0)).startswith(sentence("use measured") + " or the")
    assert verdict_sentence(_with_misfit(as_designed, noisy, 1.0)).startswith(sentence("not yet"))
    kept = replace(doubtful, after=both.before)
    assert [item.to_use for item in (agreeing, unjudged, nominal, doubtful, worse, far, kept)] == 3 * [True] + 4 * [
        False
    ]
    assert (agreeing.as_dict()["use"], worse.as_dict()["use"]) == (True, False)
    assert worse.as_dict()["verdict"] == verdict_sentence(worse)


def test_files_that_are_not_to_be_used_are_told_last(both):
    cross = both.cross_validation
    doubtful = replace(both, cross_validation=replace(cross, gain=replace(cross.gain, low=0.9)))
    assert closing_sentence(doubtful, printed=False) == sentence("unusable result")
    files = Written(Path("measured.json")), Written(Path("camera.yaml"))
    closing = closing_sentence(replace(doubtful, written=files), printed=False)
    assert closing == sentence("unusable files", "measured.json, camera.yaml")
    assert closing_sentence(both, printed=False) == sentence("nothing written")
    assert closing_sentence(both, printed=True) == closing_sentence(replace(both, written=files), printed=False) == ""


def test_only_the_print_differs_before_and_after(both, nominal):
    """The camera that the photographs determined counts in both, apart from where the dots are."""
    assert both.before.camera == pytest.approx(both.after.camera, rel=0.05)
    assert both.before.print[0] > 3 * both.after.print[0]
    assert nominal.before.camera[0] > 0
    assert errors(nominal.after) == errors(nominal.before)
    assert nominal.after.camera == pytest.approx(nominal.before.camera)


def test_what_is_left_names_the_largest_source_first(both):
    error = replace(both.after, image=(0.01, 0.03), print=(0.03, 0.01), camera=(0.0, 0.0))
    shares = what_is_left(replace(both, after=error))
    assert all(
        part in shares for part in ("print (rotation 90 %, translation 10 %)", "(rotation 10 %, translation 90 %)")
    )
    assert "camera" not in shares
    message = what_is_left(replace(both, after=replace(error, print=(0.04, 0.0))))
    assert message == sentence("variance left", "rotation 6 %, translation 100 %", "rotation 94 %, translation 0 %")


def test_photograph_from_the_right_is_drawn_at_the_right():
    from matplotlib.figure import Figure

    # The camera moves to the marker's right by 40 deg and looks back at it; its upper edge stays up.
    view = exponential(np.array([0.0, np.deg2rad(40.0), 0.0])) @ np.diag([1.0, -1.0, -1.0])
    toward = -view[2]
    assert toward[0] == pytest.approx(np.sin(np.deg2rad(40)))
    ax = draw_directions(view[None], view_angles(view[None])[0], Figure().add_subplot())
    hand, spot = ax.lines[-2:]
    assert np.column_stack(spot.get_data()) == pytest.approx(np.array([[40.0, 0.0]]))
    assert hand.get_ydata()[1] > 1
    assert hand.get_xdata()[1] == pytest.approx(40.0)


def test_photographs_whose_views_were_all_left_out_are_told(both):
    used = both.used.copy()
    used[0] = False
    assert len(unused(replace(both, used=used))) == 2


def test_displacements_are_drawn_as_large_as_there_is_room():
    points, none = np.array([[0.0, 0.0], [20.0, 0.0], [0.0, 20.0], [20.0, 20.0]]), np.zeros((4, 2, 2))
    moved = np.full((4, 2), 0.1 / 2**0.5)
    assert enlargement(points, moved, none, 200.0) == 200
    # A 2-sigma region as large as the displacement takes half of the room.
    assert enlargement(points, moved, none + 0.05**2 * np.eye(2), 200.0) == 100
    # A displacement of nothing has no scale, but a drawing.
    assert np.isfinite(enlargement(points, 0 * moved, none, 200.0))
    assert [round_factor(value) for value in (1, 1.4, 2.9, 99, 0.031)] == [1, 1, 2, 70, 0.03]


def test_map_shows_where_dots_are_and_their_two_sigma_regions(make_ngon):
    from matplotlib.figure import Figure

    marker = make_ngon(5, 0.1, 0.02)
    rng = np.random.default_rng(0)
    points, moved = 1e3 * marker.xyz[:, :2], rng.normal(0, 100, (5, 3))
    root = rng.normal(0, 10, (5, 3, 3))
    covariance = root @ root.swapaxes(-1, -2)
    ax = Figure().add_subplot()
    draw_print_map(marker, [str(k) for k in range(5)], points, moved, covariance, 50.0, ax)
    dots, regions = (collection for collection in ax.collections if isinstance(collection, EllipseCollection))
    assert dots.get_offsets() == pytest.approx(points)
    ends = points + 50e-3 * moved[:, :2]
    assert regions.get_offsets() == pytest.approx(ends)
    for k in range(5):
        angle = np.deg2rad(regions.get_angles()[k])
        tip = regions.get_widths()[k] / 2 * np.array([np.cos(angle), np.sin(angle)]) / 50e-3
        side = regions.get_heights()[k] / 2 * np.array([-np.sin(angle), np.cos(angle)]) / 50e-3
        for edge in (tip, side, (tip + side) / 2**0.5):
            assert edge @ np.linalg.solve(covariance[k, :2, :2], edge) == pytest.approx(4.0)
    arrows = next(collection for collection in ax.collections if isinstance(collection, Quiver))
    assert np.column_stack([arrows.U, arrows.V]) == pytest.approx(ends - points)


def test_numbers_on_the_map_are_clear_of_dots_and_of_each_other(make_ngon):
    """Where dots stand closely, arrows push numbers onto neighbors, and two numbers into one gap."""
    from matplotlib.figure import Figure

    marker = make_ngon(4, 0.1, 0.04)
    points = np.array([[-60.0, 0], [-15.0, 0], [35.0, 0], [-60.0, -45]])
    moved = np.array([[0, 200, 0], [-200.0, 1, 0], [200.0, 1, 0], [0, -200, 0]])
    ax = Figure().add_subplot()
    draw_print_map(marker, list("0123"), points, moved, np.tile(np.eye(3), (4, 1, 1)), 50.0, ax)
    numbers = [text for text in ax.texts if text.get_text() in "0123"]
    sides = np.array([text.xyann for text in numbers]) / 7
    places = points + (20 + 5) * sides
    apart = np.linalg.norm(places[:, None] - np.concatenate([points, places]), axis=-1)
    apart[:, :4] -= 20
    apart[np.arange(4), np.arange(4) + 4] = np.inf
    assert apart.min() > 4.9


@pytest.mark.parametrize(("factor", "doubted"), [(1.2, ""), (5.0, "not quite where"), (20.0, "not where")])
def test_dots_that_are_held_and_do_not_fit_are_named(calibrated, make_ngon, monkeypatch, factor, doubted):
    monkeypatch.setattr(Adjustment, "variance_factor", property(lambda _: factor))
    # With a camera that is nearly known, there is no choice of its parameters, which takes most of the time.
    prior = Known(CAMERA, np.diag([1.0, 1, 1, 1, *[1e-6] * 5]), free=False)
    notes = calibrated([make_ngon(5, 0.11, 0.02)], 4, prior, false=0).notes
    assert any(f"dots are {doubted} they were designed" in note for note in notes) == bool(doubted)
    assert any("where they were designed" in note for note in notes) == bool(doubted)
