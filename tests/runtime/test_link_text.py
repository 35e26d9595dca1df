"""Link text: the shipped C and NumPy state the same; whatever else is stated is told by function and entry."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.link_text import link_text
from tests.mutants.checks import overlaid

SHIPPED = sorted(path.name for path in GENERATED.iterdir() if (path / "manifest.json").exists())


@pytest.mark.parametrize("drive", SHIPPED)
@pytest.mark.parametrize("kind", ["ckf", "ickf"])
def test_every_shipped_expression_is_the_same(drive: str, kind: str) -> None:
    link = link_text(GeneratedFolder(GENERATED / drive), kind, "as shipped")
    assert link.passed, [row.stage for row in link.rows if not row.passed]
    assert link.compared > 500
    assert {"time_update, C", "time_update, lanes", "control, controller"} <= {row.stage for row in link.rows}


#: What is changed in which file, as a pattern and its replacement; which entry is told.
CHANGES = {
    "another order of additions": (
        "ipmsm_flux_ickf.c",
        r"(bend_psi_beta_sum =) (\w+) \+ (\w+) \+ (\w+)",
        r"\1 \2 + (\3 + \4)",
        "time_update, C: bend_psi_beta_sum",
    ),
    "operands exchanged": (
        "ipmsm_flux_ickf.c",
        r"one_per_Pyy_00 \* Pyy_10;",
        "Pyy_10 * one_per_Pyy_00;",
        "ickf_iterate, C: one_per_Pyy_00_times_Pyy_10",
    ),
    "last bit of a constant": (
        "ipmsm_flux_ickf.c",
        r"#define INV_L_Q 19.607843f",
        "#define INV_L_Q 19.607845f",
        "ickf_iterate, C: slope_y_i_alpha_0",
    ),
    "a coefficient of the sine": (
        "ipmsm_flux_ickf.c",
        r"2\.5999034e-06f",
        "2.5999036e-06f",
        "sin_cos, C: output 0[0]",
    ),
    "a coefficient of small turns": (
        "ipmsm_flux_ickf.c",
        r"#define SINC_2 0.13114102f",
        "#define SINC_2 0.13114104f",
        "time_update_turns, C: output 1[0]",
    ),
    "another word": ("ipmsm_flux_ickf.c", r"L_20 = LD\[3\]", "L_20 = LD[4]", "time_update_turns, C: L_20"),
    "outputs exchanged": (
        "ipmsm_flux_ickf.c",
        r"LD_pred_out\[1\] = L_pred_10",
        "LD_pred_out[1] = L_pred_20",
        "time_update, C: output 1[1]",
    ),
    "an output forgotten": (
        "ipmsm_flux_ickf.c",
        r"    LD_pred_out\[1\] = L_pred_10;\n",
        "",
        "time_update, C: output 1[1]",
    ),
    "a double": ("ipmsm_flux_ickf.c", r"3\.9601994f \* cos", "3.9601994 * cos", "time_update, C: even_psi_d_next_1"),
    "something more": (
        "ipmsm_flux_ickf.c",
        r"( +)LD_pred_out\[1\] = L_pred_10;\n",
        r"\g<0>\1LD_pred_out[1] += 1.0f;\n",
        "time_update, C: line",
    ),
    "a block that Python does not have": (
        "ipmsm_flux_ickf.c",
        r"(?s)static void coast\(",
        "static void drift(",
        "drift, C: in one language only",
    ),
    "lanes, in another order": (
        "host/ipmsm_flux_ckf_lanes.c",
        r"(bend_psi_beta_sum =) (\w+) \+ (\w+) \+ (\w+)",
        r"\1 \2 + (\3 + \4)",
        "time_update, lanes: bend_psi_beta_sum",
    ),
    "controller, axes exchanged": (
        "ipmsm_flux_ickf_foc.c",
        r"L_Q \* i_q",
        "L_D * i_q",
        "control, controller: v_d_wanted",
    ),
    "Python, a sign": (
        "ipmsm_flux.py",
        r"back_theta = theta_pred - theta_j",
        "back_theta = theta_pred + theta_j",
        "ickf_iterate, C: back_theta",
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_stated_otherwise_is_told(change: str) -> None:
    file, pattern, new, told = CHANGES[change]
    folder = GeneratedFolder(Path(GENERATED / "ipmsm_flux"))
    text, count = re.subn(pattern, new, folder.text(file), count=1)
    assert count == 1
    kind = "ckf" if "_ckf" in file else "ickf"
    link = link_text(overlaid(folder, file, text), kind, "jacobian")
    assert not link.passed
    assert any(row.stage.startswith(told) for row in link.rows if not row.passed)
