"""Links supervisor and modes on machines and texts that are wrong: each must fail, and say where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from model.drives.load import load_drive
from model.filters.conditions import All, Compare, Entry, Name
from model.machines.state_space import build
from model.supervisor import Supervisor, supervisor
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.exhaust import link_exhaust
from runtime.proof.link_drive import link_drive
from runtime.proof.link_drive_lanes import link_drive_lanes
from runtime.proof.link_modes import link_modes
from runtime.proof.modes import Modes
from runtime.proof.result import Link
from runtime.proof.second import second_motor
from tests.mutants.checks import overlaid

#: Without a rival, which is sooner looked at; with one.
ALONE, RIVALS = "paper_spmsm", "ipmsm_flux"


def declared(name: str = ALONE) -> Supervisor:
    drive = load_drive(name)
    return supervisor(drive, build(drive))


def exhausted(machine: Supervisor, name: str = ALONE) -> Link:
    drive = load_drive(name)
    return link_exhaust(machine, name, drive.model.sample_time, Modes(drive.model_dump(), flux=False).longest)


def failed(link: Link) -> str:
    return "; ".join(row.stage for row in link.rows if not row.passed)


# --- every state


def without(source: str, why: str) -> Callable[[Supervisor], Supervisor]:
    """A transition left out, by its mode and the beginning of its reason."""

    def change(machine: Supervisor) -> Supervisor:
        kept = tuple(t for t in machine.transitions if not (t.source == source and t.why.startswith(why)))
        assert len(kept) == len(machine.transitions) - 1
        return replace(machine, transitions=kept)

    return change


def changed(source: str, why: str, **what: Any) -> Callable[[Supervisor], Supervisor]:
    """A transition changed."""

    def change(machine: Supervisor) -> Supervisor:
        hit = [t.source == source and t.why.startswith(why) for t in machine.transitions]
        assert sum(hit) == 1
        rows = (replace(t, **what) if it else t for t, it in zip(machine.transitions, hit, strict=True))
        return replace(machine, transitions=tuple(rows))

    return change


def mode(name: str, **what: bool) -> Callable[[Supervisor], Supervisor]:
    return lambda machine: replace(
        machine, modes=tuple(replace(m, **what) if m.name == name else m for m in machine.modes)
    )


def first(source: str, why: str) -> Callable[[Supervisor], Supervisor]:
    """A transition before all others of its mode."""

    def change(machine: Supervisor) -> Supervisor:
        moved = [t for t in machine.transitions if t.source == source and t.why.startswith(why)]
        return replace(machine, transitions=(*moved, *(t for t in machine.transitions if t not in moved)))

    return change


def without_action(name: str) -> Callable[[Supervisor], Supervisor]:
    return lambda machine: replace(
        machine, actions=tuple(replace(a, body=()) if a.name == name else a for a in machine.actions)
    )


ALWAYS = Compare(">=", Entry("since"), Name("SETTLE_SAMPLES"))
FAULTS: dict[str, tuple[Callable[[Supervisor], Supervisor], str]] = {
    "waits for ever": (without("WAITING", "the current does not die out"), "WAITING ends: inf"),
    "looks for ever": (without("CATCHING", "the filter has not found"), "CATCHING ends: inf"),
    "probes for ever": (without("PROBING", "no current came"), "PROBING ends: inf"),
    "looks longer than is said": (
        changed("CATCHING", "the filter has not", guard=Compare(">=", Entry("since"), Name("MAX_DIVERGED"))),
        "CATCHING ends: ",
    ),
    "inverter on while resting": (mode("RESTING", inverter=True), "inverter off in RESTING"),
    "inverter on in FAULT": (mode("FAULT", inverter=True), "inverter off in RESTING"),
    "inverter off while running": (mode("RUNNING", inverter=False), "inverter on elsewhere"),
    "torque without a filter": (mode("PROBING", torque=True), "torque only where the filter runs"),
    "torque straight from rest": (changed("RESTING", "the currents read", target="RUNNING"), "no torque straight"),
    "one transition hides another": (first("RUNNING", "a window is over"), "every transition can be taken"),
    "a guard that never holds": (
        changed(
            "CATCHING",
            "the filter is content",
            guard=All((ALWAYS, Compare("<", Entry("since"), Name("SETTLE_SAMPLES")))),
        ),
        "every transition can be taken",
    ),
    "no way out of FAULT": (without("FAULT", "the fault is acknowledged"), "a way to RUNNING from every state"),
    "a self-test is acknowledged": (
        changed("FAULT", "the fault", guard=Compare(">=", Entry("acknowledged"), Name("GONE"))),
        "only power-up leaves a self-test",
    ),
    "a fault is a failed self-test": (
        changed("RUNNING", "the filter is blind", reason="SELF_TEST"),
        "no fault of the drive is taken for that one",
    ),
    "failures are not counted": (without_action("fail"), "every attempt that fails is counted"),
    "one failure is not counted": (changed("RUNNING", "the filter is blind", actions=()), "every attempt that fails"),
    "failures are forgotten": (
        changed("RESTING", "the currents read", actions=("forget",)),
        "only success or an acknowledgement forgets",
    ),
    "failures do not end": (without("RESTING", "attempts failed"), "so many failures in a row"),
    "FAULT at once": (changed("WAITING", "the current does not", target="FAULT"), "so many failures in a row"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_wrong_machine_is_told(name: str) -> None:
    fault, where = FAULTS[name]
    link = exhausted(fault(declared()))
    assert not link.passed
    assert where in failed(link), failed(link)


def test_a_mode_that_is_nowhere_reached_is_told() -> None:
    machine = replace(declared(), transitions=tuple(t for t in declared().transitions if t.target != "WAITING"))
    assert "every mode is reached" in failed(exhausted(machine))


def test_a_start_that_goes_on_is_told() -> None:
    machine = without("STARTING", "neither filter is right")(declared(RIVALS))
    assert "STARTING ends: inf" in failed(exhausted(machine, RIVALS))


def test_the_machine_as_it_is_passes() -> None:
    assert exhausted(declared()).passed


# --- by hand


def linked(name: str, effort: tuple[int, int] = (60, 50)) -> Link:
    drive, folder = load_drive(name), GeneratedFolder(GENERATED / name)
    return link_modes(folder, folder.kinds[0], "as shipped", drive.model_dump(), second_motor(drive), effort)


#: A module's numbers, each wrong by the least that matters, and what is told.
NUMBERS = {
    "MAX_EXCESS": (1, "mode"),
    "REST_SAMPLES": (1, "mode"),
    "SETTLE_SAMPLES": (1, "a transition or none"),
    "MAX_FAILURES": (-1, "mode"),
    "GAP_SAMPLES": (1, "mode"),
    "CATCH_SAMPLES": (-1, "mode"),
    "STEADY_WINDOWS": (-1, "counts"),
    "UNKNOWN_ANGLE": (1e-9, "covariance"),
    "ZERO_SQUARED": (1e-6, "counts"),
    "TRIP_SQUARED": (-1e-4, "counts"),
    "TURN_PER_SAMPLE": (1e-9, "turning"),
    "PROBE_SPEED": (1e-6, "guess"),
    "ARC_BEND": (0.03, "angle, as read"),
    "PI": (1e-9, "guess"),
}


@pytest.mark.parametrize("number", NUMBERS)
def test_a_wrong_number_is_told(number: str, monkeypatch: pytest.MonkeyPatch) -> None:
    more, where = NUMBERS[number]
    module = GeneratedFolder(GENERATED / ALONE).module
    monkeypatch.setattr(GeneratedFolder, "module", module)
    monkeypatch.setattr(module, number, getattr(module, number) + more)
    link = linked(ALONE, (80, 70))
    assert not link.passed
    assert where in failed(link), failed(link)


def test_a_transition_that_is_never_taken_fails_the_link() -> None:
    link = linked(ALONE, (2, 3))
    assert not link.passed
    assert all(row.passed for row in link.rows if row.meaning != "times too seldom")
    assert "RUNNING: steady" in failed(link)


def test_two_transitions_with_one_number_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    module = GeneratedFolder(GENERATED / ALONE).module
    own = module.supervise
    monkeypatch.setattr(GeneratedFolder, "module", module)
    monkeypatch.setattr(module, "supervise", lambda *given: own(*given) // 2 * 2)
    assert "each transition has a number" in failed(linked(ALONE))


# --- C and the drive

#: A change of a text of C, and which row tells it.
TEXTS = {
    "a state not reset": ("supervisor.c", "    s->mirrored = 0;\n    s->failures", "    s->failures", "power-up"),
    "refused, and resting": ("supervisor.c", "s->mode = PMSM_FAULT;\n    s->reason", "s->reason", "self-test"),
    "another limit": ("supervisor.c", "#define MAX_EXCESS 3", "#define MAX_EXCESS 4", "supervisor, every field"),
    "gates on in RESTING": (
        "supervisor.c",
        "    s->inverter = 0;\n    if (",
        "    s->inverter = 0;\n    if ((s->mode == PMSM_RESTING) || ",
        "arbitrary memory",
    ),
    "no mode stays": ("supervisor.c", "go(s, PMSM_RESTING); /* no mode", "; /* no mode", "arbitrary memory"),
    "regulators stay": ("drive.c", "        clear_regulators(&d->control);\n", "", "drive, every field"),
    "gates by another word": ("drive.c", "return d->supervisor.inverter;", "return 1;", "drive, every field"),
}


def drives(folder: Any) -> list[Link]:
    return link_drive(folder, "ckf", "as shipped", load_drive(ALONE).model_dump(), (20, 60))


@pytest.mark.parametrize("name", TEXTS)
def test_a_wrong_text_is_told(name: str) -> None:
    file, old, new, where = TEXTS[name]
    folder, file = GeneratedFolder(GENERATED / ALONE), f"{ALONE}_ckf_{file}"
    text = folder.text(file)
    assert text.count(old) == 1
    bits = drives(overlaid(folder, file, text.replace(old, new)))[1]
    assert not bits.passed
    assert where in failed(bits), failed(bits)


@pytest.mark.parametrize("wrong", ["torque", "regulators", "gates", "idle"])
def test_a_drive_that_does_otherwise_in_both_languages_is_told(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = GeneratedFolder(GENERATED / ALONE).module
    monkeypatch.setattr(GeneratedFolder, "module", module)
    own = module.drive_step

    def drive_step(d: Any, *given: Any) -> Any:
        if wrong == "torque":
            d.supervisor.torque = d.supervisor.runs
        if wrong == "regulators":
            d.supervisor.anew = d.supervisor.anew * 0
        duty, inverter = own(d, *given)
        return (duty[::-1] if wrong == "idle" else duty), (1 if wrong == "gates" else inverter)

    monkeypatch.setattr(module, "drive_step", drive_step)
    hand = drives(GeneratedFolder(GENERATED / ALONE))[0]
    assert not hand.passed
    assert failed(hand) == "drive"


WALKED, DRIVEN = "supervisor in lanes, every field", "drive in lanes, every field"
LANES = {
    "a count of another lane": ("s->failures[lane] += (", "s->failures[0] += (", WALKED),
    "a guard of no mode": ("next = (s->mode[lane] == PMSM_FAULT) ?", "next = (s->mode[lane] == -9) ?", WALKED),
    "a mask that is forgotten": (
        " hit_12 = hit_11 & ((status[lane] & PMSM_INPUT",
        " hit_12 = ((status[lane] & PMSM_INPUT",
        WALKED,
    ),
    "idle lanes go on": ("copy_lane(&d->control, &kept, sizeof(kept), lane);", ";", DRIVEN),
    "the gain of before": ("    d->control.gain[MAX_CURRENT] = max_current;\n", "", DRIVEN),
    "a field that is not read": ("    own->steady = all->steady[lane];\n", "", f"lanes filled and read; {WALKED}"),
}


@pytest.mark.parametrize("wrong", LANES)
def test_a_wrong_lane_form_is_told(wrong: str) -> None:
    old, new, where = LANES[wrong]
    folder, file = GeneratedFolder(GENERATED / ALONE), f"host/{ALONE}_ckf_drive_lanes.c"
    text = folder.text(file)
    assert text.count(old) == 1
    link = link_drive_lanes(
        overlaid(folder, file, text.replace(old, new)), "ckf", "as shipped", load_drive(ALONE).model_dump()
    )
    assert not link.passed
    assert failed(link).startswith(where), failed(link)
