"""marker.detector.json: bodies in plain numbers, for the distribution markergen-detect, whose README describes it."""
# tests: tests/exporters/test_detector_json.py

from collections.abc import Sequence
from typing import Any

import numpy as np

from markergen.arrays import Array, Mask
from markergen.model.body import Body, Plate
from markergen.model.json_text import dumped
from markergen.model.rig import planned_print
from markergen.model.tag import family_size, tag_ink

FORMAT, VERSION = "markergen-detector", 1


def detector_json(bodies: Sequence[Body], names: Sequence[str]) -> bytes:
    """Return bodies as JSON; the same ones give the same bytes."""
    return (dumped(detector_content(bodies, names), indent=None) + "\n").encode()


def detector_content(bodies: Sequence[Body], names: Sequence[str]) -> dict[str, Any]:
    """Return bodies as plain JSON values, with the codes of all tags of their tags' families."""
    families = sorted({plate.marker.tag.family for body in bodies for plate in body.plates if plate.marker.tag})
    return {
        "format": FORMAT,
        "version": VERSION,
        "unit": "m",
        "bodies": [_content(body, name) for body, name in zip(bodies, names, strict=True)],
        "tag_families": {
            family: [f"{_code(tag_ink(family, number)):x}" for number in range(family_size(family))]
            for family in families
        },
    }


def _content(body: Body, name: str) -> dict[str, Any]:
    sigma, ids = planned_print(body), iter(body.ids.tolist())
    dots: list[dict[str, Any]] = []
    joint, tags = [], []
    for k, plate in enumerate(body.plates):
        marker, rotation, first = plate.marker, plate.rotation_matrix, len(dots)
        xyz, places = plate.to_body(marker.search_xyz).tolist(), plate.to_body(marker.xyz).tolist()
        covariances = _covariances(plate, sigma)
        for i, point in enumerate(marker.control_points):
            feature = point.feature
            kind = "ring" if feature.kind == "ring" else "disk"
            dot = {"id": next(ids), "plate": k, "kind": kind, "diameter": feature.diameter, "xyz": xyz[i]}
            dot |= {"place": places[i]} if places[i] != xyz[i] else {}
            dot |= {"covariance": covariances[i].tolist()} if np.isfinite(covariances[i]).all() else {}
            dots.append(dot)
        if marker.joint_places is not None:
            measured = np.flatnonzero([np.isfinite(marker.joint_places[i, :, i]).all() for i in range(len(marker))])
            block = marker.joint_places[measured][:, :, measured]
            matrix = np.einsum("ai,minj,bj->manb", rotation, block, rotation).reshape(3 * len(measured), -1)
            joint.append({"dots": (first + measured).tolist(), "matrix": ((matrix + matrix.T) / 2).tolist()})
        if marker.tag is not None:
            corners = np.column_stack([marker.tag.corners * marker.print_scale, np.zeros(4)])
            tag = {"family": marker.tag.family, "id": marker.tag.id, "plate": k}
            bits = marker.tag.ink.astype(int).tolist()
            tags.append({**tag, "corners": plate.to_body(corners).tolist(), "bits": bits})
    plates = [
        {
            "name": plate.name,
            "rotation": plate.rotation_matrix.tolist(),
            "translation": list(plate.translation),
            "spec_hash": plate.marker.spec_hash,
        }
        for plate in body.plates
    ]
    content = {"name": name, "frame": body.frame, "light": body.plates[0].marker.light, "print_sigma": sigma}
    content |= {"plates": plates, "dots": dots, "tags": tags}
    relation = body.relation_covariance
    content |= {"joint_covariances": joint} if joint else {}
    return content | ({} if relation is None else {"relation_covariance": relation.tolist()})


def _covariances(plate: Plate, sigma: float) -> Array:
    """Covariances (n, 3, 3) in m^2 of places that were measured one by one, in the body; nan for the others."""
    marker, rotation = plate.marker, plate.rotation_matrix
    covariances = np.full((len(marker), 3, 3), np.nan)
    if marker.place_covariance is not None and marker.joint_covariance is None:
        covariances[:, :2, :2] = marker.place_covariance
        covariances[:, 2, :] = covariances[:, :, 2] = 0.0
        # Heights are not measured: those of a relief are as printed.
        covariances[:, 2, 2] = sigma**2 if marker.xyz[:, 2].any() else 0.0
    rotated: Array = rotation @ covariances @ rotation.T
    return rotated


def _code(ink: Mask) -> int:
    """Code of a tag's inner cells: row by row from the lowest bit, 1 for black."""
    return sum(1 << i for i, black in enumerate(ink[1:-1, 1:-1].ravel().tolist()) if black)
