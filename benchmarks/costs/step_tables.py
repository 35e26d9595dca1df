"""Tables of what a step costs: beside its peers, form by form, and pass by pass."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from codegen.fast.ablation import ABLATION, OPERATIONS, weights_text
from costs import ours, peers
from costs.counting import (
    Candidate,
    Inputs,
    Missing,
    deviation,
    figure,
    host_instructions,
    m4_instructions,
    m4_stack,
    m4_text,
)
from costs.table import Row, Table, Wanted, chosen, ratio
from model.drives.load import load_drive, shipped_drives

Progress = Callable[[str], None]

PAPER = "paper_spmsm"
X86, M4, TEXT, STACK = "x86 instr.", "M4 instr.", "M4 text, B", "M4 stack, B"
FAST = "ours, fast, ckf"
#: Why a pass can earn operations and cost instructions.
ON_X86 = "A division is one instruction on x86 whatever it takes: sharing reciprocals earns time, not instructions."


@dataclass(frozen=True)
class Length:
    """Steps counted, and the steps before them in which the filter settles."""

    steps: int = 1000
    settle: int = 200


def inputs_of(problem: ours.Problem, length: Length, kind: str = "ckf") -> Inputs:
    return Inputs.of(problem.drive, length.steps, length.settle, problem.initial_state, kind)


def peers_table(length: Length, progress: Progress) -> Table:
    """paper_spmsm by us and by others."""
    problem = ours.Problem.of(load_drive(PAPER))
    inputs = inputs_of(problem, length)
    rows: list[Row] = []
    for label, make in _subjects(problem):
        progress(f"{label}: counting")
        rows.append(_row(label, make, inputs))
    fast = chosen(rows, FAST)
    for row in rows:
        row["fast / it, x86"] = ratio(fast[X86], row[X86])
        row["fast / it, M4"] = ratio(fast[M4], row[M4])
        if "note" in row:
            row["note"] = row.pop("note")  # last
    return Table("peers", f"One step of {PAPER} (h is linear: the ICKF is the CKF)", rows, _notes(length))


def _subjects(problem: ours.Problem) -> list[tuple[str, Callable[[], Candidate]]]:
    drive = problem.drive

    def own(kind: str, ablation: ours.AblationStep) -> Callable[[], Candidate]:
        return lambda: ours.candidate(problem, kind, ablation)[0]

    return [
        ("ours, literal, ckf", own("ckf", ours.LITERAL)),
        ("ours, literal, ickf", own("ickf", ours.LITERAL)),
        (FAST, own("ckf", ours.SHIPPED)),
        ("ours, fast, ickf", own("ickf", ours.SHIPPED)),
        ("CasADi's own C", lambda: peers.casadi_c(drive)),
        ("SymForce's C++", lambda: peers.symforce_cpp(drive)),
        ("hand-written, N = 1", lambda: peers.handwritten()),
        ("hand-written, N = 3 as in the paper", lambda: peers.handwritten(iterations=3)),
        ("floor: EKF, fast", own("ekf", ours.SHIPPED)),
    ]


def _row(label: str, make: Callable[[], Candidate], inputs: Inputs) -> Row:
    made: list[Candidate] = []
    failed = figure(lambda: float(bool(made.append(make()))))
    if isinstance(failed, Missing):
        columns = (X86, M4, TEXT, STACK, "add+mul", "div/sqrt/sincos", "deviation, sigma")
        return {"step": label, **dict.fromkeys(columns, failed)}
    subject = made[0]
    counts = subject.operations
    row: Row = {
        "step": label,
        X86: figure(lambda: host_instructions(subject, inputs)),
        M4: figure(lambda: m4_instructions(subject, inputs)),
        TEXT: figure(lambda: m4_text(subject)),
        STACK: figure(lambda: m4_stack(subject)),
        "add+mul": float(counts["add"] + counts["mul"]) if counts else "",
        "div/sqrt/sincos": "/".join(str(counts[name]) for name in ("div", "sqrt", "sincos")) if counts else "",
        "deviation, sigma": figure(lambda: deviation(subject, inputs)),
    }
    return row | ({"note": subject.note} if subject.note else {})


def _notes(length: Length) -> list[str]:
    return [
        f"Steps {length.settle + 1} .. {length.settle + length.steps} of the proof's start (proof/trajectory.py); "
        "theta is wrapped by all; ours check their inputs and return a status, the peers do neither.",
        "x86: callgrind, the step's function and all it calls, (Ir(N2) - Ir(N1)) / (N2 - N1); -O2 -ffp-contract=off.",
        "M4: Cortex-M4F under qemu, arm-none-eabi-gcc -O2 -ffp-contract=off -fno-math-errno; for CasADi with the 30 or "
        "so instructions that put its results back.",
        "Text: .text and .rodata that the linker keeps for the step alone (--gc-sections), libraries included. Stack: "
        "deepest chain of frames by GCC's call graph (-fcallgraph-info=su), library functions not in it.",
        "Operations: ours counted in the emitted C at most (every branch, wide angles too), a sincos as one call; "
        "CasADi's in its tape. Deviation: largest |x - float64 reference| over all steps.",
        "The hand-written one takes sine, cosine and wrapping from the generated arithmetic; CasADi and SymForce call "
        "the platform's. The EKF is another filter: its deviation is from the CKF.",
    ]


def forms_table(length: Length, progress: Progress, drives: Sequence[str] = ()) -> Table:
    """Fast against literal for every shipped drive and kind."""
    rows: list[Row] = []
    for name in drives or shipped_drives():
        problem = ours.Problem.of(load_drive(name))
        for kind in ("ckf", "ickf"):
            progress(f"{name}, {kind}: counting both forms")
            inputs = inputs_of(problem, length, kind)
            forms = [ours.candidate(problem, kind, ablation)[0] for ablation in (ours.LITERAL, ours.SHIPPED)]
            host, m4 = (
                [figure(lambda form=form, count=count, inputs=inputs: count(form, inputs)) for form in forms]
                for count in (host_instructions, m4_instructions)
            )
            rows.append(
                {
                    "drive, filter": f"{name}, {kind}",
                    "literal, x86": host[0],
                    "fast, x86": host[1],
                    "fast / literal, x86": ratio(host[1], host[0]),
                    "literal, M4": m4[0],
                    "fast, M4": m4[1],
                    "fast / literal, M4": ratio(m4[1], m4[0]),
                }
            )
    note = "Instructions a step as above; an ICKF with as many iterates as it takes (at most N_max)."
    return Table("forms", "The fast form against the literal one", rows, [note])


def passes_table(length: Length, progress: Progress, kind: str = "ckf", drives: Sequence[str] = ()) -> Table:
    """The gain of each step of :data:`codegen.fast.ablation.ABLATION`."""
    rows: list[Row] = []
    for name in drives or (PAPER, "ipmsm_flux", "spmsm_load_torque"):
        problem = ours.Problem.of(load_drive(name))
        inputs = inputs_of(problem, length, kind)
        for ablation in ABLATION:
            progress(f"{name}, {ablation.name}: counting")
            subject, cost = ours.candidate(problem, kind, ablation)
            row: Row = {"form": f"{name}: {ablation.name}", "weight": float(cost.weight)}
            row |= {op: float(cost.operations[op]) for op in OPERATIONS}
            row[X86] = figure(lambda subject=subject, inputs=inputs: host_instructions(subject, inputs))
            rows.append(row)
    return Table("passes", f"What each pass earns ({kind}; each with those before)", rows, [weights_text(), ON_X86])


def wanted(peers_rows: Table | None, forms: Table | None) -> list[Wanted]:
    """The figures looked for in these tables."""
    found: list[Wanted] = []
    if peers_rows:
        fast, rows = chosen(peers_rows.rows, FAST), peers_rows.rows
        found += [
            Wanted(f"{PAPER} fast, x86 instructions", fast[X86], 700),
            Wanted(f"{PAPER} fast, M4 instructions", fast[M4], 550),
            Wanted(f"{PAPER} fast, M4 text, B", fast[TEXT], 1800),
            Wanted("fast / CasADi's own C, x86", chosen(rows, "CasADi")["fast / it, x86"], 0.27),
            Wanted("fast / SymForce's C++, x86", chosen(rows, "SymForce")["fast / it, x86"], 0.4),
            Wanted("fast / hand-written N = 1, x86", chosen(rows, "hand-written, N = 1")["fast / it, x86"], 0.18),
        ]
    if forms:
        for name in ("spmsm_load_torque", "ipmsm_flux"):
            for kind in ("ckf", "ickf"):
                cell = chosen(forms.rows, f"{name}, {kind}")["fast / literal, x86"]
                found.append(Wanted(f"{name} {kind}, fast / literal, x86", cell, 0.5))
    return found
