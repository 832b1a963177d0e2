"""Expected pose error over a working volume, from the joint covariance of a print's dots and of the camera.

To first order the error of an estimate that weights image points by W is G' e with G = W J (J'WJ)^-1, J the pose
Jacobian, and e the errors of the image points: the image's noise, and J_q dq for errors dq of dots and camera. So its
covariance is G' S G + T C T', T = G' J_q, with C the covariance of dots and camera together: an error that all poses
share is not averaged away by dots that err together.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from markergen.arrays import Array
from markergen.estimators.budget import pose_gain
from markergen.maths.conics import pose_rows
from markergen.maths.projection import perspective, to_camera
from markergen.model.camera import Camera


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """Expected pose error over the working volume, RMS over its poses, to first order.

    Attributes
    ----------
    rotation_deg, translation : float, deg and m
        From all sources together.
    image, print, camera : (rotation_deg, translation)
        From each alone; where dots and camera come from the same photographs, their errors are correlated.
    """

    rotation_deg: float
    translation: float
    image: tuple[float, float]
    print: tuple[float, float]
    camera: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """How errors of dots and camera turn into pose errors, over P working poses.

    Covariance (P, 6, 6) of the pose from the image's noise alone, and T (P, 6, 3 n + k), the pose error (w, dt) for
    errors of the n dots, m, and of the camera's k parameters; `dots` is 3 n.
    """

    image: Array
    transfer: Array
    dots: int

    @cached_property
    def matrices(self) -> tuple[Array, Array]:
        """M_rotation and M_translation (3 n + k, 3 n + k): mean squares are trace(M C), in rad^2 and m^2."""
        turns, moves = (
            transfer.reshape(-1, transfer.shape[-1]) for transfer in (self.transfer[:, :3], self.transfer[:, 3:])
        )
        return turns.T @ turns / len(self.transfer), moves.T @ moves / len(self.transfer)

    def expected(self, covariance: Array) -> ExpectedError:
        """Error for a covariance (3 n + k, 3 n + k) of dots and camera."""
        diagonal = np.einsum("pii->i", self.image) / len(self.image)
        image = np.array([diagonal[:3].sum(), diagonal[3:].sum()])
        products = [matrix * covariance for matrix in self.matrices]
        size = self.dots
        printed = np.array([product[:size, :size].sum() for product in products])
        camera = np.array([product[size:, size:].sum() for product in products])
        total = image + [product.sum() for product in products]
        # Rounding may leave a sum of nothing below 0.
        (rotation, translation), *parts = (
            (float(np.rad2deg(a)), float(b)) for a, b in np.sqrt(np.maximum([total, image, printed, camera], 0.0))
        )
        return ExpectedError(rotation, translation, *parts)


def sensitivity(
    points: Array, camera: Camera, rotation: Array, translation: Array, noise_px: float, blocks: Array
) -> Sensitivity:
    """Return the sensitivity of an estimate that weights dots by image and print, block by block.

    Parameters
    ----------
    points : array (n, 3), m
    rotation, translation : arrays (P, 3, 3) and (P, 3)
    noise_px : float
        Standard deviation of the image's noise, px.
    blocks : array (n, 3, 3), m^2
        Covariance of each dot, for the weights.
    """
    normalized = perspective(to_camera(points, rotation, translation))
    lens = camera.pixel_jacobian(normalized)
    rows = lens @ pose_rows(points, rotation, translation)
    dots = rows[..., 3:] @ rotation[:, None]
    spread = noise_px**2 * np.eye(2) + dots @ blocks @ dots.swapaxes(-1, -2)
    gain = pose_gain(rows, spread)
    count, n = rows.shape[:2]
    through = (gain.swapaxes(-1, -2) @ dots).swapaxes(1, 2).reshape(count, 6, 3 * n)
    lenses = np.einsum("pnia,pnik->pak", gain, camera.parameter_jacobian(normalized), optimize=True)
    image = noise_px**2 * np.einsum("pnia,pnib->pab", gain, gain, optimize=True)
    return Sensitivity(image, np.concatenate([through, lenses], axis=-1), 3 * n)
