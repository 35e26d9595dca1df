"""Link text: the shipped C and NumPy state the same; whatever else is stated is told by function and entry."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.link_text import link_text
from tests.conftest import ALL_DRIVES, DRIVES, thoroughly
from tests.mutants.checks import forms_of, overlaid


#: Of the others in DRIVES test_proof.py holds this link too, with the rest of the chain.
@pytest.mark.parametrize("drive", [DRIVES[0], *thoroughly(*(name for name in ALL_DRIVES if name != DRIVES[0]))])
def test_every_shipped_expression_is_the_same(drive: str) -> None:
    folder = GeneratedFolder(GENERATED / drive)
    assert folder.kinds
    for kind in folder.kinds:
        link = link_text(folder, kind, "as shipped")
        assert link.passed, [row.stage for row in link.rows if not row.passed]
        assert link.compared > 500
        steps = {f"step, {form}: status" for form in ("C", "lanes", "controller", "controller's lanes")}
        assert steps | {"time_update, C", "time_update, lanes", "control, controller"} <= {
            row.stage for row in link.rows
        }


#: The changes, each with its file, as a pattern and its replacement; which entry is told.
CHANGES = {
    "another order of additions": (
        "ipmsm_flux_ickf.c",
        r"(P_pred_11 =) (\w+) \+ (\w+) \+ (\w+)",
        r"\1 \2 + (\3 + \4)",
        "time_update, C: P_pred_11",
    ),
    "operands exchanged": (
        "ipmsm_flux_ickf.c",
        r"one_per_Pyy_00 \* Pyy_10;",
        "Pyy_10 * one_per_Pyy_00;",
        "ickf_iterate, C: Pyy_10_per_Pyy_00",
    ),
    "last bit of a constant": (
        "ipmsm_flux_ickf.c",
        r"#define INV_L_Q 19.607843f",
        "#define INV_L_Q 19.607845f",
        "ickf_iterate, C: slope_y_i_alpha_0",
    ),
    "a coefficient of the sine": (
        "ipmsm_flux_ickf.c",
        r"-3\.0947836e-06f",
        "-3.0947838e-06f",
        "sin_cos, C: s",
    ),
    "a coefficient of small turns": (
        "ipmsm_flux_ickf.c",
        r"#define SINC_2 0.13114102f",
        "#define SINC_2 0.13114104f",
        "step, C: x[0]",
    ),
    "another word": ("ipmsm_flux_ickf.c", r"L_10 = LD\[1\]", "L_10 = LD[3]", "step, C: x[0]"),
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
    "a double": ("ipmsm_flux_ickf.c", r"3\.9601994f", "3.9601994", "time_update, C: "),
    "something more": (
        "ipmsm_flux_ickf.c",
        r"( +)LD_pred_out\[1\] = L_pred_10;\n",
        r"\g<0>\1LD_pred_out[1] += 1.0f;\n",
        "time_update, C: in one language only",
    ),
    "a block that Python does not have": (
        "ipmsm_flux_ickf.c",
        r"(?s)static void coast\(",
        "static void drift(",
        "drift, C: in one language only",
    ),
    "lanes, in another order": (
        "host/ipmsm_flux_ckf_lanes.c",
        r"(P_pred_11 =) (\w+) \+ (\w+) \+ (\w+)",
        r"\1 \2 + (\3 + \4)",
        "time_update, lanes: P_pred_11",
    ),
    "controller, axes exchanged": (
        "ipmsm_flux_ickf_foc.c",
        r"L_Q \* i_q",
        "L_D * i_q",
        "control, controller: v_d_wanted",
    ),
    "Python, a sign": (
        "ipmsm_flux.py",
        r"deviation_theta = theta_pred - theta_j",
        "deviation_theta = theta_pred + theta_j",
        "ickf_iterate, C: deviation_theta",
    ),
}


#: One of each reader in ``make test``.
SOME = (
    "another order of additions",
    "another word",
    "lanes, in another order",
    "controller, axes exchanged",
    "Python, a sign",
)


@pytest.mark.parametrize("change", [*SOME, *thoroughly(*(change for change in CHANGES if change not in SOME))])
def test_what_is_stated_otherwise_is_told(change: str) -> None:
    file, pattern, new, told = CHANGES[change]
    folder = GeneratedFolder(Path(GENERATED / "ipmsm_flux"))
    text, count = re.subn(pattern, new, folder.text(file), count=1)
    assert count == 1
    kind = "ckf" if "_ckf" in file else "ickf"
    link = link_text(overlaid(folder, file, text), kind, "jacobian", forms_of(file))
    assert not link.passed
    assert any(row.stage.startswith(told) for row in link.rows if not row.passed)


C, LANES, MODULE = "ipmsm_flux_ickf.c", "host/ipmsm_flux_ickf_lanes.c", "ipmsm_flux.py"
FOC, FOC_LANES = "ipmsm_flux_ickf_foc.c", "host/ipmsm_flux_ickf_foc_lanes.c"

#: Faults in the flow around the blocks, in one text at a time: file, what stands there, what is planted.
FLOW_FAULTS = [
    (C, "? 0 : PMSM_RESTARTED", "? 0 : PMSM_DIVERGED"),
    (C, "int status = PMSM_INPUT_REJECTED", "int status = PMSM_NOT_CONVERGED"),
    (C, "worst <= 1.0f", "worst < 1.0f"),
    (C, "f->nis < f->nis_max) ? 0", "f->nis <= f->nis_max) ? 0"),
    (C, "size_of(value[1]) <= most", "size_of(value[1]) < most"),
    (C, "        f->x[i] = f->x_0[i];\n", ""),
    (C, "f->P_0[i]", "f->P_0[0]"),
    (C, "    f->nis = 0.0f;\n", ""),
    (C, "f->nis + f->nis_weight * (", "f->nis + ("),
    (C, "        f->u_held[1] = u[1];\n", ""),
    (C, "f->u_held[0] = u[0]", "f->u_held[0] = u[1]"),
    (C, "WIDE_SINC_5 * part", "WIDE_SINC_4 * part"),
    (C, "total > UNKNOWN_TURN", "total >= UNKNOWN_TURN"),
    (C, "ANGLE_COLUMNS - 1] = 0.5f", "ANGLE_COLUMNS - 1] = 0.25f"),
    (C, "WIDE_COSM1_1) * part", "WIDE_COSM1_1) * total"),
    (C, "#define MOST_REPAIRS 32767", "#define MOST_REPAIRS 32766"),
    (C, "            iterations++;\n", ""),
    (C, "iterations < f->max_iterations", "iterations <= f->max_iterations"),
    (C, "(LD_pred[2] > f->Q[2])", "(LD_pred[2] > f->Q[1])"),
    (C, "(LD_pred[2] > f->Q[2])", "(LD_pred[2] >= f->Q[2])"),
    (C, "PMSM_COVARIANCE_REPAIRED | PMSM_RESTARTED", "PMSM_COVARIANCE_REPAIRED"),
    (C, "coast(x_pred, LD_pred, f->x, f->LD)", "coast(x_pred, LD_pred, x_j, f->LD)"),
    (C, "status |= time_update_turns", "status = 0 & time_update_turns"),
    (C, "    f->iterations = iterations;\n", ""),
    (LANES, "(good != 0) ? 0 : PMSM_INPUT_REJECTED", "(good != 0) ? PMSM_INPUT_REJECTED : 0"),
    (
        LANES,
        "const int u_good = within(u[0].of[lane], u_max) & within(",
        "const int u_good = within(u[0].of[lane], u_max) | within(",
    ),
    (
        LANES,
        "for (lane = 0; lane < LANES; lane++) {\n            if (special",
        "for (lane = 1; lane < LANES; lane++) {\n            if (special",
    ),
    (LANES, "any |= special[lane]", "any = special[lane]"),
    (LANES, "take(HL, new_HL, active, 8)", "take(HL, new_HL, active, 7)"),
    (LANES, "take(f->LD, other_LD, rejected, 10)", "take(f->LD, other_LD, rejected, 9)"),
    (LANES, "f->iterations[lane] + made", "f->iterations[lane] + 1"),
    (LANES, "(rejected[lane] != 0) ? nis_before : nis_after", "(rejected[lane] != 0) ? nis_after : nis_before"),
    (LANES, "(worst <= 1.0f) ? 0 : PMSM_RESTARTED", "(worst <= 1.0f) ? 0 : PMSM_DIVERGED"),
    (MODULE, "(worst <= 1.0)", "(worst < 1.0)"),
    (MODULE, "np.where(accepted, 0, INPUT_REJECTED)", "np.where(u_good, 0, INPUT_REJECTED)"),
    (MODULE, "COVARIANCE_REPAIRED = 8", "COVARIANCE_REPAIRED = 16"),
    (MODULE, "for k in range(ANGLE_COLUMNS):", "for k in range(ANGLE_COLUMNS - 1):"),
    (MODULE, "u_held = _select(u_good, u, f.u_held)", "u_held = u"),
    (MODULE, "f.nis_weight * (nis[0] - f.nis)", "f.nis_weight * nis[0]"),
    (MODULE, "(iterations < f.max_iterations)", "(iterations <= f.max_iterations)"),
    (MODULE, "zip(f.x_0, x)", "zip(x, x)"),
    (MODULE, "        x = _select(accepted, x, coast_x)\n", ""),
    (FOC, "PMSM_COMMAND_REJECTED", "PMSM_INPUT_REJECTED"),
    (FOC, "rotor[1] = c->sensed[1]", "rotor[1] = c->sensed[0]"),
    (FOC, "c->command_held[k] = command[k]", "c->command_held[k] = command[0]"),
    (FOC, "is_within(c->sensed[1], SENSED_MAX)", "is_within(c->sensed[1], c->command_max[1])"),
    (FOC, "value * value <= limit * limit", "value * value < limit * limit"),
    (FOC, "c->gain, c->integrator, duty, v, c->integrator", "c->gain, c->integrator, duty, v, i"),
    (FOC, "c->v_acting[1] = c->v_queued[1]", "c->v_acting[1] = v[1]"),
    (FOC_LANES, "(delayed != 0) ? now : queued", "(delayed != 0) ? queued : now"),
    (FOC_LANES, "speed_good & link_good & (", "speed_good & ("),
    (FOC_LANES, "for (k = 0; k < 4; k++) {\n        c->integrator", "for (k = 0; k < 3; k++) {\n        c->integrator"),
    (MODULE, "c.integrator = control(", "integrator = control("),
    (MODULE, "SENSED_MAX = 1000.0", "SENSED_MAX = 100.0"),
    (MODULE, "        c.v_acting = v\n", "        c.v_acting = c.v_queued\n"),
]


def by_floor(faults: list[tuple[str, str, str]]) -> list[Any]:
    """The first of every text in ``make test``; the rest thoroughly."""
    met = Counter[str]()
    cases = []
    for fault in faults:
        met[fault[0]] += 1
        cases += [pytest.param(fault)] if met[fault[0]] == 1 else thoroughly((fault,))
    return cases


@pytest.mark.parametrize("fault", by_floor(FLOW_FAULTS), ids=lambda fault: f"{fault[0]}: {fault[1].strip()[:40]}")
def test_a_fault_in_the_flow_of_one_text_is_told(fault: tuple[str, str, str]) -> None:
    file, old, new = fault
    folder = GeneratedFolder(Path(GENERATED / "ipmsm_flux"))
    text = folder.text(file)
    assert old in text
    link = link_text(
        module_of(overlaid(folder, file, text.replace(old, new)), file), "ickf", "jacobian", forms_of(file)
    )
    assert any(row.stage.startswith("step, ") for row in link.rows if not row.passed)


def module_of(folder: GeneratedFolder, file: str) -> GeneratedFolder:
    """The folder, its module executed from the planted text."""
    assert not file.endswith(".py") or folder.module
    return folder
