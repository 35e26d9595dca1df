"""The drives that tests use are of every kind that there is."""

from __future__ import annotations

import pytest

from model.drives.load import load_drive, shipped_drives
from model.filters import build_filter
from model.machines.state_space import build
from tests.conftest import ALL_DRIVES, DRIVES
from tests.features import FEATURES, LOOP, fewest, iteration, unmet

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("feature", FEATURES)
def test_a_drive_under_test_has_it(feature: str) -> None:
    assert any(FEATURES[feature](load_drive(name)) for name in DRIVES)


def test_no_drive_under_test_could_be_spared() -> None:
    assert len(DRIVES) < len(ALL_DRIVES)
    for name in DRIVES:
        assert unmet([load_drive(other) for other in DRIVES if other != name])


def test_a_feature_that_is_missing_is_told() -> None:
    paper = [load_drive("paper_spmsm")]
    assert unmet(paper) == [
        "salient rotor", "flux linkages as states", "load torque", "exact", "adaptive", "root order", "iterating"
    ]  # fmt: skip
    with pytest.raises(ValueError, match=r"no shipped drive has: six phases\."):
        fewest(FEATURES | {"six phases": lambda drive: drive.motor.pole_pairs > 90})
    assert fewest({word: has for word, has in FEATURES.items() if has(paper[0])}) == ("paper_spmsm",)


@pytest.mark.parametrize("name", shipped_drives())
def test_whether_it_iterates_is_what_the_proof_of_it_says(name: str) -> None:
    drive = load_drive(name)
    if "ickf" in drive.filter.kinds:
        step = build_filter(build(drive), "ickf", drive.filter.gain)
        assert iteration(drive) == (step.iteration_proof or LOOP)
    else:
        assert iteration(drive) == ""


def test_a_drive_that_is_not_generated_yet_neither_iterates_nor_is_idle() -> None:
    new = load_drive("paper_spmsm").model_copy(update={"name": "new"})
    assert not FEATURES["iterating"](new)
    assert not FEATURES["idle"](new)
