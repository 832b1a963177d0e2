"""What the simulators' formats share: the mesh that they show, mass and moments, and a simple shape to bump into."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Self

import numpy as np
from numpy.typing import NDArray

from markergen.exporters import ExportOptions
from markergen.exporters.glb import write_glb
from markergen.exporters.meshes import MeshedPart, meshed
from markergen.model.marker import Marker

Array = NDArray[np.float64]

DENSITY = 1240.0
"""Of polylactide, the usual filament, in kg/m^3."""


@dataclass(frozen=True)
class Simulated:
    """A marker as a rigid body; m, kg, marker frame.

    Attributes
    ----------
    name : str
    mesh : str
        Path of the GLB, relative to the file that refers to it.
    glb : bytes
    mass : float
    center : array (3,)
        Of mass.
    inertia : array (3, 3)
        About the center of mass.
    low, high : array (3,)
        Corners of the box around it.
    round : bool
        Whether it is a cylinder about the z axis rather than that box.
    notes : tuple of str
    """

    name: str
    mesh: str
    glb: bytes
    mass: float
    center: Array
    inertia: Array
    low: Array
    high: Array
    round: bool
    notes: tuple[str, ...]

    @classmethod
    def of(cls, markers: Sequence[Marker], options: ExportOptions, suffix: str) -> Self:
        """Make a marker's body; raises as `meshed` does."""
        made, mesh = meshed(markers, options, suffix), f"meshes/{options.stem}.glb"
        points = np.concatenate([part.mesh.points for part in made.parts]) / 1e3
        mass, center, inertia = mass_of(made.parts)
        return cls(
            made.name,
            mesh,
            write_glb(made.parts, made.name),
            mass,
            center,
            inertia,
            points.min(axis=0),
            points.max(axis=0),
            [part.is_disk for part in made.made.parts if part.is_plate] == [True],
            (f"It shows {mesh} beside it, and weighs {mass * 1e3:.3g} g ({DENSITY:g} kg/m^3).", *made.notes),
        )

    @property
    def digest(self) -> str:
        """Of the GLB, so that it can be told whether it is the one that was meant."""
        return f"sha256 {sha256(self.glb).hexdigest()}"

    def collision(self) -> tuple[str, dict[str, str], Array]:
        """Shape to bump into: ``cylinder`` or ``box``, its measures, and where its middle is."""
        size, middle = self.high - self.low, (self.high + self.low) / 2
        if self.round:
            return "cylinder", {"radius": number(size[0] / 2), "length": number(size[2])}, middle
        return "box", {"size": numbers(size)}, middle

    def moments(self) -> dict[str, str]:
        """Entries of the inertia on and above its diagonal, by name: ``ixx`` and so on."""
        return {
            f"i{a}{b}": number(self.inertia[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
        }


def mass_of(parts: Sequence[MeshedPart]) -> tuple[float, Array, Array]:
    """Mass in kg, its center in m, and the inertia about that in kg m^2, of parts of `DENSITY`.

    A closed surface is a sum of tetrahedra from the origin, inside out where it faces the origin. One with the corners
    0, a, b, c has a sixth of det(a, b, c) as volume, and det/120 (aa' + bb' + cc' + ss') with s = a + b + c as second
    moment.
    """
    corners = np.concatenate([part.mesh.points[part.mesh.triangles] for part in parts]) / 1e3
    weight = DENSITY * np.linalg.det(corners)
    sums = corners.sum(axis=1)
    mass = float(weight.sum() / 6)
    center = weight @ sums / 24 / mass
    second = np.einsum("t,tci,tcj->ij", weight, corners, corners) + np.einsum("t,ti,tj->ij", weight, sums, sums)
    spread = second / 120 - mass * np.outer(center, center)
    return mass, center, np.trace(spread) * np.eye(3) - spread


def number(value: float) -> str:
    """Write a number with nine digits, and no -0."""
    return f"{round(float(value), 15) + 0.0:.9g}"


def numbers(values: Array) -> str:
    """Write several numbers with spaces between them."""
    return " ".join(number(value) for value in values)
