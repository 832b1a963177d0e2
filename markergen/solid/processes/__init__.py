"""Processes: ways to make the dots, the tag and the pillars of a marker; the plate is the same for all.

Each module puts its own into `markergen.model.fabrication.PROCESSES`.
"""

from dataclasses import dataclass

from markergen.solid.bodies import Body, Part


@dataclass(frozen=True)
class Made:
    """What a process makes of a marker; mm, marker frame, plain data.

    Attributes
    ----------
    parts : tuple of Part
        Beside the plate: ``dot-<id>``, ``dot-<id>-core``, ``tag-<k>``; `markergen.solid.make` puts the plates, of which
        all has been cut and to which all has been joined, before them.
    cut : tuple of Body
        From the plate and from what is added to it. They lie apart from each other, and inside of it or end at its
        surface.
    marked : tuple of Body
        Cut as well, and their floors are dark: engraved.
    add : tuple of Body
        Joined to the plate, on whose face they stand apart from each other: pillars.
    notes : tuple of str
        Sentences for the user, who sees them on the screen.
    lines : tuple of str
        Sentences for the workshop, on the fabrication sheet.
    tolerances : tuple of (what, how much)
        Rows for the fabrication sheet, such as ``("disc 36 mm", "h7: +0 / -0.025 mm")``.
    depth : float
        Of pockets, engraving or recess below the plane of their dots.
    face : float
        Height of the plate's face: 0, but below it where balls stand with their centers in the plane.
    """

    parts: tuple[Part, ...] = ()
    cut: tuple[Body, ...] = ()
    marked: tuple[Body, ...] = ()
    add: tuple[Body, ...] = ()
    notes: tuple[str, ...] = ()
    lines: tuple[str, ...] = ()
    tolerances: tuple[tuple[str, str], ...] = ()
    depth: float = 0.0
    face: float = 0.0
