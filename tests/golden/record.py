"""Records what markergen makes, to show that a change of its inside changes none of it.

    python tests/golden/record.py exports                 tests/golden/exports.json: hashes of exported files
    python tests/golden/record.py designs                 tests/golden/designs.json: designs, compared by tolerance
    python tests/golden/record.py results DIR [PART...]   everything that the public functions and commands give
    python tests/golden/record.py diff DIR DIR            what differs between two such folders

Only public functions and commands are called, so it runs with any checkout that PYTHONPATH names first.
"""

import contextlib
import hashlib
import inspect
import io
import json
import logging
import os
import re
import shutil
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

os.environ |= {"OPENBLAS_NUM_THREADS": "1", "COLUMNS": "120", "TERM": "dumb", "NO_COLOR": "1"}

import cv2
import numpy as np

import markergen as mg

HERE = Path(__file__).resolve().parent
INPUTS, EXPORTS, DESIGNS = HERE / "inputs", HERE / "exports.json", HERE / "designs.json"

POINTS = (".json", ".detector.json", ".csv", ".kalibr.yaml", ".opencv.yaml", ".ros2.yaml", ".apriltag.yaml")
SHEETS = (".pdf", ".svg", ".png", ".dxf")
KERNEL = (".fab.pdf", ".step", ".stp", ".brep", ".stl", ".3mf", ".glb", ".sdf", ".mjcf.xml", ".urdf")
EVERY = (*POINTS, *SHEETS, *KERNEL)
LIBRARIES = {"sheets": ("reportlab", "fonttools", "matplotlib", "numpy", "opencv-contrib-python-headless", "ezdxf"),
             "solids": ("cadquery-ocp", "reportlab", "fonttools", "matplotlib", "numpy")}  # fmt: skip
"""Libraries on which the bytes of drawings and of solids depend."""

QUICK = {"engrave": False, "dpi": 150}
"""Options of all cases of exports but those that set them: what is engraved takes the kernel seconds."""

PLATE = {"thickness": "5mm", "edge": "16mm", "chamfer": "0.5mm", "mount": ["4xM3c@140mm/45"], "dowel": ["2x4mm@130mm"]}
CASES: list[tuple[str, str, dict, tuple[str, ...]]] = [
    *((name, name, {}, EVERY) for name in ("disk", "tagged", "pad", "relief", "light", "measured", "cube", "wall")),
    *((f"disk colors {number}", "disk", {"colors": colors}, (".pdf", ".svg", ".png"))
      for number, colors in enumerate(("inverted", "#003366,#ffee99", "black,cut:CutContour"))),
    ("disk on tiles", "disk", {"paper": "100x140mm", "overlap": "12mm", "margin": "8mm"}, (".pdf",)),
    ("disk on letter", "disk", {"paper": "letter", "orientation": "landscape"}, (".pdf", ".svg", ".png")),
    ("pad on tiles", "pad", {"paper": "A4"}, (".pdf",)),
    ("several on A3", "disk tagged light", {"paper": "A3", "colors": "black"}, (".pdf",)),
    ("several on A5", "disk disk", {"paper": "A5"}, (".pdf",)),
    ("measured, compensated", "measured", {"compensate": True}, (".pdf", ".svg", ".png")),
    ("disk on a plate", "disk", PLATE, (".dxf", ".fab.pdf", ".step", ".stl")),
    ("disk engraved", "disk", {"engrave": True}, (".step", ".stl")),
    *((f"tagged by {process}", "tagged", {"process": process}, (".dxf", ".fab.pdf", ".step", ".stl"))
      for process in ("cnc", "dome", "laser", "print")),
    ("disk through", "disk", {"process": "cnc", "through": True}, (".dxf", ".fab.pdf", ".step")),
    ("disk pressed", "disk", {"process": "cnc", "fit": "press", "depth": "1mm", "tool": "2mm"}, (".fab.pdf", ".step")),
    ("disk of balls", "disk", {"process": "dome", "dome": "ball"}, (".step", ".stl")),
    ("disk in steel", "disk", {"material": "1.4301", "general_tolerance": "ISO 2768-fH", "paper": "A3"}, (".fab.pdf",)),
    ("disk coarse", "disk", {"tolerance": "50um", "gap": "0.1mm"}, (".stl", ".3mf", ".glb")),
    ("relief with draft", "relief", {"draft": 5, "foot": "2mm"}, (".fab.pdf", ".step", ".stl")),
    ("cube as a net", "cube", {"net": True}, (".pdf", ".svg", ".png")),
    ("cube by cnc", "cube", {"process": "cnc"}, (".fab.pdf", ".step", ".stl")),
    ("wall by laser", "wall", {"process": "laser", "thickness": "4mm"}, (".fab.pdf", ".step", ".stl")),
    ("wall on A5", "wall", {"paper": "A5"}, (".pdf",)),
]  # fmt: skip
"""Name, inputs, options and suffixes of exports."""

NEAR = "cone:distance=0.3..1m,tilt=0..60,count=60"
BY_IMAGE = {"noise_model": "image", "print_sigma": "0.1mm", "poses": NEAR}
L_SHAPE = """<svg xmlns="http://www.w3.org/2000/svg" width="120mm" height="120mm" viewBox="0 0 120 120">
<path d="M0,0 H120 V50 H50 V120 H0 Z M12,20 a8,8 0 1 0 16,0 a8,8 0 1 0 -16,0 Z" fill-rule="evenodd"/></svg>"""
DESIGN_CASES: dict[str, dict] = {
    "pentagon": {"n": 5, "restarts": 2},
    "rotation": {"n": 7, "objective": "rotation", "poses": NEAR, "restarts": 3},
    "translation": {"n": 6, "objective": "translation", "poses": NEAR, "restarts": 3, "seed": 4},
    "homography": {"n": 8, "objective": "homography", "radius": "80mm", "poses": NEAR, "restarts": 2},
    "condition": {"n": 6, "objective": "condition", "coordinates": "metric", "poses": NEAR, "restarts": 2},
    "weighted": {"n": 6, "objective": "pose + 0.5 rotation", "poses": NEAR, "restarts": 2},
    "bounded": {"n": 6, "objective": "pose, rotation <= 1.05 ngon", "poses": NEAR, "restarts": 2},
    "worst-pose": {"n": 5, "aggregate": "max", "poses": NEAR, "restarts": 2},
    "worst-tenth": {"n": 5, "aggregate": "cvar:0.9", "poses": "paper-roll", "restarts": 2},
    "keep-outs": {"n": 9, "boundary": "rect:160mmx100mm", "dot": "10mm", "gap": "3mm", "poses": NEAR, "restarts": 2,
                  "keep_out": ["circle:8mm@30mm,-20mm", "rect:40mmx20mm@-30mm,10mm"], "corner_radius": "4mm"},
    "drawing": {"n": 7, "boundary": "l-shape.svg", "dot": "12mm", "poses": NEAR, "restarts": 2},
    "family": {"n": 8, "radius": "70mm", "tag": "aruco:DICT_4X4_50:7", "ids": "3-5", "poses": NEAR, "restarts": 2},
    "keyless": {"n": 7, "radius": "70mm", "dot": "12mm", "asymmetric": 0.5, "poses": NEAR, "restarts": 2},
    "relief": {"n": 6, "radius": "60mm", "dot": "12mm", "relief": "25mm", "poses": NEAR, "restarts": 1},
    "survive": {"n": 6, "survive": 1, "poses": NEAR, "restarts": 2},
    "dot-size": {"n": 6, "radius": "70mm", "dot": "auto", "restarts": 2, **BY_IMAGE},
    "image-noise": {"n": 5, "radius": "70mm", "image_noise": "blur_px=1,noise_grey=4", "restarts": 2, **BY_IMAGE},
    "dot-count": {"n": "auto", "radius": "60mm", "restarts": 1, **BY_IMAGE},
    "target": {"target": "0.3deg@0.6m", "radius": "100mm", "restarts": 1},
    "points": {"points": "0mm,40mm;38mm,12mm;24mm,-32mm;-24mm,-32mm;-38mm,12mm", "radius": "60mm", "dot": "14mm"},
    "fit": {"n": 5, "radius": "fit", "paper": "A5", "poses": NEAR, "restarts": 1},
    "inverted": {"n": 5, "radius": "60mm", "colors": "inverted", "poses": NEAR, "restarts": 2},
    "desk-a4": {"template": "desk-a4", "restarts": 2},
    "thermal": {"template": "thermal", "restarts": 2},
}  # fmt: skip
PAD_CASES: dict[str, dict] = {
    "near-to-far": {"n": "auto", "radius": "150mm", "poses": "cone:distance=0.15m..3m,tilt=0..45,count=60",
                    "restarts": 1},
    "rectangle": {"n": "auto", "boundary": "rect:300mmx200mm", "poses": "cone:distance=0.2m..5m,tilt=0..50,count=80",
                  "print_sigma": "0.2mm", "restarts": 1, "seed": 2},
    "landing-pad": {"template": "landing-pad", "poses": "cone:distance=0.3m..10m,tilt=0..45,count=100", "restarts": 1},
    "drone-pad": {"template": "drone-pad", "restarts": 1},
}  # fmt: skip
AROUND = "sphere:distance=0.3..0.8m,count=40"
RIG_CASES: dict[str, tuple[str, dict]] = {
    "cube": ("cube", {"n": 5, "poses": AROUND, "restarts": 1}),
    "cube-tags": ("cube", {"n": 4, "edge": "60mm", "tag": "apriltag:36h11:10", "poses": AROUND, "restarts": 1}),
    "prism": ("prism:3", {"n": 5, "poses": AROUND, "without": ["-z"], "restarts": 1}),
    "wall": ("wall 2x2", {"n": 5, "poses": "cone:distance=1..2m,tilt=0..60,count=40", "restarts": 1}),
    "pair-tags": ("pair", {"plate": "100mm", "n": 6, "tag": "aruco:DICT_4X4_50", "objective": "rotation",
                           "poses": "cone:distance=0.3..0.8m,tilt=0..60,count=30", "restarts": 1}),
    "template-cube": ("", {"template": "cube", "n": 4, "poses": AROUND, "without": ["-z", "+x"], "restarts": 1}),
    "template-wall": ("", {"template": "wall", "n": 4, "restarts": 1}),
}  # fmt: skip

TIMES = re.compile(r"^found in .*\n?| +\d+ ms$", re.MULTILINE)
"""Times, which differ from run to run: in text, and by their keys."""

TIMED = ("seconds", "cpu_s", "cpu_ms", "ms")


class Warned(logging.Handler):
    """Keeps what the library warns of."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.lines = []

    def emit(self, record):
        self.lines.append(record.getMessage())


@contextlib.contextmanager
def in_folder():
    """Work in a folder of its own, so that no result has a path."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(before)


def versions(part):
    def version_of(library):
        try:
            return version(library)
        except PackageNotFoundError:
            return "none"

    return {library: version_of(library) for library in LIBRARIES[part]}


def exported(inputs, suffix, options):
    """Contents by name of what one export writes, and its notes; the error if it is refused."""
    stem, paths = "-".join(inputs), [INPUTS / f"{name}.json" for name in inputs]
    with in_folder() as folder:
        try:
            written = mg.export(paths, f"{stem}{suffix}", **QUICK | options)
        except mg.MarkergenError as error:
            return {}, [str(error)]
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        return files, [f"{item.path.name}: {note}" for item in written for note in item.notes]


def table(suffixes, cases=None):
    """Hashes and sizes by case, suffix and file; an empty entry is refused."""
    return {
        case: {
            suffix: {
                name: [hashlib.sha256(data).hexdigest(), len(data)]
                for name, data in exported(names.split(), suffix, options)[0].items()
            }
            for suffix in taken
            if suffix in suffixes
        }
        for case, names, options, taken in CASES
        if (cases is None or case in cases) and not set(suffixes).isdisjoint(taken)
    }


def record_exports():
    sheets, solids = table((*POINTS, *SHEETS)), table(KERNEL)
    parts = {"sheets": sheets, "solids": solids}
    content = {part: {"versions": versions(part), "exports": cases} for part, cases in parts.items()}
    text = json.dumps(content, indent=1)
    EXPORTS.write_text(re.sub(r'\[\s+"(\w+)",\s+(\d+)\s+\]', r'["\1", \2]', text) + "\n")


def designed(options):
    """A design, made in a folder with the drawing that one of them takes."""
    with in_folder() as folder:
        (folder / "l-shape.svg").write_text(L_SHAPE)
        return mg.design(**options)


def reference(design):
    """Places of the dots and criteria, of what a test compares by tolerance."""
    result, marker = json.loads(design.to_json()), saved(design.marker)
    points = [[point[axis] for axis in "xyz"] + [point["feature"]["diameter"]] for point in marker["control_points"]]
    return {"value": result["value"], "criteria": result["criteria"]["design"], "points": points}


def saved(thing):
    """JSON of a marker, rig or camera, as its file has it."""
    with in_folder():
        thing.save("saved.json")
        return json.loads(Path("saved.json").read_text())


def record_designs():
    result = {name: reference(designed(options)) for name, options in DESIGN_CASES.items()}
    text = re.sub(
        r"\[\s+([-\d.e, \n]+?)\s+\]", lambda row: "[" + " ".join(row[1].split()) + "]", json.dumps(result, indent=1)
    )
    DESIGNS.write_text(text + "\n")


def timeless(value):
    if isinstance(value, dict):
        return {key: timeless(item) for key, item in value.items() if key not in TIMED}
    return [timeless(item) for item in value] if isinstance(value, list) else value


class Folder:
    """Where results go."""

    def __init__(self, path):
        self.path, self.warned = path, Warned()
        logging.getLogger("markergen").addHandler(self.warned)

    def write(self, name, content):
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    def json(self, name, value):
        self.write(f"{name}.json", json.dumps(timeless(value), indent=1) + "\n")

    def result(self, name, result):
        """What a function gives, for programs and for people, with what it warned of."""
        self.json(name, json.loads(result.to_json()))
        warned = "".join(f"warning: {line}\n" for line in self.warned.lines)
        self.warned.lines.clear()
        self.write(f"{name}.txt", TIMES.sub("", str(result)) + "\n" + repr(result) + "\n" + warned)

    def command(self, name, *arguments, outputs=()):
        """Status and what a command prints; files that it writes."""
        from markergen.cli import main

        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                status = main(list(arguments))
            except SystemExit as stopped:
                status = stopped.code
        self.warned.lines.clear()
        text = f"$ markergen {' '.join(arguments)}\n{out.getvalue()}\n[stderr]\n{err.getvalue()}\n[status {status}]\n"
        self.write(f"{name}.txt", TIMES.sub("", text))
        for output in outputs:
            self.write(f"{name}/{output}", Path(output).read_bytes())


def interface(folder):
    """Public names, their signatures, and the help of every command."""
    names = {}
    for name in sorted(mg.__all__):
        thing = getattr(mg, name)
        members = [member for member in dir(thing) if not member.startswith("_")] if inspect.isclass(thing) else []
        signature = (
            [str(parameter) for parameter in inspect.signature(thing).parameters.values()] if not members else []
        )
        names[name] = {"parameters": signature, "members": members}
    folder.json("names", names)
    folder.command("help", "--help")
    commands = ("design", "rig", "export", "validate", "compare", "verify", "calibrate", "detect", "rescale", "study",
                "templates", "studio")  # fmt: skip
    for command in commands:
        folder.command(f"help-{command}", command, "--help")
    folder.command("templates", "templates")


def exports(folder):
    for case, names, options, taken in CASES:
        notes = []
        for suffix in taken:
            files, message = exported(names.split(), suffix, options)
            notes += [f"{suffix} {sentence}\n" for sentence in message]
            for name, data in files.items():
                folder.write(f"{case.replace(' ', '-')}/{suffix[1:]}/{name}", data)
        folder.write(f"{case.replace(' ', '-')}/notes.txt", "".join(notes))
    folder.warned.lines.clear()


def designs(folder):
    for name, options in DESIGN_CASES.items():
        design = designed(options)
        folder.result(name, design)
        for number, marker in enumerate(design.markers):
            folder.json(f"{name}.marker-{number}", saved(marker))
    with in_folder():
        outputs = ("marker.json", "marker.svg", "trace.csv", "coverage.svg", "result.json")
        folder.command("command", "design", "--n", "6", "--radius", "60mm", "--poses", NEAR, "--restarts", "2",
                       "-o", "marker.svg", "--trace", "trace.csv", "--coverage", "coverage.svg", "--json",
                       "result.json", outputs=outputs)  # fmt: skip
        folder.command("refused", "design", "--n", "3")
        folder.command("crowded", "design", "--n", "60", "--radius", "30mm", "--dot", "10mm")


def pads(folder):
    for name, options in PAD_CASES.items():
        design = mg.design(**options)
        folder.result(name, design)
        folder.json(f"{name}.marker", saved(design.marker))


def rigs(folder):
    for name, (shape, options) in RIG_CASES.items():
        design = mg.rig(shape, **options)
        folder.result(name, design)
        folder.json(f"{name}.rig", saved(design.rig))
    with in_folder():
        folder.command("command", "rig", "pair", "--plate", "80mm", "--n", "4", "--restarts", "1", "--poses",
                       "cone:count=20", "-o", "rig.svg", outputs=("rig.json", "rig.svg"))  # fmt: skip


VALIDATIONS = {
    "disk": ("disk", {"stress": True, "trials_for_all": True, "scale_sigma": 0.001}),
    "tagged": ("tagged", {"poses": NEAR, "hide": 1, "background": "clutter", "optics": "blur_px=1,noise_grey=3"}),
    "measured": ("measured", {"poses": NEAR}),
    "relief": ("relief", {"poses": NEAR}),
    "pad": ("pad", {}),
    "cube": ("cube", {"optics": "blur_px=1"}),
    "wall": ("wall", {"print_sigma": "0.2mm"}),
}


def validations(folder):
    for name, (marker, options) in VALIDATIONS.items():
        with in_folder():
            validation = mg.validate(
                INPUTS / f"{marker}.json", runs=20, views=4, workers=1, report="report.html", **options
            )
            folder.result(name, validation)
            folder.write(f"{name}.html", Path("report.html").read_bytes())
    with in_folder():
        shutil.copy(INPUTS / "disk.json", "disk.json")
        folder.command("command", "validate", "disk.json", "--runs", "10", "--views", "3", "--workers", "1",
                       "--fail-if", "estimators.lm.failure_rate > 0")  # fmt: skip


CAMERA = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}


def rotation_of(vector):
    return cv2.Rodrigues(np.asarray(vector, float))[0]


def photograph(plates, rotation, translation, rng, fine=6, blur=0.7, noise=1.5):
    """Return what a camera sees of dots on plates, each (rotation, translation, dots (n, 4): x, y, radii in m)."""
    width, height = CAMERA["width"], CAMERA["height"]
    axis = [(np.arange(fine * size) + 0.5) / fine - 0.5 for size in (width, height)]
    x, y = np.meshgrid((axis[0] - CAMERA["cx"]) / CAMERA["fx"], (axis[1] - CAMERA["cy"]) / CAMERA["fy"])
    levels = np.full(x.shape, 225.0, np.float32)
    for R, place, dots in plates:
        whole, origin = rotation @ R, rotation @ place + translation
        for left, bottom, outer, inner in dots:
            middle = whole @ [left, bottom, 0] + origin
            column, row = (CAMERA[f"f{k}"] * middle[i] / middle[2] + CAMERA[f"c{k}"] for i, k in enumerate("xy"))
            reach = 1.5 * CAMERA["fx"] * outer / (middle[2] - outer) + 2
            window = tuple(slice(max(0, int(fine * (at - reach))), max(0, int(fine * (at + reach))))
                           for at in (row, column))  # fmt: skip
            ray = np.stack([x[window], y[window], np.ones_like(x[window])], axis=-1)
            depth = (origin @ whole[:, 2]) / (ray @ whole[:, 2])
            plane = (depth[..., None] * ray - origin) @ whole
            radius = np.hypot(plane[..., 0] - left, plane[..., 1] - bottom)
            levels[window][(radius < outer) & (radius >= inner)] = 30
    image = cv2.GaussianBlur(cv2.resize(levels, (width, height), interpolation=cv2.INTER_AREA), (0, 0), blur)
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def printed(points, rng, sigma=1e-4):
    """Dots as a printer puts them, with errors of 0.1 mm."""
    rows = [[p["x"], p["y"], p["feature"]["diameter"] / 2, p["feature"]["inner_diameter"] / 2] for p in points]
    return np.array(rows) + np.pad(rng.normal(0, sigma, (len(rows), 2)), ((0, 0), (0, 2)))


def photographs(plates, count, distance, rng):
    for k in range(count):
        tilt = np.deg2rad(15 + 40 * (k % 4) / 3) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        rotation = rotation_of([0, 0, 1.1 * k]) @ rotation_of(tilt) @ np.diag([1.0, -1.0, -1.0])
        image = photograph(plates, rotation, np.array([0.01, -0.01, distance * (1 + 0.1 * (k % 3))]), rng)
        cv2.imwrite(f"photos/{k:02}.png", image)


def calibrations(folder):
    rng, flat = np.random.default_rng(0), (np.eye(3), np.zeros(3))
    camera = mg.Camera(*CAMERA.values())
    with in_folder():
        Path("photos").mkdir()
        shutil.copy(INPUTS / "disk.json", "disk.json")
        camera.save("camera.yaml")
        photographs([(*flat, printed(saved_points("disk"), rng))], 10, 0.35, rng)
        calibration = mg.calibrate("disk.json", "photos", camera, workers=1,
                             save=["measured.json", "report.html"])  # fmt: skip
        folder.result("print", calibration)
        for name in ("measured.json", "report.html"):
            folder.write(f"print/{name}", Path(name).read_bytes())
        calibration = mg.calibrate("disk.json", "photos", workers=1, save=["camera.yaml.new.yaml"])
        folder.result("print-and-camera", calibration)
        folder.write("print-and-camera/camera.yaml", Path("camera.yaml.new.yaml").read_bytes())
        folder.command("command", "calibrate", "disk.json", "photos", "--camera", "camera.yaml", "--geometry",
                       "nominal", "--workers", "1")  # fmt: skip
        folder.command("detect", "detect", "photos", "--marker", "disk.json", "--camera", "camera.yaml", "--json", "-")
    with in_folder():
        Path("photos").mkdir()
        content = json.loads((INPUTS / "wall.json").read_text())
        plates = []
        for item in content["markers"]:
            rotation, place = pose_of(item)
            plates.append((rotation, place, printed(item["marker"]["control_points"], rng)))
        photographs(plates, 10, 0.6, rng)
        calibration = mg.calibrate(INPUTS / "wall.json", "photos", camera, workers=1)
        folder.result("wall", calibration)


def saved_points(name):
    return json.loads((INPUTS / f"{name}.json").read_text())["control_points"]


def pose_of(placed):
    """Rotation and translation of a marker of a rig.json."""
    return np.array(placed["T_rig_marker"]["rotation"]), np.array(placed["T_rig_marker"]["translation"])


def verifications(folder):
    sys.path.append(str(HERE.parent / "support"))
    import damaged_sheets
    import spoiled_solids

    marker = INPUTS / "sheet.json"

    def verified(name, suffix, data, judged=marker):
        path = Path(f"{name.replace(' ', '-').lower()}{suffix}")
        path.write_bytes(data)
        try:
            folder.result(f"{suffix[1:]}-{path.name.removesuffix(suffix)}", mg.verify(judged, path))
        except mg.MarkergenError as error:
            folder.write(f"{suffix[1:]}-{path.name.removesuffix(suffix)}.txt", f"{error}\n")

    with in_folder():
        mg.export(marker, *(f"a{suffix}" for suffix in EVERY), dpi=damaged_sheets.DPI, engrave=False)
        for suffix in EVERY:
            data = Path(f"a{suffix}").read_bytes()
            verified("as it is", suffix, data)
            verified("cut short", suffix, data[: len(data) * 2 // 3])
            for damage, (change, *_) in damaged_sheets.DAMAGE.get(suffix, {}).items():
                verified(damage, suffix, change(data.decode()).encode() if suffix == ".svg" else change(data))
            if suffix in spoiled_solids.SOLIDS:
                verified("larger", suffix, spoiled_solids.resized(data, suffix, 1.01))
                verified("of another marker", suffix, data, INPUTS / "disk.json")
                if suffix != ".step":
                    verified("stretched", suffix, spoiled_solids.resized(data, suffix, 1.02, 1.0, 1.0))
        corners = spoiled_solids.triangles(Path("a.stl").read_bytes())
        verified("open", ".stl", spoiled_solids.stl(corners[1:]))
        verified("as text", ".stl", spoiled_solids.stl_of_text(corners))
        verified("of another marker", ".pdf", Path("a.pdf").read_bytes(), INPUTS / "disk.json")
    with in_folder():
        for rig in ("cube", "wall"):
            for suffix in (".json", ".pdf", ".svg", ".png", ".step", ".stl", ".3mf", ".glb", ".urdf", ".mjcf.xml"):
                mg.export(INPUTS / f"{rig}.json", f"{rig}{suffix}", **QUICK)
                data = Path(f"{rig}{suffix}").read_bytes()
                verified(f"{rig} as it is", suffix, data, INPUTS / f"{rig}.json")
                if suffix in spoiled_solids.SOLIDS:
                    verified(
                        f"{rig} larger", suffix, spoiled_solids.resized(data, suffix, 1.01), INPUTS / f"{rig}.json"
                    )
            verified(f"{rig} of another rig", suffix, data, INPUTS / ("wall.json" if rig == "cube" else "cube.json"))
        shutil.copy(INPUTS / "disk.json", "disk.json")
        mg.export("disk.json", "disk.svg")
        folder.command("command", "verify", "disk.json", "disk.svg", "--json", "-")


def comparisons(folder):
    rivals = ("ngon:5", "square", "aruco:DICT_4X4_50:3")
    with in_folder():
        for name in ("disk.json", "cube.json"):
            shutil.copy(INPUTS / name, name)
        folder.result("compare", mg.compare("disk.json", *rivals, views=4, poses=NEAR, workers=1))
        folder.result("rigs", mg.compare("cube.json", "aruco:DICT_4X4_50", views=2, poses=AROUND, workers=1))


PARTS = (interface, exports, designs, pads, rigs, validations, calibrations, verifications, comparisons)


def record_results(target, *names):
    for part in PARTS:
        if not names or part.__name__ in names:
            began = time.process_time()
            part(Folder(target / part.__name__))
            count = sum(path.is_file() for path in (target / part.__name__).rglob("*"))
            print(f"{part.__name__}: {count} files, {time.process_time() - began:.0f} s", flush=True)


def unequal(one, other, path=""):
    """Lines about the values of two JSON files that differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            if key not in one or key not in other:
                yield f"{path}.{key}: only in the {'second' if key in other else 'first'}"
            else:
                yield from unequal(one[key], other[key], f"{path}.{key}")
        if list(one) != list(other) and set(one) == set(other):
            yield f"{path}: the keys have another order"
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, pair in enumerate(zip(one, other, strict=True)):
            yield from unequal(*pair, f"{path}[{k}]")
    elif type(one) in (int, float) and type(other) in (int, float):
        if one != other:
            share = abs(one - other) / max(abs(one), abs(other))
            yield f"{path}: {one!r} and {other!r}, relative difference {share:.1e}"
    elif one != other or type(one) is not type(other):
        yield f"{path}: {str(one)[:100]!r} and {str(other)[:100]!r}"


def differences(first, second):
    """Lines about files of two folders that differ."""
    names = sorted(
        {path.relative_to(folder) for folder in (first, second) for path in folder.rglob("*") if path.is_file()}
    )
    for name in names:
        paths = first / name, second / name
        missing = [path for path in paths if not path.is_file()]
        if missing:
            yield f"{name}: only in {second if missing[0] == paths[0] else first}"
            continue
        one, other = (path.read_bytes() for path in paths)
        if one == other:
            continue
        yield f"{name}: {len(one)} and {len(other)} bytes differ"
        if name.suffix == ".json":
            lines = list(unequal(json.loads(one), json.loads(other)))
            yield from (f"    {line}" for line in lines[:20])
            if len(lines) > 20:
                yield f"    and {len(lines) - 20} more"
        elif name.suffix in (".txt", ".svg", ".csv", ".yaml", ".urdf", ".sdf", ".xml", ".step"):
            import difflib

            rows = difflib.unified_diff(one.decode().splitlines(), other.decode().splitlines(), lineterm="", n=0)
            changed = [row for row in rows if row[:1] in "+-" and row[:3] not in ("+++", "---")]
            yield from (f"    {row[:160]}" for row in changed[:12])
            if len(changed) > 12:
                yield f"    and {len(changed) - 12} more lines"


def main(mode="", *arguments):
    if mode == "exports":
        record_exports()
    elif mode == "designs":
        record_designs()
    elif mode == "results" and arguments:
        print(f"markergen of {Path(mg.__file__).parent}")
        record_results(Path(arguments[0]).resolve(), *arguments[1:])
    elif mode == "diff" and len(arguments) == 2:
        lines = list(differences(*map(Path, arguments)))
        print("\n".join(lines) or "no difference")
        return bool(lines)
    else:
        print(__doc__)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
