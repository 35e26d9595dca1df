"""Names in the emitted filters: what a value is, not what it is part of."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from codegen.ir.constants import is_round, with_sums
from codegen.ir.expr import Expr
from codegen.ir.graph import Graph
from codegen.passes.hints import carried
from model.drives.load import load_drive
from model.machines.state_space import build
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


def literals(source: str) -> set[float]:
    """Numbers that the blocks of a filter hold without a name."""
    blocks = re.findall(r"^static void \w+\([^{]*\n\{\n(.*?)^\}", source, re.MULTILINE | re.DOTALL)
    return {float(text) for block in blocks for text in re.findall(r"(?<![\w.])(\d+\.?\d*(?:e[+-]?\d+)?)f", block)}


def nameless_sums(source: str, constants: dict[str, float]) -> set[float]:
    """Numbers without a name that are 1 - A, 1 + A, A - B or A + B of a model's constants, round ones apart."""
    values = [1.0, *constants.values()]
    sums = {np.float32(a + sign * b) for a in values for b in constants.values() for sign in (1.0, -1.0)}
    return {number for number in literals(source) if not is_round(number) and np.float32(number) in sums}


@pytest.mark.parametrize("path", FILTERS, ids=lambda path: path.stem)
def test_sums_of_constants_have_names(path: Path) -> None:
    constants = {constant.name: constant.value for constant in build(load_drive(path.parent.name)).constants}
    text = path.read_text()
    assert nameless_sums(text, constants) == set()
    defined = dict(re.findall(r"^#define (ONE_MINUS_\w+|\w+_MINUS_\w+) (\S+)f /\*", text, re.MULTILINE))
    for name, number in defined.items():
        assert name in text.replace(f"#define {name} ", "")
        bare = re.sub(rf"^    (.*)\b{name}\b", rf"    \g<1>{number}f", text, flags=re.MULTILINE)
        if not re.search(r"_(X\d|SQ)$", name):
            assert nameless_sums(bare, constants) == {float(number)}, name


def test_a_sum_keeps_its_name_and_a_plain_number_has_none() -> None:
    graph = Graph()
    one, loss = graph.const(1.0), graph.const(0.3, "LOSS", "T * R")
    kept = graph.op("sub", one, loss)
    fourfold, plain = graph.op("mul", graph.const(4.0), kept), graph.op("add", graph.const(0.5), one)
    named = with_sums(graph)
    assert (named[kept].name, named[kept].formula, named[kept].value) == ("ONE_MINUS_LOSS", "1 - LOSS", 0.7)
    assert (named[fourfold].name, named[fourfold].formula) == ("ONE_MINUS_LOSS_X4", "4 * (1 - LOSS)")
    assert (named[plain].name, graph[kept].name) == ("", "")
    named.input("angle")
    assert graph[graph.input("angle")].name == "angle"  # what grows in one is not taken for known in the other
    half = graph.op("sub", one, graph.const(0.25, "QUARTER"))
    assert with_sums(graph)[half].name == ""
