from dataclasses import replace

import pytest
from sentences import sentence

from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.spec import ImageNoise, Spec
from markergen.model.substrate import Hole, Substrate, parse_mount
from markergen.model.tag import Tag
from markergen.render import DEFAULT_OPTICS


def test_the_noise_model_is_settled_so_that_equal_wishes_are_equal():
    assert Spec().noise_model == "point"
    assert Spec(dot="auto").noise_model == "image"
    assert Spec(dot="auto", noise_model="image") == Spec(dot="auto")
    assert Spec(noise_model="point").hash == Spec().hash


def test_specs_from_before_there_was_a_noise_model_keep_their_hash():
    assert Spec().hash == "2b6ca07a"
    assert not {"noise_model", "image_noise"} & set(Spec().as_dict())
    assert Spec(noise_model="image").as_dict()["noise_model"] == "image"
    assert Spec(image_noise=ImageNoise(blur_px=1.0)).as_dict()["image_noise"]["blur_px"] == 1.0
    assert len({spec.hash for spec in (Spec(), Spec(noise_model="image"), Spec(dot="auto"), Spec(dot=0.036))}) == 4


def test_a_perfect_print_is_not_mentioned():
    assert Spec(dot="auto", print_sigma=0.0).hash == Spec(dot="auto").hash
    assert "print_sigma" not in Spec(dot="auto").as_dict()
    assert Spec(dot="auto", print_sigma=1e-4).as_dict()["print_sigma"] == 1e-4
    assert Spec(dot="auto", print_sigma=1e-4).hash != Spec(dot="auto").hash


@pytest.mark.parametrize("print_sigma", [-1e-4, float("nan"), float("inf"), 0.15])
def test_print_errors_that_cannot_be_are_refused(print_sigma):
    with pytest.raises(InputError, match="print error of 0") as caught:
        Spec(dot="auto", print_sigma=print_sigma)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"noise_model": "pixel"}, "known: point, image"),
        ({"noise_model": "point", "dot": "auto"}, "the noise model image for --dot auto"),
        ({"noise_model": "image", "dot": 0.0}, "dots with a size"),
        ({"print_sigma": 1e-4, "noise_model": "point", "dot": 0.036}, "use --noise-model image"),
    ],
)
def test_wishes_that_do_not_go_together_are_refused(values, phrase):
    with pytest.raises(InputError, match=phrase):
        Spec(**values)


def test_a_print_error_takes_noise_from_images():
    assert Spec(print_sigma=1e-4).noise_model == "image"


def test_surviving_nothing_is_no_wish():
    assert "survive" not in Spec(survive=0).as_dict()
    assert Spec(n=6, survive=1).as_dict()["survive"] == 1
    assert Spec(n=6, survive=1).hash != Spec(n=6).hash


@pytest.mark.parametrize(("n", "survive"), [(4, 1), (6, 3), (9, 4), (8, -1), (24, 3)])
def test_losses_that_cannot_be_told_are_refused(n, survive):
    with pytest.raises(InputError, match=f"survive={survive}"):
        Spec(n=n, survive=survive)


def test_a_spec_without_a_tag_has_the_hash_it_had():
    assert "tag" not in Spec().as_dict()
    assert "tag_side" not in Spec().as_dict()
    # As it was before there were tags.
    assert Spec().hash == "2b6ca07a"


def test_a_tag_is_settled_so_that_what_means_the_same_is_equal():
    spec = Spec(tag="aruco:DICT_4X4_50")
    assert spec == Spec(tag="aruco:DICT_4X4_50:0", tag_side=0.05)
    assert (spec.as_dict()["tag"], spec.as_dict()["tag_side"]) == ("aruco:DICT_4X4_50:0", 0.05)
    assert len({spec.hash, Spec().hash, Spec(tag="aruco:DICT_4X4_50:1").hash, replace(spec, tag_side=0.06).hash}) == 4
    assert spec.placed_tag == Tag("aruco:DICT_4X4_50", 0, 0.05)
    assert spec.blocked == (spec.placed_tag.quiet_zone,)
    assert Spec().placed_tag is None
    assert Spec(keep_outs=(Circle(0.01),)).blocked == (Circle(0.01),)


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"tag": "apriltag:36h12:1"}, "did you mean 'apriltag:36h11'"),
        ({"tag": "aruco:DICT_4X4_50:50"}, "an id of 0 to 49"),
        ({"tag": "aruco:DICT_4X4_50:1", "tag_side": 0.2}, "use --tag-size 15"),
        ({"tag": "aruco:DICT_4X4_50:1", "tag_side": -0.2}, "a tag side above 0"),
        ({"tag_side": 0.05}, "a tag with a tag size"),
        ({"tag": "aruco:DICT_4X4_50:1", "keep_outs": (Circle(0.01),)}, "no room in the middle"),
    ],
)
def test_tags_that_do_not_go_are_refused(values, phrase):
    with pytest.raises(InputError, match=phrase):
        Spec(**values)


def test_a_plain_plate_is_not_mentioned():
    assert "substrate" not in Spec(substrate=Substrate()).as_dict()
    assert Spec(substrate=Substrate()).hash == "2b6ca07a"
    spec = Spec(substrate=Substrate(0.004, outline=Circle(0.2)))
    assert spec.as_dict()["substrate"] == {"thickness": 0.004, "outline": {"kind": "circle", "radius": 0.2}}
    assert spec.hash != Spec().hash


def test_no_dot_and_no_tag_lies_on_a_hole():
    holes = (Hole(0.05, 0.0, 0.0034, 0.00672), Hole(-0.05, 0.0, 0.004, use="dowel"))
    rims = (Circle(0.00336, (0.05, 0.0)), Circle(0.002, (-0.05, 0.0)))
    plate = Substrate(holes=holes)
    assert Spec(substrate=plate).blocked == rims
    assert Spec(keep_outs=(Circle(0.01),), substrate=plate).blocked == (Circle(0.01), *rims)
    free, tight = (Spec(tag="aruco:DICT_4X4_50", substrate=item) for item in (Substrate(), plate))
    # Without holes the tag and its quiet zone are 66.7 mm wide.
    assert free.tag_side == 0.05
    closer = Spec(tag="aruco:DICT_4X4_50", substrate=Substrate(holes=parse_mount("4xM3@60mm/0")))
    assert closer.tag_side < 0.05
    assert tight.blocked == (tight.placed_tag.quiet_zone, *rims)
    with pytest.raises(InputError, match="tag that lies"):
        Spec(tag="aruco:DICT_4X4_50", substrate=Substrate(holes=parse_mount("M3:0,0")))


@pytest.mark.parametrize(
    ("substrate", "phrase"),
    [
        (Substrate(outline=Circle(0.14)), "a plate's outline that holds the boundary"),
        (Substrate(holes=parse_mount("4xM3@0.5")), "over the edge of the plate"),
        (Substrate(0.001, holes=parse_mount("4xM3c@0.1")), "has a countersink 1.66 mm deep in a plate of 1 mm"),
        (Substrate(holes=parse_mount("2xM3@3mm")), "over the hole M3"),
        (Substrate(holes=parse_mount("0.28:0,0")), None),
    ],
)
def test_plates_that_cannot_carry_the_dots_are_refused(substrate, phrase):
    if phrase is None:
        assert Spec(substrate=substrate).substrate == substrate
        return
    with pytest.raises(InputError, match=phrase) as caught:
        Spec(substrate=substrate)
    assert "\n" not in str(caught.value)


def test_holes_that_leave_no_room_are_refused():
    bored = Substrate(outline=Circle(0.2), holes=(Hole(0.0, 0.0, 0.31),))
    with pytest.raises(InputError, match="that leave room"):
        Spec(substrate=bored)


def test_designs_reckon_with_the_image_that_views_are_rendered_with():
    assert ImageNoise() == ImageNoise(
        DEFAULT_OPTICS.blur_px, DEFAULT_OPTICS.noise_grey, DEFAULT_OPTICS.light - DEFAULT_OPTICS.dark
    )


def test_pixel_and_rounding_count():
    noise = ImageNoise(blur_px=0.7, noise_grey=2.0, contrast=195.0)
    assert noise.edge_px**2 == pytest.approx(0.49 + 1 / 12)
    assert noise.contrast_to_noise**2 == pytest.approx(195**2 / (4 + 1 / 12))
    assert str(noise) == sentence("image noise", 0.7, 2, 195)
    # Without any noise before it, rounding remains: no number is infinite.
    assert ImageNoise(noise_grey=0.0).contrast_to_noise == pytest.approx(195 * 12**0.5)


@pytest.mark.parametrize(
    "values", [{"blur_px": -1.0}, {"noise_grey": float("nan")}, {"contrast": 0.0}, {"contrast": float("inf")}]
)
def test_unfit_images_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values))):
        ImageNoise(**values)
