"""What a report says of labels, and that markers whose layout tells them are found with the right ones."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from markergen.bounds.confusion.perspective import label_safety
from markergen.detect import detect
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.poses import paper
from markergen.objectives import Setting
from markergen.render import DEFAULT_OPTICS, render_view
from markergen.validation import report
from markergen.validation.report.subject import Subject
from markergen.validation.views import SyntheticViews

POSES = paper()
SAFE = 1e-3 * np.array([[-119.8, 46.2], [-103.4, -76.1], [2.7, -128.4], [128.3, -4.9], [13.9, 127.6]])
"""What `design` makes of five dots and --asymmetric 3."""


def without_ring(marker):
    disks = tuple(replace(point, feature=Feature(point.feature.diameter)) for point in marker.control_points)
    return replace(marker, control_points=disks)


@pytest.fixture(scope="module")
def safe(make_marker):
    return without_ring(make_marker(SAFE, 0.15, 0.036))


def test_a_section_on_telling_the_dots_apart(pentagon, setting):
    few = Setting(setting.boundary, setting.camera, POSES.taken(np.arange(0, 400, 40), 0))

    def section(marker):
        results = {"labels": label_safety(marker, few).as_dict() if marker.dot_diameter else None}
        return report.labels(Subject(results, marker, few, None))

    keyed, symmetric = section(pentagon), section(without_ring(pentagon))
    assert keyed.sentences[0].startswith(sentence("rings and disks", 0))
    assert [row[1] for row in keyed.tables[0][2]].count("-") == 1
    assert "ring" not in symmetric.sentences[0].lower()
    assert symmetric.sentences[1].startswith("Labels are ambiguous")
    assert {row[3] for row in symmetric.tables[0][2]} == {"1"}
    bare = replace(pentagon, control_points=tuple(replace(p, feature=Feature(0.0)) for p in pentagon.control_points))
    assert "Bare points" in section(bare).missing


@pytest.mark.parametrize("hidden", [0, 1])
def test_without_a_ring_the_layout_tells_the_labels(safe, hidden):
    series = SyntheticViews(safe, PAPER_CAMERA, POSES, count=12, hidden=hidden)
    views = [series.take(k) for k in range(series.count)]
    assert all(view.detected for view in views)
    for view in views:
        unaided = detect(view.image, safe)
        # Four dots have a homography with any labels.
        assert unaided.ok == (not hidden)
        if unaided.ok:
            # Hundredths of a pixel; another dot is dozens away.
            np.testing.assert_allclose(unaided.pixels, view.truth[unaided.ids], atol=0.5)


@pytest.mark.parametrize("camera", [PAPER_CAMERA, None])
def test_a_symmetric_layout_without_a_ring_is_refused(pentagon, camera):
    marker = without_ring(pentagon)
    for pose in (0, 130, 250):
        image = render_view(
            marker,
            PAPER_CAMERA,
            POSES.rotation[pose],
            POSES.translation[pose],
            DEFAULT_OPTICS,
            np.random.default_rng(0),
        )
        finding = detect(image, marker, camera)
        assert not finding.ok
        assert finding.reason.startswith("labels are ambiguous")
