"""REPORT.md of a generated folder: equations, states, iteration, budget, certificate."""

from __future__ import annotations

from codegen.certificate import Certificate
from codegen.cost import CYCLES, CYCLES_PER_OPERATION, Cost
from codegen.equations import readable, sparsity
from codegen.render import FILTER_TITLES, Description, render
from codegen.render_selftest import SelfTest
from codegen.trig import sin_cos_bound
from model.filters import FilterStep


def render_report(
    about: Description,
    steps: dict[str, FilterStep],
    costs: dict[str, Cost],
    certificates: dict[str, Certificate],
    tests: dict[str, SelfTest],
) -> str:
    """The readable side of the manifest."""
    drive, model = about.drive, about.model
    eq = readable(drive)
    return render(
        "report.md.j2",
        about=about,
        drive=drive,
        states=[
            {"q": state, "x_0": f"{x0:g}", "P_0": f"{p:g}", "Q": f"{q:g}"}
            for state, x0, p, q in zip(
                model.states,
                about.initial_state,
                drive.filter.initial_covariance,
                drive.filter.process_noise,
                strict=True,
            )
        ],
        discretization=model.exact_meaning if drive.model.discretization == "exact" else "forward Euler (eq. 7)",
        f=[(eq.latex(left), eq.latex(right)) for left, right in eq.f],
        h=[(eq.latex(left), eq.latex(right)) for left, right in eq.h],
        H=eq.latex(eq.H),
        constants=eq.constants,
        sparsity=sparsity(model),
        steps=steps,
        costs=costs,
        certificates=certificates,
        tests=tests,
        titles=FILTER_TITLES,
        k=CYCLES_PER_OPERATION,
        cycles=CYCLES,
        trig=sin_cos_bound(),
    )
