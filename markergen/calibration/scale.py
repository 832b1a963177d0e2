"""Scale of a print, which no photograph shows: from rulers along x and y, lengths between dots, or the design.

Photographs tell the ratio of the scales along x and y, far better than rulers do; what is left open is their mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment
from markergen.calibration.network import Length, Network
from markergen.defaults import RULER_SIGMA
from markergen.model.marker import Marker
from markergen.model.rescale import scale_sigmas

DOUBTED = 3.0
"""Difference in standard deviations from which on rulers contradict the photographs, and these the designed rig."""


def measured_growth(adjustment: Adjustment) -> float:
    """Share by which the first marker is larger than designed by lengths measured on it; 0 within `DOUBTED` sigmas."""
    network = adjustment.network
    is_first = network.marker == network.marker[0]
    precision = sum((ruler.length / ruler.sigma) ** 2 for ruler in network.lengths if is_first[ruler.first])
    if not (network.free and precision):
        return 0.0
    designed, printed = (
        places[is_first] - places[is_first].mean(axis=0) for places in (network.design, adjustment.places)
    )
    growth = float(np.sum(designed * printed) / np.sum(designed**2)) - 1
    return growth if abs(growth) > DOUBTED * precision**-0.5 else 0.0


@dataclass(frozen=True)
class ScaleErrors:
    """Standard deviations of a print's scale.

    Attributes
    ----------
    unmeasured : float
        Along x and along y while nothing measures it, as a share.
    ruler : float, m
        Of the length of a ruler.
    """

    unmeasured: float = 0.0
    ruler: float = RULER_SIGMA

    def along(self, design: Marker) -> tuple[float, float]:
        """Along x and along y, as shares."""
        return scale_sigmas(design, self.unmeasured, self.ruler)

    def mean(self, design: Marker) -> float:
        """Of the mean of both, as a share."""
        return float(np.hypot(*self.along(design))) / 2

    def by_rulers(self, design: Marker) -> tuple[float, float]:
        """Along x and along y as its rulers alone tell, as shares; 0 where none was measured."""
        return scale_sigmas(design, 0.0, self.ruler)

    def left(self, design: Marker, network: Network, marker: int) -> float:
        """Of what photographs leave open, as a share; none if lengths or dots measured by hand fix it."""
        return 0.0 if network.scale_known(marker) else self.mean(design)

    def ruler_lengths(self, designs: Sequence[Marker], lengths: Sequence[Length]) -> tuple[Length, ...]:
        """Return distances along x and y by a print's rulers, where lengths between dots are given as well."""
        lengths_by_rulers, first = list[Length](), 0
        for design in designs:
            dots = range(first, first + len(design))
            first += len(design)
            if not any(length_between.first in dots for length_between in lengths):
                continue
            for along, share in zip(design.xyz[:, :2].T, self.by_rulers(design), strict=True):
                pair = int(np.argmin(along)), int(np.argmax(along))
                length = float(np.linalg.norm(design.xyz[pair[1]] - design.xyz[pair[0]]))
                lengths_by_rulers += [Length(dots[pair[0]], dots[pair[1]], length, share * length)] if share else []
        return tuple(lengths_by_rulers)

    def contradictions(
        self, designs: Sequence[Marker], adjustment: Adjustment, print_sigma: float
    ) -> tuple[float, ...]:
        """Return by which share x over y of each marker is larger than by its rulers; 0 within `DOUBTED` sigmas.

        Photographs tell the ratio to far less than the errors of the rulers and of the dots of a print, `print_sigma`.
        """
        network, offsets = adjustment.network, []
        for marker, design in enumerate(designs):
            offsets.append(0.0)
            shares, is_on_marker = self.by_rulers(design), network.marker == marker
            if not (network.free and network.prior is None and all(shares) and is_on_marker.sum() > 1):
                continue
            of_marker = network.design[is_on_marker], adjustment.places[is_on_marker]
            away, there = (places - places.mean(axis=0) for places in of_marker)
            spread = np.linalg.norm(away[:, :2], axis=0)
            if spread.min() < 0.01 * spread.max():
                continue
            columns = np.linalg.lstsq(away[:, :2], there, rcond=None)[0]
            off = float(np.divide(*np.linalg.norm(columns, axis=1))) - 1
            if abs(off) > DOUBTED * np.hypot(np.hypot(*shares), print_sigma * np.hypot(*(1 / spread))):
                offsets[-1] = off
        return tuple(offsets)

    def widened(self, designs: Sequence[Marker], off: Sequence[float]) -> "ScaleErrors":
        """Return errors with which rulers agree with the photographs: theirs times the root of the worst chi2."""
        pairs = zip(designs, off, strict=True)
        factors = [abs(offset) / np.hypot(*self.by_rulers(design)) for design, offset in pairs if offset]
        return replace(self, ruler=self.ruler * max(factors, default=1.0))

    def displacements(self, design: Marker, network: Network, places: Array, measured: bool) -> Array:
        """Displacements (3 n, 2) of the first marker's dots by one sigma of the scale along x and y, or of both."""
        columns, first = np.zeros((len(places), 3, 2)), int(network.marker[0])
        if measured:
            columns[:, :, 0] = self.left(design, network, first) * (places - places.mean(axis=0))
        elif network.free and network.prior is None:
            columns[:, 0, 0], columns[:, 1, 1] = (np.array(self.along(design)) * places[:, :2]).T
        return columns.reshape(-1, 2)

    def source(self, design: Marker, network: Network, off: float) -> str:
        """Say where the first marker's scale comes from and how well it is known; `off` as of `contradictions`."""
        left, ruled = self.mean(design), any(self.by_rulers(design))
        if not network.free:
            is_rescaled = ruled or design.print_scale != (1.0, 1.0)
            return f"The scale is that of the {'rulers given to markergen rescale' if is_rescaled else 'design'}."
        why = f" only, since {doubt(off)}" if off else ""
        if network.lengths:
            share = sum((ruler.length / ruler.sigma) ** 2 for ruler in network.lengths) ** -0.5
            sentence = f"The scale is that of the measured length{'s' * (len(network.lengths) > 1 + 2 * ruled)}"
            sentence += f"{' and the rulers' * ruled}, known to {100 * share:.2g} %{why}"
            return (
                f"{sentence}."
                if share < left
                else f"{sentence}: no better than a print is expected to be, {100 * left:.2g} %."
            )
        if network.scale_known(int(network.marker[0])):
            return "The scale is that of the dots measured by hand."
        if ruled or design.print_scale != (1.0, 1.0):
            return f"The scale is that of the rulers given to markergen rescale, known to {100 * left:.2g} %{why}."
        return (
            f"The scale is that of the design, expected to be right to {100 * self.unmeasured:.2g} % along x and y "
            f"each, to {100 * left:.2g} % in their mean, and distances are no better: measure the rulers (markergen "
            "rescale), or the distance between two dots (--measured)."
        )


def doubt(off: float) -> str:
    """Return in words how rulers contradict the photographs; empty for 0."""
    if not off:
        return ""
    return (
        f"the rulers contradict the photographs, by which the print is {100 * abs(off):.2g} % "
        f"{'longer' if off > 0 else 'shorter'} along x, compared with y, than by them: measure the rulers again, and "
        "see which is which"
    )
