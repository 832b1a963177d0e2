"""How long it takes to make solids and meshes, whole processes, beside the CAD kernel alone in the same run.

The kernel's own work is to be imported, to cut as many pockets from a plate as the marker has dots, and to write STEP.

python -m benchmarks.solids
"""

import tempfile
from pathlib import Path

from benchmarks.loading import MARKER, seconds

ROUNDS = 5

KERNEL = """
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
from OCP.TopTools import TopTools_ListOfShape

plates, pockets, cut, writer = TopTools_ListOfShape(), TopTools_ListOfShape(), BRepAlgoAPI_Cut(), STEPControl_Writer()
plates.Append(BRepPrimAPI_MakeBox(gp_Pnt(0, 0, -3), gp_Pnt(240, 40, 0)).Shape())
for k in range(12):
    pockets.Append(BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(20 * k + 10, 20, -0.6), gp_Dir(0, 0, 1)), 5, 0.6).Shape())
cut.SetArguments(plates)
cut.SetTools(pockets)
cut.Build()
writer.Transfer(cut.Shape(), STEPControl_StepModelType.STEPControl_AsIs)
writer.Write(FOLDER + "/kernel.step")
"""
EXPORT = f"from markergen.cli import main; main(['export', {str(MARKER)!r}, '--process', PROCESS, OUTPUTS])"

CASES: dict[str, str | tuple[str, ...]] = {
    "import OCP": "import OCP",
    "the kernel alone": KERNEL,
    "cnc .step": ("cnc", ".step"),
    "cnc .stl": ("cnc", ".stl"),
    "fdm, eight formats": ("fdm", ".step", ".brep", ".stl", ".3mf", ".glb", ".sdf", ".urdf", ".fab.pdf"),
}
FLOOR = "the kernel alone"


def code(case: str | tuple[str, ...], folder: str) -> str:
    """Program of a case that writes to a folder, in silence."""
    if isinstance(case, str):
        work = case.replace("FOLDER", repr(folder))
    else:
        process, *suffixes = case
        outputs = ", ".join(f"'-o', {folder + '/m' + suffix!r}" for suffix in suffixes)
        work = EXPORT.replace("PROCESS", repr(process)).replace("OUTPUTS", outputs)
    return f"import os\nos.dup2(os.open(os.devnull, os.O_WRONLY), 1)\n{work}"


def main() -> None:
    """Print the least of several rounds, taken in turn so that other work is unfair to none."""
    with tempfile.TemporaryDirectory() as folder:
        works = {name: code(case, folder) for name, case in CASES.items()}
        # The first of them compiles, and so is never the least.
        times = [{name: seconds(work, folder) for name, work in works.items()} for _ in range(ROUNDS)]
        assert (Path(folder) / "m.fab.pdf").exists()
    least = {name: min(time[name] for time in times) for name in CASES}
    print(f"{'':20} {'s':>6} {'over kernel':>11}")
    for name, value in least.items():
        print(f"{name:20} {value:6.3f} {value / least[FLOOR]:11.2f}")


if __name__ == "__main__":
    main()
