"""Outlines of boards, and those of their footprints, against areas by hand."""

import math

import numpy as np
import pytest
from drawings import area, read_outline, region

from markergen.read.outlines.boundary import read_contours

BOARD = """(kicad_pcb (version 20221018) (generator pcbnew)
 (layers (0 "F.Cu" signal) (44 "Edge.Cuts" user))
 (footprint "Hole" (layer "F.Cu") (at 20 10 90)
  (fp_circle (center 5 0) (end 6 0) (stroke (width 0.1) (type default)) (layer "Edge.Cuts")))
 (gr_line (start 0 0) (end 90 0) (layer "Edge.Cuts"))
 {corner}
 (gr_line (start 100 10) (end 100 50) (layer "Edge.Cuts"))
 (gr_line (start 100 50) (end 0 50) (layer "Edge.Cuts")) (gr_line (start 0 50) (end 0 0) (layer "Edge.Cuts"))
 (gr_text "a (quoted \\"bracket" (at 1 1) (layer "F.SilkS"))
 (gr_rect (start 10 30) (end 20 40) (layer "User.1"))
 (segment (start 1 1) (end 2 2) (layer "F.Cu")))"""
S = math.sqrt(0.5)
CORNERS = {
    "three points": f'(gr_arc (start 90 0) (mid {90 + 10 * S} {10 - 10 * S}) (end 100 10) (layer "Edge.Cuts"))',
    "an angle": "(gr_arc (start 90 10) (end 90 0) (angle 90) (layer Edge.Cuts))",
}


@pytest.mark.parametrize("corner", CORNERS)
def test_a_board_with_a_round_corner_and_a_hole_of_a_footprint(write, corner):
    hole, outer = read_contours(write(BOARD.format(corner=CORNERS[corner]), "board.kicad_pcb"))
    rings = read_outline(write(BOARD.format(corner=CORNERS[corner]), "board.kicad_pcb"))
    expected = 5000 - 100 + 25 * math.pi - math.pi
    assert area(rings) * 1e6 == pytest.approx(expected, abs=0.5)
    assert outer.has_arcs
    # Turned by 90 degrees counterclockwise on the screen, where y is down.
    np.testing.assert_allclose(hole.as_circle, (0.02, -0.005, 0.001), atol=1e-9)


def test_other_layers_and_shapes(write):
    text = BOARD.format(corner="")
    (square,) = read_outline(write(text, "b.kicad_pcb"), layer="User.1")
    assert area([square]) == pytest.approx(1e-4)
    shapes = """(footprint "Part" (fp_poly (pts (xy 0 0) (xy 10 0) (xy 10 10)) (layer "Edge.Cuts"))
      (fp_curve (pts (xy 20 0) (xy 20 8) (xy 30 8) (xy 30 0)) (layer "Edge.Cuts"))
      (fp_line (start 20 0) (end 30 0) (layer "Edge.Cuts")))"""
    rings = read_outline(write(shapes, "part.kicad_mod"))
    # The integral of y dx below the cubic.
    t = np.linspace(0, 1, 100_001)
    x = 20 * (1 - t) ** 3 + 60 * t * (1 - t) ** 2 + 90 * t**2 * (1 - t) + 30 * t**3
    y = 24 * t * (1 - t)
    assert region(rings).area * 1e6 == pytest.approx(50 + np.trapezoid(y, x), abs=0.1)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        (BOARD.format(corner="")[:-1], "complete parentheses"),
        ("(kicad_pcb (version 1))", "a closed outline"),
        (BOARD.format(corner=""), "--ignore-open"),
        ('(kicad_pcb (gr_line (start 0) (end 1 1) (layer "Edge.Cuts")))', "start with x and y"),
        ('(kicad_pcb (gr_curve (pts (xy 0 0)) (layer "Edge.Cuts")))', "four points of a curve"),
        ("(kicad_pcb " + "(" * 60, "at most 30 levels"),
    ],
)
def test_damaged_boards(refused, write, text, phrase):
    assert phrase in refused(write(text, "board.kicad_pcb"))


def test_an_unknown_layer_is_answered_with_those_of_the_file(refused, write):
    assert "'Edge.Cuts', 'User.1'" in refused(write(BOARD.format(corner=""), "b.kicad_pcb"), layer="Dwgs.User")
