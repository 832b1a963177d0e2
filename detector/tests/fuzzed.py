"""Random images, bodies and cameras through the whole package: a process of its own, for test_sanitizers.py.

python fuzzed.py SEED ROUNDS
"""

import sys

import numpy as np
from markergen_detect import Camera, DescriptionError, Detector, Finding

SIZES = (1, 2, 3, 5, 8, 16, 17, 33, 64, 100, 127, 240, 320)
LENSES = {"none": 0, "radtan": 5, "rational": 14, "equidistant": 4}
CORNERS = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])


def random_image(rng, height, width, body):
    kind = rng.integers(8)
    y, x = np.mgrid[:height, :width]
    if kind == 0:
        image = rng.integers(0, 256, (height, width))
    elif kind == 1:
        image = np.full((height, width), rng.integers(0, 256))
    elif kind == 2:
        image = 255 * (((x // rng.integers(1, 9)) + (y // rng.integers(1, 9))) % 2)
    elif kind > 4:
        image = seen(rng, body, x, y)
        image = image + rng.normal(0, rng.choice([0, 2]), image.shape)
    else:
        image = np.full((height, width), 200.0)
        for _ in range(rng.integers(0, 60)):
            cx, cy, a, b = rng.uniform(-5, width + 5), rng.uniform(-5, height + 5), *rng.uniform(0.5, 15, 2)
            rho = np.hypot((x - cx) / a, (y - cy) / b)
            image = np.where((rho < 1) & ((rho > 0.5) | (rng.random() < 0.7)), rng.uniform(0, 150), image)
        image = image + rng.normal(0, rng.choice([0, 2, 20]), image.shape)
    wide = rng.random() < 0.3
    image = np.clip(image, 0, 255) * (257 if wide else 1)
    image = image.astype(np.uint16 if wide else np.uint8)
    if rng.random() < 0.2:
        image = np.pad(image, 3)[3:-3, 3:-3]
    return image


def seen(rng, body, x, y):
    """A body from the front, as a camera with this focal length at most sees it: dots, and a square for a tag."""
    height, width = x.shape
    ink, extent = np.zeros(x.shape), max(np.abs([dot["xyz"] for dot in body["dots"]]).max(), 1e-9)
    cosine, sine = np.cos(rotation := rng.uniform(0, 2 * np.pi)), np.sin(rotation)
    scale = min(height, width) / extent * rng.uniform(0.2, 0.6)
    places = [(dot["xyz"], dot["diameter"] / 2, dot["kind"] == "ring") for dot in body["dots"] if dot["plate"] == 0]
    for (u, v, _), radius, ring in places:
        across = width / 2 + scale * (cosine * u - sine * v)
        down = height / 2 - scale * (sine * u + cosine * v)
        rho = np.hypot(x - across, (y - down) / rng.choice([1, 0.97])) - scale * radius
        ink = np.maximum(ink, np.clip(0.5 - rho, 0, 1) - ring * np.clip(0.5 - rho - scale * radius / 2, 0, 1))
    for tag in body.get("tags", []):
        (left, top, _), (right, bottom, _) = tag["corners"][0], tag["corners"][2]
        a, b = (x - width / 2) / scale, -(y - height / 2) / scale
        u, v = cosine * a + sine * b, cosine * b - sine * a
        column, row = ((u - left) / (right - left) * 6).astype(int), ((v - top) / (bottom - top) * 6).astype(int)
        inside = (column >= 0) & (column < 6) & (row >= 0) & (row < 6) & (u > left) & (v < top)
        ink[inside] = tag["bits"][row[inside], column[inside]]
    ink = 200 - 160 * ink
    return 255 - ink if body["light"] else ink


def random_rotation(rng):
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def random_body(rng, name):
    plates = [{"name": "a", "rotation": np.eye(3), "translation": np.zeros(3)}]
    for k in range(rng.integers(0, 3) if rng.random() < 0.3 else 0):
        plates.append({"name": str(k), "rotation": random_rotation(rng), "translation": rng.normal(0, 0.1, 3)})
    dots, size = [], rng.choice([1e-6, 0.01, 0.1, 100.0], p=[0.05, 0.45, 0.45, 0.05])
    for k, plate in enumerate(plates):
        for _ in range(rng.integers(4, 12) if rng.random() < 0.8 else rng.integers(12, 60)):
            xyz = rng.uniform(-size, size, 3) * [1, 1, rng.random() < 0.1]
            if rng.random() < 0.3:
                xyz = np.round(xyz / size * 4) * size / 4  # on a grid, some at one place
            dot = {"id": len(dots), "plate": k, "kind": rng.choice(["ring", "disk"])}
            dot["xyz"] = plate["rotation"] @ xyz + plate["translation"]
            dots.append({**dot, "diameter": size * rng.uniform(0.02, 0.5)})
    if rng.random() < 0.5:  # one that is found where it is seen
        cells = rng.permutation(25)[: rng.integers(5, 13)]
        places = np.stack([cells % 5, cells // 5, np.full(len(cells), 2)], axis=-1) / 2 - 1
        places += rng.uniform(-0.08, 0.08, places.shape) * [1, 1, 0]
        places -= [0, 0, places[0, 2]]
        plates, dots = (
            plates[:1],
            [
                {"id": i, "kind": "disk" if i else "ring", "plate": 0, "xyz": size * xyz, "diameter": 0.24 * size}
                for i, xyz in enumerate(places)
            ],
        )
    body = {"name": name, "plates": plates, "dots": dots, "print_sigma": rng.choice([0, 1e-4])}
    body["light"] = bool(rng.random() < 0.2)
    if rng.random() < 0.5:
        bits = np.ones((6, 6), dtype=int)
        bits[1:-1, 1:-1] = rng.integers(0, 2, (4, 4))
        body["tags"] = [{"family": "f", "id": 0, "corners": CORNERS * size / 4, "bits": bits}]
    if rng.random() < 0.2:
        root = rng.standard_normal((12, 12)) * 1e-5
        body["joint_covariances"] = [{"dots": [0, 1, 2, 3], "matrix": root @ root.T}]
    return body


def random_camera(rng, height, width):
    focal = max(width, height) * rng.uniform(0.2, 5)
    numbers = width, height, focal, focal * rng.uniform(0.9, 1.1), rng.uniform(0, width), rng.uniform(0, height)
    if rng.random() < 0.2:
        grid = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 7), np.linspace(-0.4, 0.4, 5)), axis=-1)
        grid += rng.normal(0, rng.choice([0, 0.01, 1]), grid.shape)
        grid[rng.random(grid.shape[:2]) < 0.05] = np.nan
        return Camera(*numbers, "sampled", (), grid)
    model = rng.choice(list(LENSES))
    return Camera(*numbers, str(model), tuple(rng.normal(0, rng.choice([0.01, 1, 1e6]), LENSES[model])))


def checked(finding: Finding):
    assert np.isfinite(finding.pixels).all()
    if finding.ok:
        assert len(finding.ids) >= 4
        if finding.rotation is not None:
            assert np.allclose(finding.rotation @ finding.rotation.T, np.eye(3), atol=1e-6)
            assert np.isfinite(finding.translation).all()


def main(seed, rounds):
    rng, result = np.random.default_rng(seed), 0
    for _ in range(rounds):
        height, width = rng.choice(SIZES[-3:] if rng.random() < 0.5 else SIZES, 2)
        content = {"format": "markergen-detector", "version": 1, "unit": "m"}
        content["bodies"] = [random_body(rng, str(k)) for k in range(rng.integers(1, 4))]
        calibrated = rng.random() < 0.7
        camera = random_camera(rng, height, width) if calibrated else None
        calibration = np.eye(4 + len(camera.coefficients)) if calibrated and rng.random() < 0.3 else None
        try:
            detector = Detector(content, camera, camera_covariance=calibration, copies=int(rng.integers(1, 4)))
        except DescriptionError:
            continue
        findings = ()
        for _ in range(2):  # the second frame is tracked
            deadline = rng.choice([0.02, 0.2])
            findings = detector(random_image(rng, height, width, content["bodies"][0]), findings, deadline=deadline)
            for finding in findings:
                checked(finding)
                result += finding.ok
    print(f"{rounds} rounds, {result} found")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
