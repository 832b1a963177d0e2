import pytest

from markergen.errors import InputError
from markergen.model.image_noise import ImageNoise
from markergen.render import DEFAULT_OPTICS


def test_designs_reckon_with_the_image_that_views_are_rendered_with():
    assert ImageNoise() == ImageNoise(
        DEFAULT_OPTICS.blur_px, DEFAULT_OPTICS.noise_grey, DEFAULT_OPTICS.light - DEFAULT_OPTICS.dark
    )


def test_pixel_and_rounding_count():
    noise = ImageNoise(blur_px=0.7, noise_grey=2.0, contrast=195.0)
    assert noise.edge_px**2 == pytest.approx(0.49 + 1 / 12)
    assert noise.contrast_to_noise**2 == pytest.approx(195**2 / (4 + 1 / 12))
    assert str(noise) == "blur 0.7 px, noise 2 and contrast 195 grey levels"
    # Without any noise before it, rounding remains: no number is infinite.
    assert ImageNoise(noise_grey=0.0).contrast_to_noise == pytest.approx(195 * 12**0.5)


@pytest.mark.parametrize(
    "values", [{"blur_px": -1.0}, {"noise_grey": float("nan")}, {"contrast": 0.0}, {"contrast": float("inf")}]
)
def test_unfit_images_are_refused(values):
    with pytest.raises(InputError, match=next(iter(values))):
        ImageNoise(**values)
