"""Remarks of readers are collected, or logged as warnings."""

import logging

from markergen.read.remarks import collected_remarks, remark, remark_unused


def test_collected_or_logged(caplog):
    with caplog.at_level(logging.WARNING), collected_remarks() as lines:
        remark("a")
        remark("a")
        with collected_remarks() as inner:
            remark("b")
        remark_unused("x.yaml", [])
        remark_unused("x.yaml", ["one", "t\nwo", "one"])
    assert (lines, inner) == (["a", "not used of x.yaml: one, 't\\nwo'"], ["b"])
    assert not caplog.records
    remark("c %d")
    assert [record.getMessage() for record in caplog.records] == ["c %d"]
