"""Small studies for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from runtime.drive.scenario import Scenario
from runtime.estimator.folder import find_folder
from runtime.study.package import pack
from runtime.study.run import Study
from runtime.study.statement import Statement, parse_ranges

DRIVE = "spmsm_load_torque"
#: What suits the shipped drives.
RATED = {"noise": 0.05, "load": 5.0, "speed": 1000.0}
SHORT = Scenario("short", speed=1000.0, ramp=0.03, load=3.0, load_at=0.05, duration=0.08)
VARY = ("theta=-90:90", "R=0.8:1.2", "noise=0.02:0.1:log", "load=0:3")


def stated(seed: int = 1, vary: tuple[str, ...] = VARY, drive: str = DRIVE) -> tuple[Statement, list[Any]]:
    """A study of a drive's two filters, and their packages."""
    packages = [pack(find_folder(drive), kind) for kind in ("ckf", "ickf")]
    subjects = tuple((package.drive, package.kind) for package in packages)
    digests = tuple(package.digest for package in packages)
    return Statement(
        subjects, digests, (SHORT,) * len(subjects), (RATED,) * len(subjects), parse_ranges(vary), seed
    ), packages


def same_study(a: Study, b: Study) -> None:
    """Group by group and run by run, every outcome."""
    assert len(a.groups) == len(b.groups)
    for one, two in zip(a.groups, b.groups, strict=True):
        assert (one.drive, one.kind) == (two.drive, two.kind)
        np.testing.assert_array_equal(one.index, two.index)
        for name, column in one.outcomes.columns().items():
            np.testing.assert_array_equal(column, getattr(two.outcomes, name), name)
