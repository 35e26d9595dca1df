"""Wrong flow in the program itself and in what C, lanes and Python print alike: link text cannot see these."""

from __future__ import annotations

from tests.mutants.catalogue.rewriting import FLUX, PAPER, of

#: The regenerated folder first and of one drive: modules keep the place that they were loaded with.
SAME = ("regenerated ipmsm_adaptive tests/codegen/test_status_bits.py", *PAPER, *FLUX)

PROGRAM = (
    *of(
        "fast form",
        "model/filters/program.py",
        ("the wrong state wrapped", 'Wrap(Entry("x", model.angle))', 'Wrap(Entry("x", model.angle - 1))', PAPER),
    ),
    *of(
        "fast form",
        "codegen/ir/layout.py",
        (
            "sine of more than a turn",
            'args = [new.op("wrap", args[0])]',
            "args = [args[0]]",
            ("pytest tests/codegen/test_trig.py",),
        ),
    ),
    *of(
        "fast form",
        "codegen/fast/guards.py",
        ("a floor met is none", 'Compare(">", Entry("LD_pred"', 'Compare(">=", Entry("LD_pred"', SAME),
        ("floor of another", 'Entry("LD_pred", place(k, k))', 'Entry("LD_pred", place(0, 0))', SAME),
        (
            "average of the last alone",
            'Operation("-", Entry("nis", 0), _MEAN)',
            'Operation("+", Entry("nis", 0), _MEAN)',
            SAME,
        ),
        ("average without its weight", 'Operation("*", Entry("nis_weight"), change)', "change", SAME),
        ("a mean at its limit is calm", '_CALM = Compare("<"', '_CALM = Compare("<="', SAME),
        ("states are not looked at", "total(_CHECK, _MEAN, *states)", "total(_CHECK, _MEAN)", SAME),
        (
            "divergence is not unusual",
            "(Not(sane), Not(_CALM), Reported((_REPAIRED,)))",
            "(Not(sane), Reported((_REPAIRED,)))",
            SAME,
        ),
        ("a repair is not unusual", "(Not(sane), Not(_CALM), Reported((_REPAIRED,)))", "(Not(sane), Not(_CALM))", SAME),
        (
            "a restart is no repair",
            "If(Reported((_REPAIRED, _RESTARTED)), (Count",
            "If(Reported((_REPAIRED,)), (Count",
            SAME,
        ),
        (
            "restarts from a repair",
            "If(Reported((_RESTARTED,)), (Restart(),))",
            "If(Reported((_REPAIRED,)), (Restart(),))",
            SAME,
        ),
        ("told by another bit", "Report(_DIVERGED, _CALM)", "Report(_RESTARTED, _CALM)", SAME),
        (
            "words are looked at as wide as states",
            'Size("worst", (_CHECK, _MEAN), "LD", "PER_SANE_LIMIT")',
            'Size("worst", (_CHECK, _MEAN), "LD", "SANE_LIMIT")',
            SAME,
        ),
    ),
    *of(
        "fast form",
        "codegen/render/printers/flow.py",
        ("parentheses on the right dropped", '            right = f"({right})"\n', "            right = right\n", SAME),
        ("either for all", "sign = self.AND if isinstance(condition, All) else self.OR", "sign = self.OR", SAME),
        (
            "not dropped",
            'return f"{self.NOT}({self.format_condition(condition.condition)})"',
            "return self.format_condition(condition.condition)",
            SAME,
        ),
    ),
)
