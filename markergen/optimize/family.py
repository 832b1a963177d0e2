"""Families of markers: one layout, designed once, with another tag for each."""

from collections.abc import Sequence
from dataclasses import replace

from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.model.spec import Spec


def members(marker: Marker, spec: Spec, ids: Sequence[int]) -> tuple[Marker, ...]:
    """Markers of the same layout with a tag of each of these ids, each as if it had been designed by itself.

    Parameters
    ----------
    marker : Marker
        As designed from `spec`; the id of its tag does not matter.

    Raises
    ------
    InputError
        If it has no tag, or an id is not in the tag's family.
    """
    if marker.tag is None:
        raise InputError("a tag to tell the markers of a family apart", "none", "add --tag aruco:DICT_4X4_50, say")
    made = []
    for number in ids:
        tag = replace(marker.tag, id=number)
        own = replace(spec, tag=str(tag))
        stored = {**marker.provenance["spec"], "tag": str(tag)}
        provenance = {**marker.provenance, "spec": stored, "spec_hash": own.hash}
        made.append(replace(marker, tag=tag, provenance=provenance))
    return tuple(made)
