"""The ledger counts what a person counts, and agrees with the graph the text was printed from."""

from __future__ import annotations

from collections import Counter
from typing import Any

import casadi as ca
import pytest
from pycparser import CParser, c_generator

from codegen.evidence.emitted import EmittedError, _declarations, _Preprocessor, code_of, parse_emitted
from codegen.evidence.ledger import Program
from codegen.ir.layout import Listing, lay_out
from codegen.ir.trig import sin_cos_listing, wrap_listing
from codegen.render.printers.c import CPrinter
from codegen.targets.find import default_target
from codegen.targets.numbers import FLOAT32
from model.filters.program import BlockBuilder
from model.loop.controller import clarke_block
from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.conftest import shipped_accounts

pytestmark = pytest.mark.unit

PRICES = default_target().prices
assert PRICES is not None

PRELUDE = """
#define PMSM_SQRT(x) sqrtf(x)
#define SIZE 3
typedef float float32;
typedef struct { float32 sine; float32 cosine; } sin_cos_pair;
typedef struct { float32 gain[SIZE]; int max_iterations; float32 bias; int n; } part_t;
typedef struct { part_t part; float32 limit; } f_t;
static sin_cos_pair sin_cos(float32 x) { sin_cos_pair r; r.sine = x * x; r.cosine = 1.0f - x; return r; }
static float32 twice(float32 a) { return a + a; }
static void scale(float32 *a, int count) { int k; for (k = 0; k < count; k++) { a[k] = a[k] * 2.0f; } }
"""


def count(body: str, n_max: int = 4, more: str = "") -> dict[str, int]:
    text = f"{PRELUDE}{more}\nfloat32 step(f_t *f, float32 a, float32 b)\n{{\nfloat32 v[3]; int k;\n{body}\n}}\n"
    return dict(Program({"x.c": text}, "x.c").count("step", n_max))


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("return a + b - a * b;", {"add": 2, "mul": 1}),
        ("return -a / (b - -2.0f);", {"add": 2, "div": 1}),  # -2.0f is a literal
        ("return a * (2.0f * 3.0f);", {"mul": 1}),  # the compiler's, not the chip's
        ("k = 1 + 2; v[k + 1] = a; k++; return v[k * 2];", {}),  # whole numbers are not floats
        ("return PMSM_SQRT(a * a + b * b);", {"mul": 2, "add": 1, "sqrt": 1}),
        ("v[0] += a; v[1] *= b; v[2] -= a; return v[0];", {"add": 2, "mul": 1}),
        ("return twice(twice(a * b));", {"add": 2, "mul": 1, "call": 2}),
        ("return f->part.gain[1] * f->limit;", {"mul": 1}),
        ("return f->part.n * 2;", {}),
        ("return a < b ? a + b : a * b;", {"compare": 1, "branch": 1, "add": 1, "mul": 1}),
        ("k = (k != 0) ? 1 : 2; return a;", {"branch": 1}),
        ("k = ((a < b) && (b < 0.0f)) ? 1 : 0; return a;", {"compare": 2, "branch": 2}),
        ("if (a < b && b > 0.0f) { a = a * b; } else { a = a * b * b; } return a;",
         {"compare": 2, "mul": 2, "branch": 2}),
        ("if (!((a < b) || (k == 1))) { a = a * b; } return a;", {"compare": 1, "mul": 1, "branch": 2}),
        ("if (k) { a = a / b; } return a;", {"div": 1, "branch": 1}),
        ("for (k = 0; k < SIZE; k++) { a = a + b; } return a;", {"add": 3, "branch": 4}),
        ("for (k = 0; k <= SIZE; k++) { a = a + b; } return a;", {"add": 4, "branch": 5}),
        ("for (k = 0; k < SIZE; k++) { v[k] = a; } return a;", {"branch": 4}),
        ("scale(v, SIZE); scale(v, 5); return v[0];", {"mul": 8, "branch": 10, "call": 2}),
        ("if (a > b) { return a * b * b; } return a + b;", {"mul": 2, "add": 1, "compare": 1, "branch": 1}),
        ("do { a = a * b; k++; } while (a > b && k < f->part.max_iterations); return a;",
         {"mul": 4, "compare": 4, "branch": 8}),
    ],
)  # fmt: skip
def test_counts_are_those_of_a_hand_count(body: str, expected: dict[str, int]) -> None:
    assert count(body) == expected


def test_loops_within_loops_multiply() -> None:
    body = "int j; for (k = 0; k < 3; k++) { for (j = 0; j < 2; j++) { a = a * b; } a = a + b; } return a;"
    assert count(body) == {"mul": 6, "add": 3, "branch": 13}


def test_sin_cos_is_followed_and_its_calls_are_told() -> None:
    body = "return sin_cos(a + b).sine + sin_cos(a).cosine;"
    assert count(body) == {"add": 4, "mul": 2, "call": 2, "sincos": 2}


def test_what_is_set_aside_is_called_and_not_followed() -> None:
    program = Program({"x.c": f"{PRELUDE}float32 step(float32 a) {{ return twice(sin_cos(a).sine); }}"}, "x.c")
    assert program.count("step", 1, aside=frozenset({"sin_cos"})) == {"add": 1, "call": 2, "sincos": 1}


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("return expf(a);", "no cost known for a call of 'expf'"),
        ("while (a < b) { a = a * b; } return a;", "a loop without a bound"),
        ("scale(v, f->part.n); return a;", "a loop without a bound"),
        ("switch (k) { default: a = a * b; } return a;", "switch is not counted"),
        ("return a +;", "x.c cannot be read as C"),
    ],
)
def test_what_cannot_be_counted_is_refused(body: str, expected: str) -> None:
    with pytest.raises(EmittedError, match=expected):
        count(body)


def test_struct_words_follow_the_c28x() -> None:
    """3 floats (6), an int (1) and its gap (1), a float (2), an int and the tail (2); then a float outside."""
    program = Program({"x.c": PRELUDE}, "x.c")
    assert program.units[0].words("part_t") == 12
    assert program.units[0].words("f_t") == 14
    assert program.units[0].words("sin_cos_pair") == 4


def test_directives_take_the_chips_branch() -> None:
    header = "#ifndef H\n#define H\ntypedef float real; /* a { comment */\n#endif\n"
    source = """#include "h.h"
#include "h.h"
#include <math.h>
#if defined(__TMS320C28XX__) && !defined(NOT_HERE) && UINT_MAX == 0xFFFFU
#define SUM(a, b) ((a) + \\
                   (b))
#pragma CODE_SECTION(f, "ramfuncs")
#elif defined(__GNUC__)
#error "the host"
#else
#define SUM(a, b) 0
#endif
real f(real x) { return SUM(SUM(x, 1.0f),
                            x * x); }
"""
    tree, files = parse_emitted({"s.c": source, "h.h": header, "other.h": ""}, "s.c")
    assert files == ("h.h", "s.c")
    assert [type(item).__name__ for item in tree.ext] == ["Typedef", "FuncDef"]
    assert Program({"s.c": source, "h.h": header}, "s.c").count("f", 1) == {"add": 2, "mul": 1}
    with pytest.raises(EmittedError, match='ends in #error "no"'):
        parse_emitted({"s.c": '#ifdef __TMS320C28XX__\n#error "no"\n#endif\n'}, "s.c")


def test_casadi_counts_the_same_block() -> None:
    """An expression without shared work: CasADi's own instruction count, operation by operation."""
    b = BlockBuilder("block", "A block")
    x, y, z = b.input("v", ["x", "y", "z"])
    result = ca.sqrt(x * y + z / x) - (y - z) * (x + z)
    b.output("r", [result])
    block = b.build()
    function = ca.Function("f", [ca.vertcat(x, y, z)], [result])
    names = {ca.OP_ADD: "add", ca.OP_SUB: "add", ca.OP_MUL: "mul", ca.OP_DIV: "div", ca.OP_SQRT: "sqrt"}
    expected = Counter(
        names[op] for k in range(function.n_instructions()) if (op := function.instruction_id(k)) in names
    )
    text = PRELUDE + CPrinter(FLOAT32).format_block(lay_out(block, []))
    assert Program({"x.c": text}, "x.c").count("block", 1) == expected


def _graph_count(listing: Listing) -> dict[str, int]:
    counted = {"add", "mul", "div", "sqrt", "sincos"}
    return {name: number for name, number in listing.operations().items() if number and name in counted}


def test_the_graph_agrees_block_by_block(drive: Drive) -> None:
    """The text is counted, the graph it was printed from is counted: both must be the same work."""
    from codegen.generate import build_steps, lay_out_steps

    wrap, pair = (Counter(_graph_count(of)) for of in (wrap_listing(FLOAT32.precision), sin_cos_listing()))
    model, steps = build_steps(drive)
    listings = lay_out_steps(model, steps)
    program = shipped_accounts(drive.name)["ckf"].program
    for block in steps["ckf"].blocks:
        listing = listings[block.name]
        expected = Counter(_graph_count(listing))
        for _ in range(listing.operations()["wrap"]):
            expected += wrap
        for _ in range(listing.operations()["sincos"]):
            expected += pair
        angles = listing.operations()["small_angle"]
        for _ in range(angles):  # two polynomials
            expected += Counter({"mul": 5, "add": 4})
        expected += Counter({"add": max(0, angles - 1)})  # the sum of the squares, by which wide ones are told
        found = program.count(block.name, 1)
        if angles:  # at most: the way by which wide turns are computed, which no graph knows
            assert all(found[name] >= number for name, number in expected.items()), block.name
            assert found["mul"] > expected["mul"]
        else:
            assert {name: found[name] for name in expected} == dict(expected), block.name
    assert program.count("sin_cos", 1) == _graph_count(sin_cos_listing())
    assert program.count("clarke", 1) == _graph_count(lay_out(clarke_block(), []))


def test_the_printed_figures_are_those_of_the_printed_text(drive: Drive) -> None:
    """The head of the file quotes the count of the file, and so do report and manifest."""
    import json

    folder = GENERATED / drive.name
    files = {path.name: path.read_text() for path in folder.glob("*.[ch]")}
    manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    report = (folder / "REPORT.md").read_text()
    for kind, facts in manifest["filters"].items():
        name = f"{drive.name}_{kind}"
        program = Program(files, f"{name}.c", f"{name}_foc.c")
        for function, source, recorded in (("_step", "", facts), ("_foc_step", "_foc", facts["controller"])):
            ops = program.count(name + function, drive.filter.max_iterations)
            assert {key: ops[key] for key in recorded["operations"]} == recorded["operations"]
            text = files[f"{name}{source}.c"]
            assert f"{ops['add']} add, {ops['mul']} mul, {ops['div']} div, {ops['sqrt']} sqrt" in text
            figures = [PRICES.total(ops, k) for k in (2.5, 4, 5)]
            assert f"estimated {figures[0]} cycles" in text
            assert " / ".join(str(figure) for figure in figures) in report


STEP = """
typedef float float32;
typedef struct { float32 a[3]; int n; } small_t;
typedef struct { int mode; int rivals; small_t kept; float32 x; } drive_t;
void step(drive_t *d, small_t *f);
void step(drive_t *d, small_t *f)
{
    const float32 x = d->x;
    if (d->rivals != 0) {
        d->x = x * x * x;
    }
    if (d->mode == 4) {
        d->x = x + x;
    } else if ((d->mode == 6) && (d->x > x)) {
        d->kept = *f;
        *f = d->kept;
        d->x = x / x;
    } else {
        d->x = x - x - x;
    }
}
"""


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {"mul": 2, "add": 2, "div": 1, "compare": 1, "copied": 16, "branch": 4}),
        ({"mode": 4}, {"mul": 2, "add": 1, "branch": 2}),
        ({"mode": 4, "rivals": 0}, {"add": 1, "branch": 2}),
        ({"mode": 4, "rivals": 1}, {"mul": 2, "add": 1, "branch": 2}),
        ({"mode": 6, "rivals": 0}, {"add": 2, "div": 1, "compare": 1, "copied": 16, "branch": 4}),
        ({"mode": 5, "rivals": 0}, {"add": 2, "compare": 1, "branch": 4}),
    ],
)
def test_what_is_given_decides_its_branches_and_copies_cost_their_words(
    given: dict[str, int], expected: dict[str, int]
) -> None:
    """Where something else is asked besides, both sides count; a struct of 3 floats and an int has 8 words."""
    program = Program({"x.c": STEP}, "x.c")
    assert program.count("step", 1, given=given) == expected
    table = program.ledger("step", "drive_t", 1, given).operations
    assert table.get("copied", 0) == expected.get("copied", 0)
    assert ("copied" in table) == ("copied" in expected)


NESTED = (
    STEP
    + """
static void inner(drive_t *d, small_t *f) { step(d, f); }
void outer(drive_t *d, small_t *f) { if (d->rivals == 1) { inner(d, f); } inner(d, f); }
void again(drive_t *d, small_t *f) { inner(d, f); }
"""
)


def test_counts_of_one_program_do_not_take_each_others_answers() -> None:
    """A function that was counted is not counted again where what it asked, itself or by a call, is the same."""
    every = [{}, {"mode": 4}, {"mode": 4, "rivals": 0}, {"mode": 4, "rivals": 1}, {"mode": 6}, {"mode": 5, "rivals": 0}]
    for order in (every, every[::-1]):
        program = Program({"x.c": NESTED}, "x.c")
        for given in order:
            for function in ("outer", "again", "step"):
                alone = Program({"x.c": NESTED}, "x.c").count(function, 1, given=given)
                assert program.count(function, 1, given=given) == alone
                program.count(function, 1, given=given).clear()  # the caller's own
        assert program.count("step", 1, given={"mode": 4}) == {"mul": 2, "add": 1, "branch": 2}


TRICKY = """
typedef struct { int a[2]; struct { int b; } c; } s_t, *p_t;
static const char text[] = "} ; {"; static const char mark = '{';
static const s_t table[2] = { { { 1, 2 }, { 3 } }, { { 4, 5 }, { 6 } } };
enum { ONE, TWO };
int f(p_t s, int (*g)(int));
int f(p_t s, int (*g)(int)) { if (s->a[0]) { return g(1); } return 2; }
static int h(int s_t_) { typedef int s_u; s_u k = s_t_; return k; }
"""


def test_a_text_is_read_in_parts_as_it_is_read_whole() -> None:
    name = "ipmsm_flux"
    files = {path.name: path.read_text() for path in (GENERATED / name).glob("*.[ch]")} | {"tricky.c": TRICKY}
    spell = c_generator.CGenerator().visit
    for source in ("tricky.c", f"{name}_ckf.c", f"{name}_ickf.c", f"{name}_ickf_supervisor.c", f"{name}_ickf_drive.c"):
        text = _Preprocessor(files, default_target().macros).read(source)
        parts = list(_declarations(text))
        assert len(parts) > 5
        assert spell(parse_emitted(files, source)[0]) == spell(CParser().parse(text))


@pytest.mark.parametrize("wrong", ["int f(void) { return 1; ", "int f(void) { return 1; } }", "s_t x;", "int f( { }"])
def test_what_is_no_c_is_refused_with_its_place_in_the_file(wrong: str) -> None:
    with pytest.raises(EmittedError, match=r"x\.c cannot be read as C: (x\.c:|At end of input)"):
        parse_emitted({"x.c": f"int y;\n{wrong}\n"}, "x.c")


def test_one_more_iteration_costs_one_more_pass() -> None:

    account = shipped_accounts("ipmsm_flux")["ickf"]
    passes = [account.program.count(f"{account.name}_step", n)["mul"] for n in (1, 2, 3, 6)]
    once = passes[1] - passes[0]
    assert once > 0
    assert passes == [passes[0] + once * k for k in (0, 1, 2, 5)]


def test_a_mutant_of_the_text_changes_the_count(drive: Drive) -> None:
    """The count is of the text: one operation more in the file is one more in the ledger."""
    name = f"{drive.name}_ckf"
    files = {path.name: path.read_text() for path in (GENERATED / drive.name).glob("*.[ch]")}
    before = Program(files, f"{name}.c").count(f"{name}_step", 1)
    files[f"{name}.c"] = files[f"{name}.c"].replace("LD_pred_out[0] = ", "LD_pred_out[0] = x[0] * ", 1)
    after = Program(files, f"{name}.c").count(f"{name}_step", 1)
    assert after - before == {"mul": 1}


def test_code_of_leaves_what_a_compiler_sees() -> None:
    assert code_of("/* a\n b */\nint x;   \n\n/* c */ int y;\n") == "int x;\n  int y;"
