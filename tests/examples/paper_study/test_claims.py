import numpy as np
import pytest
from markergen_paper.claims import CLAIMS, ClaimTest, verdict
from markergen_paper.options import COORDINATES
from markergen_paper.statistics import LEVEL, Judged

FOUND, OPPOSITE, NEITHER = (Judged(1.0, 0.5, 1.5, p, against, 20) for p, against in ((0, 1), (1, 0), (0.5, 0.5)))


def finding(judged):
    return ClaimTest("unit", None, "something", judged)


@pytest.mark.parametrize(
    ("judged", "words"),
    [
        ([FOUND], "holds"),
        ([FOUND, FOUND], "holds"),
        ([OPPOSITE], "does not hold"),
        ([NEITHER, NEITHER], "open"),
        ([FOUND, OPPOSITE, OPPOSITE], "holds in 1, does not in 2"),
        ([FOUND, NEITHER], "holds in 1, open in 1"),
        ([OPPOSITE, NEITHER], "does not in 1, open in 1"),
    ],
)
def test_verdicts(judged, words):
    assert verdict([finding(each) for each in judged]) == words


@pytest.fixture(scope="module")
def findings(study):
    """Findings by the names of the claims."""
    return {claim.name: list(claim.find(study)) for claim in CLAIMS}


def test_every_claim_is_judged_in_all_coordinates(findings):
    for found in findings.values():
        assert {each.coordinates for each in found} == set(COORDINATES)
        assert all(each.judged.count for each in found)
        keys = [(each.coordinates, each.noise_px, each.measure) for each in found]
        assert len(set(keys)) == len(keys)


def test_all_tests_together_hardly_ever_find_what_is_not_there(findings):
    """The level is that of 3 % over all tests and both of their sides, however they depend on each other."""
    assert 2 * sum(map(len, findings.values())) * LEVEL < 0.03


def test_verdicts_follow_what_was_measured(findings):
    """Made-up layouts lie near the n-gon, and random ones are ten times as bad with four points, 10/(n - 3) with n."""
    found = findings
    for name in sorted(set(found) - {"EPnP and IPPE gain more", "c tells", "five hold a square", "any pose"}):
        rows = [each for each in found[name] if not each.judged.holds]
        assert not any(each.judged.refuted for each in rows)
        # From four starts a mean is known to 5 %, too little for an equality to 5 %.
        assert name == "IPPE equals LM" or len(rows) <= 0.1 * len(found[name])
    # One gains as much as the other, and c(A) of a made-up layout says nothing of its errors.
    assert not any(each.judged.holds for each in found["EPnP and IPPE gain more"])
    assert verdict(found["c tells"]) == "does not hold" or not any(each.judged.holds for each in found["c tells"])
    # A pentagon has no square in it, and a random five rarely.
    assert not any(each.judged.holds for each in found["five hold a square"])
    small = next(each for each in found["small n gains more"] if each.measure.startswith("lm rotation_deg"))
    # 10 over 10/5.
    assert small.judged.value == pytest.approx(5, rel=0.15)


def test_a_broken_bound_is_told(study):
    from dataclasses import replace

    table = study.full[4]
    arrays = dict(table.arrays)
    arrays["ill.upper.metric"] = np.where(np.arange(arrays["ill.upper.metric"].shape[1]) == 0, 1.5, 0.5)
    arrays["ill.upper.metric"] = np.broadcast_to(arrays["ill.upper.metric"], study.full[4]["ill.upper.metric"].shape)
    broken = replace(study, full={**study.full, 4: replace(table, arrays=arrays)})
    claim = next(claim for claim in CLAIMS if claim.name == "bounds")
    rows = [each for each in claim.find(broken) if (each.coordinates, each.noise_px) == ("metric", 4.0)]
    assert [each.judged.refuted for each in rows] == [True, False, False, False]
    assert verdict(rows) == "holds in 3, does not in 1"
