"""Names in the emitted filters: what a value is, not what it is part of."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from codegen.generate import draft
from codegen.ir.constants import is_round, with_names
from codegen.ir.expr import Expr
from codegen.ir.graph import SIGNIFICANT, Graph
from codegen.passes.hints import carried
from model.drives.load import load_drive
from runtime.estimator.folder import GENERATED
from tests.conftest import thoroughly, variant

FILTERS = sorted(GENERATED.glob("*/*ckf.c"))

#: Largest share of computed locals with a name that tells little: what they are part of, or operands without a number.
BOUND = 0.08
WEAK = re.compile(r"part_of|_scaled|_and_|_less_")


def computed(source: str) -> list[str]:
    """Locals of the blocks that are computed, not taken from an array."""
    found = re.findall(r"^ {4}const float32 (\w+) =\s*([^;]+);", source, re.MULTILINE)
    return [name for name, value in found if not re.fullmatch(r"[\w>.-]+(\[\d+\]|\.\w+)?", value)]


def share(source: str) -> float:
    """Of the computed locals, those whose name tells little."""
    names = computed(source)
    return sum(bool(WEAK.search(name)) for name in names) / len(names)


@pytest.mark.parametrize("path", FILTERS, ids=lambda path: path.stem)
def test_computed_locals_are_called_what_they_are(path: Path) -> None:
    assert share(path.read_text()) <= BOUND


def test_there_are_fifteen_filters_and_a_nameless_one_is_seen() -> None:
    assert len(FILTERS) == 6 * 2 + 3
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


#: Texts of a drive with arithmetic in them, and the functions whose coefficients are a polynomial's or a reduction's.
AROUND = [path for end in ("foc", "supervisor", "drive") for path in GENERATED.glob(f"*/*_{end}.c")]
TEXTS = sorted([*FILTERS, *AROUND, *GENERATED.glob("*/host/*.c"), *GENERATED.glob("*/*.py")])
POLYNOMIALS = re.compile(r"(sin_cos|wrap_angle|small_angle|wide_angle)")


def nameless(source: str) -> set[float]:
    """Numbers without a name that the functions of a C or Python text calculate with, but small round ones."""
    functions = re.findall(
        r"^(?:static |void |int )(?:\w+ )*\**(\w+)\([^{]*\n\{\n(.*?)^\}", source, re.MULTILINE | re.DOTALL
    )
    functions += re.findall(r"^def (\w+)\([^\n]*:\n(.*?)(?=^\S)", source, re.MULTILINE | re.DOTALL)
    assert functions
    found = set()
    for name, body in functions:
        if POLYNOMIALS.search(name) or name.endswith("_init"):
            continue
        code = re.sub(r'/\*.*?\*/|""".*?"""|#.*', "", body, flags=re.DOTALL if "/*" in body else 0)
        numbers = re.findall(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?=f?\b)", code)
        found |= {float(text) for text in numbers}
    return {number for number in found if not is_round(number)}


@pytest.mark.parametrize("path", AROUND, ids=lambda path: path.stem)
def test_around_the_filter_nothing_is_called_by_what_it_is_part_of(path: Path) -> None:
    assert not re.search(r"part_of_", path.read_text())


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem + path.suffix)
def test_every_literal_has_a_name(path: Path) -> None:
    assert nameless(path.read_text()) == set()


def test_a_literal_without_a_name_is_seen() -> None:
    assert len(TEXTS) >= 15 + 3 * 15 + 9
    for path in FILTERS:
        text = path.read_text()
        body = text[text.index("static void time_update(") :]
        names = re.findall(r"^#define (\w+) \S+f /\*", text, re.MULTILINE)
        names = [name for name in names if re.search(rf"\* {name}\b", body)]
        assert len(names) > 1, "constants that the filter multiplies with"
        for name in names:
            assert nameless(re.sub(rf"\* {name}\b", "* 0.123f", body, count=1)) == {0.123}, name
    module = GENERATED / "ipmsm" / "ipmsm.py"
    assert nameless(module.read_text().replace("GAIN_D * ", "0.0027 * ")) == {0.0027}


def test_a_sum_keeps_its_name_and_a_plain_number_has_none() -> None:
    graph = Graph()
    one, loss = graph.const(1.0), graph.const(0.3, "LOSS", "T * R")
    kept = graph.op("sub", one, loss)
    fourfold, plain = graph.op("mul", graph.const(4.0), kept), graph.op("add", graph.const(0.5), one)
    named = with_names(graph)
    assert (named[kept].name, named[kept].formula, named[kept].value) == ("ONE_MINUS_LOSS", "1 - LOSS", 0.7)
    assert (named[fourfold].name, named[fourfold].formula) == ("ONE_MINUS_LOSS_X4", "4 * (1 - LOSS)")
    assert (named[plain].name, graph[kept].name) == ("", "")
    named.input("angle")
    assert graph[graph.input("angle")].name == "angle"  # what grows in one is not taken for known in the other
    half = graph.op("sub", one, graph.const(0.25, "QUARTER"))
    assert with_names(graph)[half].name == ""


@pytest.mark.slow
@pytest.mark.parametrize("discretization", ["exact", *thoroughly("euler")])
@pytest.mark.parametrize("name", ["ipmsm", *thoroughly("spmsm_load_torque", "ipmsm_flux", "ipmsm_adaptive")])
def test_every_number_of_other_motors_has_a_name_too(name: str, discretization: str) -> None:
    """Data that are no round numbers, every filter, both discretisations: nothing is nameless, no name is double."""
    drive = load_drive(name)
    m, even = drive.motor, drive.motor.inductance_d == drive.motor.inductance_q
    motor = {
        "friction": 0.0013,
        "stator_resistance": 1.0371 * m.stator_resistance,
        "inductance_d": 1.0173 * m.inductance_d,
        "inductance_q": (1.0173 if even else 1.31) * m.inductance_q,
        "magnet_flux": 0.913 * m.magnet_flux,
        "inertia": 1.237 * m.inertia,
    }
    words = {"model": {"discretization": discretization}, "filter": {"kinds": ("ickf", "ekf", "ukf")}}
    made = draft(variant(drive, motor=motor, **words))
    values: dict[str, float] = {}
    for listing in made.listings.values():
        for node in (listing.graph[index] for index in listing.live):
            if node.op == "const" and not is_round(node.value):
                assert node.name, (listing.block.name, node.value)
                assert len(node.name) <= SIGNIFICANT
                assert values.setdefault(node.name, node.value) == pytest.approx(node.value, rel=1e-14), node.name
    assert len(values) > 10
