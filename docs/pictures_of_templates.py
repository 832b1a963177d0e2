"""Draw every template: flat markers as SVG, rigs and reliefs as pictures of their solids.

python -m docs.pictures_of_templates docs/images/templates
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import markergen as mg
from docs.picture_of_a_solid import write_picture
from markergen.api.shipped import overview
from markergen.model.picture import svg

WIDTH = 360
"""Of a picture, in px."""


def draw(name: str, folder: Path) -> None:
    """Write the picture of a template; a search takes from 3 to 40 s."""
    rig = next(template for template in overview().templates if template.name == name).command == "rig"
    target: mg.Marker | mg.Rig = mg.rig(template=name).rig if rig else mg.design(template=name).marker
    if isinstance(target, mg.Marker) and not target.height:
        # Pages may be dark, dots are.
        flat = svg(target).replace(">", '><rect x="-1000" y="-1000" width="2000" height="2000" fill="#fff"/>', 1)
        (folder / f"{name}.svg").write_text(flat)
        return
    with TemporaryDirectory() as scratch:
        solid = Path(scratch) / "solid.glb"
        mg.export(target, solid)
        write_picture(solid, folder / f"{name}.png", WIDTH)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for each in overview().templates:
        print(each.name, flush=True)
        draw(each.name, folder)
