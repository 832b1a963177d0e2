"""Checks such as ``estimators.lm.rotation_deg.rms > 0.5`` on results in their JSON form."""

import math
import operator
import re
from collections.abc import Mapping
from typing import Any

from markergen.errors import InputError

OPERATORS = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le}

_EXPRESSION = re.compile(r"\s*([^\s<>=]+)\s*(>=|<=|>|<)\s*([^\s<>=]+)\s*")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def parse(expression: str) -> tuple[str, str, str]:
    """Split an expression into path, comparison and text of the number; raises InputError if it is malformed."""
    match = _EXPRESSION.fullmatch(expression)
    if match is None or not _NUMBER.fullmatch(match[3]):
        raise InputError(
            "a path, one of > >= < <=, and a number",
            repr(expression),
            "write for example 'estimators.lm.rotation_deg.rms > 0.5'",
        )
    return match[1], match[2], match[3]


def check(expression: str, results: Mapping[str, Any]) -> tuple[bool, str]:
    """Evaluate a condition that must not hold: a path into the results, one of > >= < <=, and a number.

    Parameters
    ----------
    expression : str
        The parts of the path are joined by dots; a key that contains dots is written as it is.
    results : mapping
        Plain JSON values.

    Returns
    -------
    passed : bool
        False if the comparison holds, or if there is no value because nothing was detected.
    message : str
        Value found and comparison, one line.

    Raises
    ------
    InputError
        If the expression is malformed or its path does not lead to a number; the message lists the available keys.

    Examples
    --------
    >>> check("bound.by_polar_angle.17.5 > 0.5", {"bound": {"by_polar_angle": {"17.5": 0.61}}})
    (False, 'bound.by_polar_angle.17.5 = 0.61 > 0.5')
    """
    path, sign, limit = parse(expression)
    value = _number(path, results)
    if value is None:
        return False, f"{path} has no value in this run, so it cannot be said to be within {limit}"
    holds = OPERATORS[sign](value, float(limit))
    relation = sign if holds else {">": "<=", ">=": "<", "<": ">=", "<=": ">"}[sign]
    return not holds, f"{path} = {value:.6g} {relation} {limit}"


def _number(path: str, results: Mapping[str, Any]) -> float | None:
    value, reached, rest = _follow(results, path)
    where = f"under {reached!r}" if reached else "in the results"
    children = _children(value)
    if children:
        problem = repr(rest) if rest else "a group"
        raise InputError(f"a path to a number {where}", problem, f"known there: {', '.join(children)}")
    if rest and (value is None or value == {}):
        raise InputError(f"results under {reached!r}", "none in this run", "ask for them with --runs or --views")
    if rest:
        raise InputError(f"a group {where}", f"no {rest!r} in it: {value!r} is a value", f"end the path at {reached!r}")
    if value is None and "." not in path:
        raise InputError(f"results under {path!r}", "none in this run", "ask for them with --runs or --views")
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"a number at {path!r}", repr(value), "choose a path that leads to a number")
    return value


def _follow(value: Any, path: str) -> tuple[Any, str, str]:
    """Follow a path as far as possible; return the value there, the path to it, and the rest of the path.

    Since keys may contain dots, every key that starts the path is tried, and the longest match taken; of two complete
    matches, the one that ends at a value.
    """
    ways = [(value, "", path)]
    for key, child in _children(value).items():
        if path == key:
            ways.append((child, key, ""))
        elif path.startswith(key + "."):
            child_value, reached, rest = _follow(child, path[len(key) + 1 :])
            ways.append((child_value, f"{key}.{reached}" if reached else key, rest))
    return min(ways, key=lambda way: (len(way[2]), len(_children(way[0])) > 0))


def _children(value: Any) -> dict[str, Any]:
    if isinstance(value, Mapping):
        return {str(key): child for key, child in value.items()}
    if isinstance(value, list):
        return {str(index): child for index, child in enumerate(value)}
    return {}
