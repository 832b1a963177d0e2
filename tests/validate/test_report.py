"""The report: that it says what the results say, holds all that it shows, and lets nobody's text become its own."""

import base64
import importlib.resources
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from markergen.estimators.budget import ErrorSources, pose_budget
from markergen.maths.information import rotation_bound
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint
from markergen.model.poses import PoseDistribution, paper
from markergen.objectives import Setting
from markergen.render import DEFAULT_OPTICS
from markergen.validate.bounds import image_covariance, pose_bounds
from markergen.validate.metrics import statistics
from markergen.validate.pictures import Picture
from markergen.validate.proof import prove, to_json
from markergen.validate.report import html_report, measured, overview, page, words
from markergen.validate.report.advice import advise, sentences, short_axes
from markergen.validate.report.budget_plot import budget_over_tilt, variance_shares
from markergen.validate.report.comparison_plot import compared
from markergen.validate.report.ellipses_plot import QUANTILE_95, carried_over, ellipse, share_inside
from markergen.validate.report.errors_plot import distribution, draw_errors, errors_over, ranked
from markergen.validate.report.expected import bound, cells, interval, rms
from markergen.validate.report.poses_plot import camera_centers, fan, pose_sphere
from markergen.validate.report.subject import Subject
from markergen.validate.views import Shoot

HOSTILE = '</pre><script>alert("x")</script><img src=x onerror=alert(1)> $\\frac{ \ud800'


@pytest.fixture(scope="module")
def few(setting):
    """Every fifth of the paper's poses: all distances and tilts, four azimuths of each."""
    poses = paper()
    return Setting(
        setting.boundary, setting.camera, PoseDistribution("paper", poses.rotation[::5], poses.translation[::5])
    )


@pytest.fixture(scope="module")
def budget(pentagon, few):
    errors = ErrorSources(1e-4, np.diag([0.5, 0.5, 0.5, 0.5]) ** 2)
    image = image_covariance(pentagon, few.camera, few.poses, DEFAULT_OPTICS)
    return pose_budget(pentagon.xyz, few.poses.rotation, few.poses.translation, few.camera, image, errors)


@pytest.fixture(scope="module")
def results(pentagon, few, budget):
    """Real trials and bounds; views drawn from the covariances, as if the detector were perfect."""
    shoot = Shoot(pentagon, few.camera, few.poses, 0, errors=ErrorSources(1e-4, np.diag([0.5] * 4) ** 2))
    found = prove(pentagon, few, runs=3, shoot=shoot, workers=1)
    found["views"] = synthetic_views(pentagon, few, budget)
    return json.loads(to_json(found))


def synthetic_views(marker, setting, budget):
    poses, rng = setting.poses, np.random.default_rng(1)
    errors = draw_errors(budget.image + budget.print)
    every = np.linalg.cholesky(image_covariance(marker, setting.camera, poses, DEFAULT_OPTICS))
    samples = []
    for k in range(2 * len(poses)):
        pose, error = k // 2, errors[k // 2, k]
        dots = (every[pose] @ rng.standard_normal((len(marker), 2, 1)))[..., 0]
        samples.append(
            {
                "view": k,
                "pose": pose,
                "distance": float(poses.distance[pose]),
                "polar_angle_deg": round(float(poses.polar_angle_deg[pose]), 2),
                "azimuth_deg": 0.0,
                "rotation_deg": float(np.rad2deg(np.linalg.norm(error[:3]))),
                "translation_pct": float(100 * np.linalg.norm(error[3:]) / poses.distance[pose]),
                "rotation_vector_deg": np.rad2deg(error[:3]).tolist(),
                "translation_error_mm": (1e3 * error[3:]).tolist(),
                "nees": 6.0,
                "point_px_rms": float(np.sqrt(np.mean(np.sum(dots**2, axis=-1)))),
                "dots": list(range(len(marker))),
                "error_px": dots.tolist(),
            }
        )

    def summary(chosen):
        return {
            "count": len(chosen),
            "detected": len(chosen),
            "wrong": 0,
            "rate": 1.0,
            "point_px": statistics(np.array([np.hypot(*dot) for each in chosen for dot in each["error_px"]])),
            "uncorrected_px": statistics(np.full(3, 0.2)),
            "image_bound_px": 0.0044,
            "homography_px": statistics(np.full(3, 0.01)),
            "estimators": {
                name: {
                    key: statistics(factor * np.array([each[key] for each in chosen]))
                    for key in ("rotation_deg", "translation_pct")
                }
                for name, factor in (("detect", 1.0), ("sqpnp", 1.2))
            },
            "nees": {
                "count": len(chosen),
                "mean": 6.0,
                "interval": [5.5, 6.5],
                "coverage": 0.95,
                "coverage_interval": [0.9, 0.98],
            },
        }

    def groups(masks):
        return {name: summary([each for each in samples if mask[each["pose"]]]) for name, mask in masks.items()}

    return {
        **summary(samples),
        "optics": dict(vars(DEFAULT_OPTICS)),
        "background": "plain",
        "hidden": 0,
        "refine": "none",
        "print_sigma_mm": 0.1,
        "by_polar_angle": groups(poses.by_polar_angle()),
        "by_distance": groups(poses.by_distance()),
        "samples": samples,
        "failures": [
            {"view": 7, "pose": 79, "distance": 1.5, "polar_angle_deg": 70.0, "azimuth_deg": 0.0, "reason": HOSTILE}
        ],
    }


@pytest.fixture(scope="module")
def pictures():
    """Twelve pictures with the noise of a view, of its size."""
    rng = np.random.default_rng(0)
    noisy = [np.clip(rng.normal(200, 2, (480, 640)), 0, 255).astype(np.uint8) for _ in range(12)]
    return [
        Picture(
            f"view-{k}", HOSTILE if k == 0 else f"View {k}", "What it shows.", bytes(cv2.imencode(".png", image)[1])
        )
        for k, image in enumerate(noisy)
    ]


@pytest.fixture(scope="module")
def hostile(pentagon):
    return replace(
        pentagon,
        provenance={"spec_hash": HOSTILE, "seed": HOSTILE, "versions": {HOSTILE: HOSTILE}, "spec": [HOSTILE]},
    )


@pytest.fixture(scope="module")
def html(results, hostile, few, pictures, budget):
    return html_report(results, hostile, few, pictures, budget)


@pytest.fixture
def subject(results, pentagon, few, budget):
    return Subject(results, pentagon, few, budget)


@pytest.fixture
def ax():
    return new_axes()


def new_axes():
    from matplotlib.figure import Figure

    return Figure().add_subplot()


@pytest.fixture
def quick(monkeypatch):
    """Leave the drawing out: it costs two seconds a page."""

    def drawn(draw, name, alt, caption, size=page.SIZE):
        return page.Plot(f"<svg aria-label='{name}'></svg>", caption)

    for module in (overview, measured):
        monkeypatch.setattr(module, "plot", drawn)


class Page(HTMLParser):
    """Elements of a page, and whether each was closed where it should be."""

    VOID = frozenset({"meta", "img", "br", "link", "hr"})

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.texts = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


# What the page is


def test_is_one_whole_page_that_loads_nothing(html):
    text = html.decode()
    found = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert not found.open
    assert ("html", {"lang": "en"}) in found.elements
    tags = {tag for tag, _ in found.elements}
    assert not tags & {"script", "link", "iframe", "object", "embed", "base", "form"}
    for tag, attributes in found.elements:
        assert not [name for name in attributes if name.startswith("on")]
        for name in ("src", "href", "xlink:href"):
            if name in attributes:
                assert attributes[name].startswith("data:image/" if tag in ("img", "image") else "#")
    assert "@import" not in text
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_ids_are_unique_and_what_is_referred_to_is_there(html):
    elements = Page(html.decode()).elements
    ids = [attributes["id"] for _, attributes in elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    referred = {value[1:] for _, a in elements for key, value in a.items() if key.endswith("href") and value[0] == "#"}
    referred |= {a["aria-labelledby"] for _, a in elements if "aria-labelledby" in a}
    referred |= set(re.findall(r"url\(#([^)]*)\)", html.decode()))
    assert referred <= set(ids)


def test_says_in_words_what_it_shows(html):
    elements = Page(html.decode()).elements
    drawings = [attributes for tag, attributes in elements if tag == "svg"]
    assert len(drawings) >= 20
    assert all(len(each["aria-label"]) > 20 and each["role"] == "img" for each in drawings)
    assert all(attributes["alt"] for tag, attributes in elements if tag == "img")
    assert all(attributes.get("scope") in ("col", "row") for tag, attributes in elements if tag == "th")


def test_is_small_with_a_dozen_pictures(html):
    assert html.count(b"<img") == 12
    assert len(html) < 3_000_000


def test_foreign_text_stays_text(html):
    text = html.decode()
    assert "<script" not in text
    assert "<img src=x" not in text
    # In the table of failures, the facts about the marker, and a picture's title.
    assert text.count("&lt;script&gt;alert(&#34;x&#34;)") >= 4


def test_same_results_give_the_same_page_whatever_the_settings_of_matplotlib(
    html, results, hostile, few, pictures, budget
):
    import matplotlib

    with matplotlib.rc_context({"font.size": 20, "svg.hashsalt": "other", "axes.grid": False, "text.parse_math": True}):
        before = dict(matplotlib.rcParams)
        assert html_report(results, hostile, few, pictures, budget) == html
        assert dict(matplotlib.rcParams) == before


def test_template_is_part_of_the_package():
    assert (importlib.resources.files("markergen.validate.report") / page.SHEET).is_file()


def test_picture_without_noise_stays_as_it_is():
    png = bytes(cv2.imencode(".png", np.full((48, 64), 200, np.uint8))[1])
    assert base64.b64decode(page.data_uri(png).removeprefix("data:image/png;base64,")) == png


def test_noisy_picture_is_kept_as_it_looks(pictures):
    uri = page.data_uri(pictures[1].png)
    kept = cv2.imdecode(np.frombuffer(base64.b64decode(uri.removeprefix("data:image/jpeg;base64,")), np.uint8), 0)
    given = cv2.imdecode(np.frombuffer(pictures[1].png, np.uint8), 0)
    # The noise has a standard deviation of 2; what compression changes is less than that.
    assert np.std(kept.astype(float) - given) < 2
    assert len(uri) < len(pictures[1].png)


# Parts that are not there


@pytest.mark.parametrize("content", [{}, {"views": None, "budget": None, "estimators": {}, "comparisons": None}])
def test_without_results_there_is_still_a_marker_and_what_to_run(content, pentagon, few):
    text = html_report(content, pentagon, few).decode()
    for option in ("--runs 1000", "--views 100", "--print-sigma"):
        assert option in text
    noise = rms(pose_bounds(pentagon.xyz, few.camera, few.poses, 1.0).rotation_deg)
    assert f"{words.number(noise, 2)} deg" in text
    assert "image noise of 1 px alone" in text


PARTS = ("criteria", "comparisons", "nees", "noise_px", "runs", "homography", "estimators", "bound", "budget", "views")


@pytest.mark.parametrize("part", PARTS)
def test_any_part_may_be_missing_or_null(part, results, pentagon, few, quick):
    without = {key: value for key, value in results.items() if key != part}
    page = html_report(without, pentagon, few)
    assert b"What to expect" in page
    assert html_report({**without, part: None}, pentagon, few) == page


def test_views_of_which_none_was_detected(results, pentagon, few, budget, quick):
    nothing = {"count": 0, **dict.fromkeys(["mean", "std", "rms", "median", "p95", "max"])}
    views = {
        **results["views"], "detected": 0, "rate": 0.0, "point_px": nothing, "uncorrected_px": nothing, "samples": [],
        "image_bound_px": None, "homography_px": nothing, "estimators": {}, "by_polar_angle": {}, "by_distance": {},
        "nees": {"count": 0, "mean": None, "interval": None, "coverage": None, "coverage_interval": None},
    }  # fmt: skip
    text = html_report({**results, "views": views}, pentagon, few, budget=budget).decode()
    assert f"0 of {views['count']} rendered views detected" in text


def test_bare_points_have_no_size_to_print(results, make_ngon, few, quick):
    points = make_ngon(5, 0.15, 0.0)
    text = html_report({**results, "views": None}, points, few).decode()
    assert "no size to print" in text


def test_one_pose_is_enough(results, pentagon, few, quick):
    one = replace(few, poses=PoseDistribution("one", few.poses.rotation[[30]], few.poses.translation[[30]]))
    assert "Over all 1 poses" in html_report({**results, "views": None}, pentagon, one).decode()


# What it says


def test_answer_is_the_budget_at_the_far_and_steep_end(subject, budget, few):
    there = (few.poses.distance > 1.49) & (few.poses.polar_angle_deg > 69)
    deg = rms(np.rad2deg(rotation_bound(budget.total))[there])
    mm = rms(1e3 * np.sqrt(np.trace(budget.total[there, 3:, 3:], axis1=1, axis2=2)))
    first = overview.answer(subject).sentences[0]
    assert first == f"At 1.5 m and 70 deg expect {words.number(deg, 2)} deg and {words.number(mm, 2)} mm RMS."


def test_cells_of_the_table_make_up_the_whole(pentagon, few):
    found = bound(pentagon, few, 0.2)
    table = cells(found)
    assert len(table) == 20
    whole = np.average([cell.rotation_deg**2 for cell in table], weights=[cell.poses.sum() for cell in table])
    assert np.sqrt(whole) == pytest.approx(rms(found.rotation_deg))
    reference = pose_bounds(pentagon.xyz, few.camera, few.poses, 0.2)
    np.testing.assert_allclose(found.rotation_deg, reference.rotation_deg)
    np.testing.assert_allclose(found.translation_pct, reference.translation_pct)


@pytest.mark.parametrize(
    ("source", "word"), [("image", "noise of the image"), ("print", "print"), ("camera", "calibration")]
)
def test_what_limits_the_pose_is_the_largest_source(source, word):
    parts = {"image": 0.1, "print": 0.1, "camera": 0.1} | {source: 1.0}
    said = words.limits({"rotation_deg": parts, "translation_pct": parts})
    assert said[0].startswith(f"What limits the rotation and the translation is the {word}") or word in said[0]
    assert "next to nothing" in said[0]
    others = [name for name in words.REMEDIES if name != source]
    assert not any(words.REMEDIES[name] in line for name in others for line in said)


def test_two_sources_are_told_apart_and_an_even_share_is_no_reason_to_stop():
    said = words.limits(
        {"rotation_deg": {"image": 1.0, "print": 0.9}, "translation_pct": {"image": 0.1, "print": 0.2, "camera": None}}
    )
    assert [line.split(" is ")[0] for line in said[:2]] == ["What limits the rotation", "What limits the translation"]
    assert "next to nothing" not in said[0]
    assert "--camera-covariance" in said[2]


def test_shares_of_the_variance_add_up():
    parts = words.shares({"rotation_deg": {"image": 3.0, "print": 4.0, "camera": 0.0, "total": 5.0}}, "rotation_deg")
    assert parts == pytest.approx({"image": 0.36, "print": 0.64, "camera": 0.0})
    assert words.in_words(parts) == "print 64 %, image noise 36 %, calibration 0 %"
    assert words.shares({"rotation_deg": dict.fromkeys(parts, 0.0)}, "rotation_deg") == {}


def test_command_makes_the_results_again(subject, results):
    assert overview.command(subject) == (
        "markergen validate marker.json --poses paper --runs 3 --noise 0.2 --views 160 --print-sigma 0.1mm "
        "--camera-covariance FILE --seed 0 --json results.json --report report.html"
    )
    views = {
        **results["views"], "hidden": 1, "refine": "photometric", "background": "clutter", "stress": {"x": {}},
        "optics": {**results["views"]["optics"], "blur_px": 1.5},
    }  # fmt: skip
    said = overview.command(replace(subject, results={**results, "views": views}))
    for option in ("--hide 1", "--refine photometric", "--background clutter", "--stress", "--optics blur_px=1.5"):
        assert option in said
    assert "--views 0" in overview.command(replace(subject, results={**results, "views": None}))


def test_long_provenance_is_cut_off(pentagon):
    long = replace(pentagon, provenance={"note": "x" * 10_000, "seed": "y" * 10_000})
    assert len(overview.provenance(long)) < 5000
    assert all(len(text) < 300 for _, text in overview.origin(long))


# Size of the dots


def test_short_axis_at_the_origin_is_the_formula(make_marker, setting):
    # d f cos(tilt)/z for a circle much smaller than its distance; the exact ellipse differs in second order.
    marker = make_marker(np.zeros((1, 2)), 0.15, 0.01)
    poses = setting.poses
    formula = 0.01 * 800 * poses.cos_tilt / poses.translation[:, 2]
    np.testing.assert_allclose(short_axes(marker, setting.camera, poses)[:, 0], formula, rtol=1e-3)


def test_short_axis_of_a_raised_dot_is_that_of_a_nearer_one(make_marker, setting):
    flat = make_marker(np.zeros((1, 2)), 0.15, 0.01)
    raised = replace(flat, control_points=(ControlPoint(0, 0.0, 0.0, 0.05, Feature(0.01)),))
    frontal = PoseDistribution("one", setting.poses.rotation[[0]], setting.poses.translation[[0]])
    nearer = PoseDistribution("one", frontal.rotation, frontal.translation - [0, 0, 0.05])
    seen = short_axes(raised, setting.camera, frontal)
    np.testing.assert_allclose(seen, short_axes(flat, setting.camera, nearer), rtol=1e-12)


def test_advice_reaches_what_it_promises(pentagon, setting):
    found = advise(pentagon, setting.camera, setting.poses)
    axes = short_axes(pentagon, setting.camera, setting.poses).min(axis=1)
    assert found.worst.thinnest_px == axes.min()
    assert setting.poses.polar_angle_deg[found.worst.pose] == pytest.approx(70)
    # 36 mm at 1.5 m and 70 deg, seen with f = 800 px.
    assert found.worst.center_px == pytest.approx(36e-3 * 800 * np.cos(np.deg2rad(70)) / 1.5, rel=2e-3)
    for wanted, share in ((found.worst, 1.0), (found.most, 0.94)):
        scale = wanted.diameter / pentagon.dot_diameter
        larger = short_axes(pentagon, setting.camera, setting.poses, scale).min(axis=1)
        smaller = short_axes(pentagon, setting.camera, setting.poses, scale - 0.2e-3 / pentagon.dot_diameter).min(
            axis=1
        )
        assert np.mean(larger >= 8) >= share
        assert np.mean(smaller >= 8) < share


def test_advice_in_words(pentagon, make_ngon, setting):
    said = sentences(advise(pentagon, setting.camera, setting.poses), pentagon, setting.poses)
    assert said[0].startswith("At 1.5 m and 70 deg the dot that looks smallest, of 36 mm, is 5.6 px")
    assert "use 51.2 mm for the 8 px" in said[0]
    assert "--dot 51.2mm" in said[-1]
    many = make_ngon(30, 0.15, 0.02)
    assert (
        "scale the whole marker to 2" in sentences(advise(many, setting.camera, setting.poses), many, setting.poses)[-1]
    )
    large = make_ngon(4, 0.15, 0.06)
    (only,) = sentences(advise(large, setting.camera, setting.poses), large, setting.poses)
    assert "large enough" in only


# Plots


def test_camera_centers_are_where_the_paper_puts_them(few):
    centers = camera_centers(few.poses)
    np.testing.assert_allclose(np.linalg.norm(centers, axis=-1), few.poses.distance)
    np.testing.assert_allclose(centers[:, 2], few.poses.distance * few.poses.cos_tilt, atol=1e-12)


def test_sphere_shows_every_pose_the_larger_the_worse(pentagon, few, ax):
    values = np.arange(1.0, len(few.poses) + 1)
    values[3] = np.inf
    assert pose_sphere(pentagon, few.poses, values, "error", ax) is ax
    points = ax.collections[0]
    assert len(points.get_offsets()) == len(few.poses) - 1
    order = np.argsort(points.get_array())
    assert np.all(np.diff(points.get_sizes()[order]) > 0)


def test_sphere_of_equal_errors(pentagon, few, ax):
    pose_sphere(pentagon, few.poses, np.ones(len(few.poses)), "error", ax)
    assert np.ptp(ax.collections[0].get_sizes()) == 0


def test_fan_tells_the_number_of_every_cell(pentagon, few, ax):
    table = cells(bound(pentagon, few, 0.2))
    values = [cell.rotation_deg for cell in table]
    assert fan(table, values, 0.15, ax) is ax
    shown = [text.get_text() for text in ax.texts]
    assert all(words.number(value, 2) in shown for value in values)
    assert len(ax.patches) == len(table)


def test_groups_reach_halfway_to_their_neighbors_and_bins_as_far_as_they_say():
    assert interval("35", ["0", "17.5", "35", "70"]) == (26.25, 52.5)
    assert interval("0", ["0", "20"]) == (-10, 10)
    assert interval("30..40", ["20..30", "30..40"]) == (30, 40)
    assert interval("1", ["1"]) == pytest.approx((0.9, 1.1))


def test_errors_over_tilt_draws_the_statistics(results, ax):
    measured_at = {
        name: {angle: group["rotation_deg"] for angle, group in row["by_polar_angle"].items()}
        for name, row in results["estimators"].items()
    }
    limits = {angle: row["rotation_deg"] for angle, row in results["bound"]["by_polar_angle"].items()}
    assert errors_over(measured_at, limits, ax) is ax
    drawn = {line.get_label(): line for line in ax.lines}
    np.testing.assert_allclose(drawn["LM, RMS"].get_xdata(), [0, 17.5, 35, 52.5, 70])
    np.testing.assert_allclose(drawn["bound (CRLB)"].get_ydata(), list(limits.values()))
    # In black and white, lines are told apart by dashes and marks.
    looks = {(str(line.get_linestyle()), str(line._dash_pattern), line.get_marker()) for line in ax.lines}
    assert len(looks) == len(ax.lines)
    assert len(ax.collections) == 1


def test_distribution_is_the_share_below(ax):
    values, shares = ranked(np.array([3.0, 1.0, 2.0, 4.0]))
    assert (values.tolist(), shares.tolist()) == ([1, 2, 3, 4], [0.25, 0.5, 0.75, 1])
    distribution(None, {"detect": (values, shares)}, ax)
    np.testing.assert_allclose(ax.lines[-1].get_ydata(), [25, 50, 75, 100])


def test_drawn_errors_have_their_covariance(budget):
    errors = draw_errors(budget.total[:2])
    np.testing.assert_array_equal(errors, draw_errors(budget.total[:2]))
    for own, wanted in zip(errors, budget.total[:2], strict=True):
        scale = np.sqrt(np.diag(wanted))
        sampled = np.cov(own.T) / scale / scale[:, None]
        # 20000 draws: a correlation is off by 0.007, one sigma.
        np.testing.assert_allclose(sampled, wanted / scale / scale[:, None], atol=0.04)
    assert draw_errors(np.full((3, 6, 6), np.inf)).shape == (0, 6)


def test_shares_of_the_bars_fill_them(results, ax):
    assert variance_shares(results["budget"], ax) is ax
    widths = np.array([bar.get_width() for bar in ax.patches]).reshape(2, 3)
    np.testing.assert_allclose(widths.sum(axis=1), 100)
    assert len({bar.get_hatch() for bar in ax.patches}) == 3


def test_total_over_tilt_is_the_root_of_the_squares(budget, few, ax):
    budget_over_tilt(budget, few.poses, "rotation_deg", ax)
    drawn = {line.get_label(): np.nan_to_num(line.get_ydata()) for line in ax.lines}
    total = np.sqrt(drawn["image noise"] ** 2 + drawn["print"] ** 2 + drawn["calibration"] ** 2)
    np.testing.assert_allclose(drawn["total"], total, rtol=1e-6)


def test_ellipse_holds_95_percent():
    matrix = np.array([[4.0, 1.0], [1.0, 1.0]])
    outline = ellipse(matrix)
    squared = np.einsum("ij,ij->i", outline, np.linalg.solve(matrix, outline.T).T)
    np.testing.assert_allclose(squared, QUANTILE_95**2)
    errors = np.random.default_rng(0).multivariate_normal([0, 0], matrix, 20_000)
    # Standard deviation of the share: 0.0015.
    assert share_inside(errors, matrix) == pytest.approx(0.95, abs=0.006)


def test_errors_are_carried_over_to_one_covariance():
    rng = np.random.default_rng(0)
    roots = rng.standard_normal((20_000, 2, 2))
    own = roots @ roots.swapaxes(-1, -2) + 0.1 * np.eye(2)
    errors = (np.linalg.cholesky(own) @ rng.standard_normal((len(own), 2, 1)))[..., 0]
    target = np.array([[2.0, -0.5], [-0.5, 1.0]])
    # Standard deviation of an entry: about 0.02.
    np.testing.assert_allclose(np.cov(carried_over(errors, own, target).T), target, atol=0.1)
    assert carried_over(np.zeros((0, 2)), np.zeros((0, 2, 2)), target).shape == (0, 2)


def test_dots_of_a_perfect_detector_lie_inside_as_they_should(subject, quick):
    caption = next(each.caption for each in measured.ellipses(subject).plots if "dot centers" in each.caption)
    inside = float(re.search(r"([\d.]+) % lie inside", caption)[1])
    # 800 dots: one sigma is 0.8 %.
    assert inside == pytest.approx(95, abs=3)


def test_bars_of_the_comparison_are_the_bounds(ax):
    assert compared({"this marker": 0.7, "random": 2.0, "none": np.inf}, {"this marker": 0.8}, ax) is ax
    assert [bar.get_width() for bar in ax.patches] == [0.7, 2.0, 0.0]
    assert [text.get_text() for text in ax.texts] == ["0.700", "2.00", "unbounded"]
    np.testing.assert_allclose(ax.lines[0].get_xdata(), [0.8])
