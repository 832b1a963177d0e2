"""Grey levels of a blurred ellipse and their derivatives, the model that dots are fitted with."""

import numpy as np

from markergen.arrays import Array

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()

_SHARP = 0.1
"""Curvature of the tips, in units of 1/blur, above which the expansion in it is too inaccurate."""

BOXED = 0.65
"""Blur, in px with the pixel's own area, below which that area's square shape matters; above it, the result differs
from a Gaussian by at most 0.0013 of the contrast."""

_PIXEL_VARIANCE = 1 / 12
_LEAST_SIDE, _LEAST_LENS = 0.02, 0.05
"""Lower limits, in px, for a pixel's width along the edge's normal and for a lens's blur: smaller values change
nothing, and would divide zero by zero."""

_TINY = 1e-12

CONSTANTS = [_SHARP, BOXED, _LEAST_SIDE, _LEAST_LENS, _TINY]
"""What the compiled fit takes from here, in its order; further below, the quadrature's nodes and weights."""
QUADRATURE = [*_NODES, *_WEIGHTS]


def pixel_edge(depth: Array, normal: tuple[Array, Array], blur: Array) -> tuple[Array, Array, Array]:
    """Return the share of ink that square pixels see of a straight edge through a Gaussian blur, and its derivatives.

    The result is exact. Along the normal n the square is two boxes, of widths |n_x| and |n_y|. Averaging over a box is
    the difference of an integral at its ends, so the share is the second difference of H over |n_x n_y|, where
    H'' = F(z/s) is the edge behind a lens of blur s: H = [(z^2 + s^2) F + z s f]/2, H' = z F + s f, f = F'. Without a
    lens, a Gaussian of the same variance is off by 0.06 of the contrast along rows and columns, and by 0.02 along
    diagonals.

    Parameters
    ----------
    depth : array (N,), px
        Distance of the pixels from the edge, positive inside.
    normal : two arrays (N,)
        Unit normal.
    blur : array (N,), px
        Standard deviation including the pixel's own area, as for `blurred_ellipse`.

    Returns
    -------
    ink : array (N,), 0 to 1
    slope : array (N,), 1/px
        d ink/d depth.
    by_square : array (N,), 1/px^2
        d ink/d blur^2: half of the second derivative with respect to depth, as in heat diffusion.
    """
    from scipy.special import ndtr

    lens = np.sqrt(np.maximum(blur * blur - _PIXEL_VARIANCE, _LEAST_LENS**2))
    width, height = (np.maximum(np.abs(each), _LEAST_SIDE) for each in normal)
    far, near = (width + height) / 2, (width - height) / 2
    z = depth + np.stack([far, -far, near, -near])
    t = z / lens
    step, bell = ndtr(t), np.exp(-0.5 * t * t) * (lens / np.sqrt(2 * np.pi))
    first = z * step + bell
    area = width * height
    ink, slope, bend = (
        (each[0] + each[1] - each[2] - each[3]) / area for each in (0.5 * (z * first + lens * lens * step), first, step)
    )
    return ink, slope, 0.5 * bend


def blurred_ellipse(
    x: Array, y: Array, shape: tuple[Array, Array, Array], blur: Array, tips: Array | None = None
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the share of ink of an ellipse seen through a Gaussian blur, and its derivatives.

    With M the symmetric matrix that maps the ellipse to the unit circle, rho = |M x| and F the normal distribution,
    the share is F(-e/s - k s/2): e is the distance from the outline to first order, (rho - 1)/|grad rho|, and k is the
    outline's curvature det(M)^2/|grad rho|^3, by which a blur s moves a convex edge inward. For sharp tips,
    a s > b^2/10 for semi-axes a > b, the blur is integrated instead: along the edge's normal in closed form, over the
    ellipse's chord, and along its tangent by Gauss-Hermite quadrature. Both are within 0.001 of the contrast (RMS) for
    b > 4 s; at b = 2 s the quadrature is off by 0.01, where the expansion would be off by 0.03. Where the pixel is most
    of the blur, the difference between its square and a Gaussian at a straight edge is added (`pixel_edge`).

    Parameters
    ----------
    x, y : arrays (N,), px
        Pixel coordinates relative to the ellipse's center.
    shape : m11, m12, m22, each (N,), 1/px
    blur : array (N,), px
        Standard deviation of the point spread function, including the pixel's own area.
    tips : array (N,), or None
        What the quadrature adds to the expansion, from a call for nearly the same ellipses; None to evaluate it.
        It takes several times as long as all else, and changes little between the last steps of a fit.

    Returns
    -------
    ink : array (N,), 0 to 1
    by_rho, by_blur : arrays (N,)
        d ink/d rho, and d ink/d blur in 1/px.
    direction : array (2, N)
        M x / rho: d rho/dx = M direction, d rho/dM = direction x'.
    tips : array (N,)
        As above, 0 where the expansion is good.
    """
    from scipy.special import ndtr

    m11, m12, m22 = shape
    u = m11 * x + m12 * y
    v = m12 * x + m22 * y
    rho = np.maximum(np.sqrt(u * u + v * v), _TINY)
    u, v = u / rho, v / rho
    gradient_x, gradient_y = m11 * u + m12 * v, m12 * u + m22 * v
    determinant, trace = m11 * m22 - m12 * m12, m11 + m22
    # At the center itself rho has no direction; |grad rho| is at least the smaller eigenvalue >= det/trace everywhere.
    steepness = np.maximum(np.sqrt(gradient_x * gradient_x + gradient_y * gradient_y), determinant / trace)
    # Curvatures above 1/s, at the tips of thin ellipses, are out of the expansion's range.
    inward = np.minimum(determinant * determinant / (steepness * steepness * steepness) * blur / 2, 0.5)
    depth = (1 - rho) / (steepness * blur) - inward
    density = np.exp(-0.5 * depth * depth) / np.sqrt(2 * np.pi)
    # The derivatives neglect changes of |grad rho| and the curvature: these are of second order at the outline, and
    # affect only the path to the solution.
    by_rho = -density / (steepness * blur)
    by_blur = -density * (depth + 2 * inward) / blur
    ink = ndtr(depth)
    if tips is None:
        tips = np.zeros_like(x)
        steepest = trace / 2 + np.sqrt(np.maximum((m11 - m22) ** 2 / 4 + m12 * m12, 0))
        # a/b^2 from M's eigenvalues 1/a and 1/b, of which the second is the steepest.
        sharp = np.flatnonzero(blur * steepest * steepest * steepest > _SHARP * determinant)
        if len(sharp):
            normal = (gradient_x / steepness)[sharp], (gradient_y / steepness)[sharp]
            at = (u * rho)[sharp], (v * rho)[sharp]
            tips[sharp] = _chords(*at, *normal, (m11[sharp], m12[sharp], m22[sharp]), blur[sharp]) - ink[sharp]
    ink += tips
    boxed = np.flatnonzero(blur < BOXED)
    if len(boxed):
        own, inside, thin = blur[boxed], depth[boxed], 2 * inward[boxed]
        normal = (gradient_x / steepness)[boxed], (gradient_y / steepness)[boxed]
        share, slope, by_square = pixel_edge(inside * own, normal, own)
        ink[boxed] += share - ndtr(inside)
        by_rho[boxed] = -slope / steepness[boxed]
        by_blur[boxed] = 2 * own * by_square - thin * slope
    return ink, by_rho, by_blur, np.stack([u, v]), tips


def _chords(u: Array, v: Array, nx: Array, ny: Array, shape: tuple[Array, Array, Array], blur: Array) -> Array:
    """Integrate the blur over chords along the normal (nx, ny), through points near (u, v) = M x: the share of ink."""
    from scipy.special import ndtr

    m11, m12, m22 = shape
    along_u, along_v = (m11 * nx + m12 * ny) * blur, (m12 * nx + m22 * ny) * blur
    beside_u, beside_v = (m12 * nx - m11 * ny) * blur, (m22 * nx - m12 * ny) * blur
    square = np.maximum(along_u * along_u + along_v * along_v, _TINY)
    # |p + t along| = 1 with p = (u, v) + node * beside: t in units of the blur.
    slope0, slope1 = u * along_u + v * along_v, beside_u * along_u + beside_v * along_v
    level0, level1, level2 = u * u + v * v - 1, 2 * (u * beside_u + v * beside_v), beside_u**2 + beside_v**2
    ink = np.zeros_like(u)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        slope = slope0 + node * slope1
        root = slope * slope - square * (level0 + node * (level1 + node * level2))
        # A line that misses the ellipse has a chord of length zero.
        root = np.sqrt(np.maximum(root, 0))
        ink += weight * (ndtr((root - slope) / square) - ndtr((-root - slope) / square))
    return ink
