"""What can be told of a point of the grid before anything is computed."""

from collections.abc import Callable, Sequence
from typing import Any

from markergen.errors import InputError
from markergen.estimators import ESTIMATORS
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.dot_size import choose_dots
from markergen.optimize.problem import check_objective
from markergen.read.poses import poses_from
from markergen.studies.cells import canonical


class Feasible:
    """Checks specs, and remembers what it has looked at: most points of a grid share their room and poses."""

    def __init__(self) -> None:
        self._seen: dict[str, InputError | None] = {}

    def check(self, spec: Spec, layout: str, estimators: Sequence[str]) -> tuple[str, ...]:
        """Names of the estimators that a point of the grid is tried with: those given, or all that can do with it.

        Raises
        ------
        InputError
            If no pose sees the marker, the dots do not fit, names are unknown, or the parts do not go together.
        """
        self._check_names(spec)
        if layout != "designed":
            for name in ("relief", "asymmetric"):
                if getattr(spec, name):
                    raise InputError(f"layout='designed' for {name}", f"layout={layout!r}", f"leave out {name}")
        planar = [name for name in estimators if spec.relief and ESTIMATORS[name].planar_only]
        if planar:
            raise InputError("estimators that can do with a relief", ", ".join(planar), "leave them out")
        self._check_room(spec)
        names = estimators or ESTIMATORS.names()
        return tuple(dict.fromkeys(name for name in names if not (spec.relief and ESTIMATORS[name].planar_only)))

    def _check_names(self, spec: Spec) -> None:
        check_objective(spec, spec.noise_model == "image")
        key = canonical(["names", spec.objective, spec.aggregate, spec.coordinates])
        self._once(key, lambda: self._build(spec))

    def _build(self, spec: Spec) -> None:
        poses = poses_from("paper")
        OBJECTIVES[spec.objective](Setting(spec.boundary, spec.camera, poses), spec.aggregate, spec.coordinates)

    def _check_room(self, spec: Spec) -> None:
        values: dict[str, Any] = spec.as_dict()
        for name in ("objective", "aggregate", "coordinates", "seed", "restarts", "survive", "asymmetric"):
            values.pop(name, None)
        self._once(canonical(values), lambda: _fit(spec))

    def _once(self, key: str, look: Callable[[], None]) -> None:
        if key not in self._seen:
            try:
                look()
                self._seen[key] = None
            except InputError as error:
                self._seen[key] = error
        found = self._seen[key]
        if found is not None:
            raise found


def _fit(spec: Spec) -> None:
    poses = poses_from(spec.poses).seen_whole(spec.boundary, spec.camera, spec.relief)
    # The best size for every pose is a search of its own: its cell tells if there is none.
    if spec.dot != "auto":
        choose_dots(spec, poses)
