"""Names in the emitted filters: what a value is, not what it is part of."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from codegen.ir.expr import Expr
from codegen.ir.graph import Graph
from codegen.passes.hints import carried
from runtime.estimator.folder import GENERATED

FILTERS = sorted(GENERATED.glob("*/*ckf.c"))

#: Largest share of computed locals that are called after what they are part of.
BOUND = 0.08


def computed(source: str) -> list[str]:
    """Locals of the blocks that are computed, not taken from an array."""
    found = re.findall(r"^ {4}const float32 (\w+) =\s*([^;]+);", source, re.MULTILINE)
    return [name for name, value in found if not re.fullmatch(r"[\w>.-]+(\[\d+\]|\.\w+)?", value)]


def share(source: str) -> float:
    """Of the computed locals, those without a name of their own."""
    names = computed(source)
    return sum("part_of" in name for name in names) / len(names)


@pytest.mark.parametrize("path", FILTERS, ids=lambda path: path.stem)
def test_computed_locals_are_called_what_they_are(path: Path) -> None:
    assert share(path.read_text()) <= BOUND


def test_there_are_twelve_filters_and_a_nameless_one_is_seen() -> None:
    assert len(FILTERS) == 12
    for path in FILTERS:
        text = path.read_text()
        assert len(computed(text)) > 80
        planted = re.sub(r"\b(?=(odd_|D_pred|L_pred|P_pred)\w+ =)", "part_of_", text)
        assert share(planted) > BOUND


def test_a_hint_finds_its_value_in_another_form() -> None:
    old, new = Graph(), Graph()
    a, b, c = (Expr(old, old.input(name)) for name in "abc")
    x, y, z = (Expr(new, new.input(name)) for name in "abc")
    factored, bounded = x * (y + z), x.apply("max", y)
    hints = (("both", a * b + a * c), ("gone", a * b), ("bounded", a.apply("max", b)), ("free", a), ("less", -(b + c)))
    found = dict(carried(hints, new))
    assert found == {
        "both": factored,
        "bounded": bounded,
        "free": x,
        "minus_less": y + z,
    }
