"""Tags in C at places that are right to a pixel, in views rendered here: cells that are averaged over fine samples."""

import numpy as np
import pytest
from markergen_detect.core import constants, library, pointer, structures

SHAPE, FOCAL = (240, 320), 300.0
BITS, COUNT = 4, 50


@pytest.fixture(scope="module")
def inks():
    """Tags (count, 4, 4) of random cells, 3 or more apart in all turns, mirrored ones, too."""
    rng, tags = np.random.default_rng(0), []
    while len(tags) < COUNT:
        ink = rng.integers(0, 2, (BITS, BITS))
        rotated = [np.rot90(side, k) for side in (ink, ink[:, ::-1]) for k in range(4)]
        apart = [np.sum(other != rotation) for rotation in rotated for other in tags]
        if min([*apart, *(np.sum(ink != rotation) for rotation in rotated[1:])]) >= 3:
            tags.append(ink)
    return np.array(tags)


class Place:
    """A tag's place: side of a cell in px where it faces the camera, then turned about x by `tilt` and in the image."""

    def __init__(self, cell, tilt=0.0, roll=0.3, lens=(0.0, 0.0, 0.0, 0.0), at=(10.0, -7.0)):
        self.lens, self.cell = lens, cell
        (s, c), (sr, cr) = (np.array([np.sin(a), np.cos(a)]) for a in (tilt, roll))
        flip = np.diag([1.0, -1.0, -1.0])
        lean = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        self.R = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]]) @ lean @ flip
        self.t = np.array([*np.array(at) / FOCAL, 1.0])
        half = cell * (BITS + 2) / 2 / FOCAL
        self.corners = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
        self.camera = np.zeros(1, structures()["Camera"])
        for name, value in {"width": SHAPE[1], "height": SHAPE[0], "fx": FOCAL, "fy": FOCAL}.items():
            self.camera[name] = value
        self.camera["cx"], self.camera["cy"], self.camera["reach"] = (SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2, 2.0
        self.camera["lens"] = constants()["BROWN_CONRADY" if any(lens) else "PINHOLE"]
        self.camera["count"], self.camera["c"][0, : len(lens)] = len(lens), lens

    def pixels(self, body):
        X = body @ self.R.T + self.t
        x, y = (X[:, :2] / X[:, 2:]).T
        k1, k2, p1, p2 = self.lens
        r2 = x * x + y * y
        s = 1 + k1 * r2 + k2 * r2 * r2
        u = s * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = s * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return FOCAL * np.stack([u, v], axis=-1) + (np.array(SHAPE[::-1]) - 1) / 2

    def view(self, ink, rng, light=200.0, dark=40.0, noise=2.0, blur=0.7, beyond=120.0):
        """Image of the tag with a quiet zone of one cell: fine samples of the plane, by the nearest of which pixels are
        averaged."""
        from scipy.ndimage import gaussian_filter

        n, fine = BITS + 4, max(12, int(5 * self.cell))
        cells = np.pad(np.pad(ink, 1, constant_values=1), 1)
        steps = (np.arange(n * fine) + 0.5) / fine - 1
        u, v = np.meshgrid(steps / (BITS + 2), steps / (BITS + 2))
        a, b = self.corners[1] - self.corners[0], self.corners[3] - self.corners[0]
        seen = 3 * (self.pixels(self.corners[0] + u.reshape(-1, 1) * a + v.reshape(-1, 1) * b) + 0.5)
        row, column = np.floor(seen[:, 1]).astype(int), np.floor(seen[:, 0]).astype(int)
        inside = (row >= 0) & (row < 3 * SHAPE[0]) & (column >= 0) & (column < 3 * SHAPE[1])
        place = row[inside] * 3 * SHAPE[1] + column[inside]
        levels = np.where(np.kron(cells, np.ones((fine, fine))).ravel(), dark, light)[inside]
        many = np.bincount(place, minlength=9 * SHAPE[0] * SHAPE[1])
        sums = np.bincount(place, levels, minlength=9 * SHAPE[0] * SHAPE[1])
        grey = np.where(many > 0, sums / np.maximum(many, 1), beyond).reshape(3 * SHAPE[0], 3 * SHAPE[1])
        grey = gaussian_filter(grey, 3 * blur).reshape(SHAPE[0], 3, SHAPE[1], 3).mean(axis=(1, 3))
        return np.clip(np.rint(grey + rng.normal(0, noise, SHAPE)), 0, 255).astype(np.uint8)

    def read(self, image, inks, off=(0.0, 0.0), least=1.0, inverted=False):
        """Reading at the place moved by `off`, px."""
        picture, pose, reading = (np.zeros(1, structures()[name]) for name in ("Image", "Pose", "TagReading"))
        family, _codes = family_of(inks)
        picture["rows"], picture["height"], picture["width"] = image.ctypes.data, *image.shape
        picture["stride"], picture["wide"], picture["inverted"] = image.strides[0], image.itemsize == 2, inverted
        pose["R"], pose["t"], pose["focal"] = self.R.ravel(), self.t + np.append(off, 0) / FOCAL, 1
        corners = np.ascontiguousarray(self.corners)
        arguments = (pointer(item) for item in (picture, self.camera, pose, corners, family))
        read = library().read_tag(*arguments, least, pointer(reading))
        assert read == (reading["state"][0] == constants()["TAG_READ"]) == (reading["id"][0] >= 0)
        return reading[0]

    @staticmethod
    def agreement(reading, inks, number):
        family, _codes = family_of(inks)
        return library().agreement(pointer(family), pointer(np.array([reading])), number)


def family_of(inks):
    """The table of a family, and the codes to which it points."""
    codes = np.array([sum(int(b) << k for k, b in enumerate(ink.ravel())) for ink in inks], dtype=np.uint64)
    family = np.zeros(1, structures()["TagFamily"])
    family["cells"], family["count"], family["codes"] = inks.shape[1] + 2, len(codes), pointer(codes)
    return family, codes


def state(name):
    return constants()[f"TAG_{name}"]


@pytest.mark.parametrize("cell", [2.2, 4.0, 15.0])
@pytest.mark.parametrize("lens", [(0, 0, 0, 0), (-0.3, 0.1, 1e-3, -1e-3)])
def test_reads_at_a_place_that_is_a_pixel_off(inks, rng, cell, lens):
    tilt, at = (0.3, (90.0, -50.0)) if any(lens) else (0.7, (10.0, -7.0))
    place = Place(cell / np.cos(tilt), tilt, lens=lens, at=at)
    for number in range(0, 50, 5):
        reading = place.read(place.view(inks[number], rng), inks, rng.uniform(-0.7, 0.7, 2))
        assert (reading["id"], reading["rotation"], reading["mirrored"]) == (number, 0, 0)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("quarters", range(4))
def test_turned_and_mirrored_tags_say_so(inks, rng, quarters, mirrored):
    place = Place(6.0, 0.4)
    seen = np.rot90(inks[7][:, ::-1] if mirrored else inks[7], quarters)
    reading = place.read(place.view(seen, rng), inks)
    assert (reading["id"], reading["rotation"], reading["mirrored"]) == (7, quarters, mirrored)


@pytest.mark.parametrize(("cell", "tolerance"), [(3.0, 0.4), (8.0, 0.1)])
def test_corners_are_where_the_edges_are(inks, rng, cell, tolerance):
    place = Place(cell, 0.5, lens=(-0.3, 0.1, 0, 0), at=(60.0, 40.0))
    reading = place.read(place.view(inks[3], rng), inks, (0.8, -0.6))
    assert np.abs(reading["corners"] - place.pixels(place.corners)).max() < tolerance


def test_shadows_and_low_contrast(inks, rng):
    place = Place(5.0)
    image = place.view(inks[11], rng, noise=0.0).astype(float)
    for dark in (0.3, 0.45):
        shadow = image * (1 - dark * (np.arange(SHAPE[1]) > 170)) + rng.normal(0, 2, SHAPE)
        assert place.read(np.clip(shadow, 0, 255).astype(np.uint8), inks)["id"] == 11
    assert place.read(place.view(inks[11], rng, light=110, dark=100, noise=1.0), inks)["id"] == 11


def test_sixteen_bits_light_tags_and_rows_of_a_larger_image(inks, rng):
    place = Place(4.0, 0.2)
    image = place.view(inks[20], rng)
    assert place.read(image.astype(np.uint16) * 257, inks)["id"] == 20
    assert place.read(255 - image, inks, inverted=True)["id"] == 20
    assert place.read(np.pad(image, 9)[9:-9, 9:-9], inks)["id"] == 20


def test_says_why_a_tag_is_not_read(inks, rng):
    place = Place(5.0)
    image = place.view(inks[0], rng)
    assert place.read(image, inks, least=6.0)["state"] == state("SMALL")
    assert place.read(np.full(SHAPE, 90, np.uint8), inks)["state"] == state("FAINT")
    assert place.read(image, inks, (400.0, 0.0))["state"] == state("OUTSIDE")
    assert place.read(image, inks[1:])["state"] == state("UNCLEAR")
    covered = image.copy()
    covered[:, :165] = 60
    assert place.read(covered, inks)["state"] in (state("COVERED"), state("FAINT"))


def test_what_is_seen_of_a_tag_agrees_with_its_code(inks, rng):
    """By each cell's likelihoods (n,) if it is light and if it is black, log prod 2 p(cell) / (p(light) + p(black))."""
    place = Place(8.0, roll=0.0)
    for number in range(8):
        image = place.view(inks[number], rng)
        image[:, :162] = 120
        reading = place.read(image, inks)
        cells = reading["cells"][:, : BITS * BITS]
        ratio = {k: np.sum(np.log(2 * np.choose(inks[k].ravel(), cells) / cells.sum(axis=0))) for k in range(COUNT)}
        assert reading["state"] == state("COVERED")
        assert ratio[number] > 4.6
        assert np.allclose([place.agreement(reading, inks, k) for k in ratio], list(ratio.values()))
        assert sum(ratio[k] > ratio[number] - 1 for k in ratio) < 3


def test_a_finger_over_cells_never_makes_another_tag(inks, rng):
    place, right = Place(5.0), 0
    for k in range(60):
        image = place.view(inks[k % COUNT], rng)
        x, y = 169.5 + rng.uniform(-12, 12), 112.5 + rng.uniform(-12, 12)
        rows, columns = np.indices(SHAPE)
        image[np.hypot(columns - x, rows - y) < rng.uniform(2, 12)] = rng.integers(20, 220)
        number = place.read(image, inks)["id"]
        assert number in (-1, k % COUNT)
        right += number >= 0
    assert right >= 10


def test_no_tag_is_read_in_textures(inks, rng):
    from scipy.ndimage import zoom

    reads = 0
    for k in range(500):
        place, size = Place(float(rng.uniform(2, 12)), float(rng.uniform(0, 0.9)), float(rng.uniform(0, 6))), k % 12 + 1
        coarse = rng.normal(128, 60, [-(-side // size) + 1 for side in SHAPE])
        texture = zoom(coarse, size, order=k % 2)[: SHAPE[0], : SHAPE[1]]
        reads += place.read(np.ascontiguousarray(np.clip(texture, 0, 255).astype(np.uint8)), inks)["id"] >= 0
    assert reads == 0


def test_no_size_or_place_is_out_of_bounds(inks, rng):
    image = rng.integers(0, 256, (7, 9), dtype=np.uint8)
    for _ in range(300):
        place = Place(float(10 ** rng.uniform(-3, 4)), float(rng.uniform(-3, 3)), at=rng.normal(0, 200, 2))
        place.read(image, inks, least=0.0)
    for cells in (0, 9, 12):
        assert place.read(image, np.zeros((1, cells, cells), int))["state"] == state("OUTSIDE")
