from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.render import Optics
from markergen.validation.pictures import pictures
from markergen.validation.view_records import summarize, take_records
from markergen.validation.views import Shoot


def test_failures_come_first_then_the_worst_then_others(ngon):
    # 10 mm dots are 1.8 px across at 70 deg and 1.5 m: some views fail, others do not.
    shoot = Shoot(ngon(diameter=0.010), PAPER_CAMERA, paper(), count=20, optics=Optics(noise_grey=6))
    views = summarize(shoot, take_records(shoot, workers=1))
    assert 0 < views["detected"] < 20
    shown = list(pictures(shoot, views))
    kinds = [picture.name.split("-")[0] for picture in shown]
    assert kinds == sorted(kinds, key=["failure", "worst", "typical"].index)
    assert set(kinds) == {"failure", "worst", "typical"}
    assert len({picture.name for picture in shown}) == len(shown)
    assert all(picture.png.startswith(b"\x89PNG") for picture in shown)
    assert shown[0].caption.endswith(f"{views['failures'][0]['reason']}.") or len(views["failures"]) > 6
