from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.validation.stress import CONDITIONS, stress
from markergen.validation.views import Shoot


def test_every_condition_is_told(ngon):
    calls = []
    shoot = Shoot(ngon(), PAPER_CAMERA, paper(), count=5)
    found = stress(shoot, workers=1, progress=lambda done, total: calls.append((done, total)))
    assert list(found) == list(CONDITIONS)
    assert calls[-1] == (25, 25)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    for name, summary in found.items():
        assert summary["count"] == 5, name
        assert summary["wrong"] == 0, name
    assert found["blur 2 px"]["optics"]["blur_px"] == 2
    assert found["half the light"]["optics"]["light"] == 112.5
    assert found["one dot hidden"]["hidden"] == 1
