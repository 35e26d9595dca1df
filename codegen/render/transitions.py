"""A machine told in words: what each mode allows and how long it may last, and the table of transitions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from model.filters.conditions import (
    All,
    Compare,
    Condition,
    Either,
    Entry,
    Label,
    Name,
    Not,
    Number,
    Operation,
    Reported,
    Value,
    Whole,
)
from model.supervisor.words import OnRival, Supervisor

#: The longest stays in samples, by the machine's limits. A rotor is caught by two guesses, one by one; that the last
#: window is over shows at the next interrupt.
STAYS: dict[str, Callable[[dict[str, int]], int]] = {
    "RESTING": lambda limits: limits["RESTLESS_SAMPLES"],
    "PROBING": lambda limits: limits["PROBE_SAMPLES"],
    "WAITING": lambda limits: limits["WAIT_SAMPLES"],
    "CATCHING": lambda limits: 2 * limits["CATCH_SAMPLES"],
    "STARTING": lambda limits: limits["MAX_WINDOWS"] * limits["WINDOW_SAMPLES"] + 1,
    "ALIGNING": lambda limits: limits["ALIGN_SAMPLES"],
}


def longest_stays(machine: Supervisor) -> dict[str, int]:
    """The most samples that a mode lasts, by its name; those that may last for ever are not named.

    Parameters
    ----------
    machine : Supervisor
    """
    limits = {limit.name: int(limit.value) for limit in machine.limits}
    return {mode.name: STAYS[mode.name](limits) for mode in machine.modes if not mode.lasting}


def stay_texts(machine: Supervisor, sample_time: float) -> dict[str, str]:
    """The longest stays as words, by the mode's name.

    Parameters
    ----------
    machine : Supervisor
    sample_time : float
        s.
    """
    stays = longest_stays(machine)
    texts = {name: f"at most {1e3 * count * sample_time:.3g} ms" for name, count in stays.items()}
    return texts | {name: f"{texts[name]}, or no motion is asked for" for name in waiting(machine)}


def waiting(machine: Supervisor) -> tuple[str, ...]:
    """Modes that last on, beyond their longest stay, while the reference asks for no motion.

    Parameters
    ----------
    machine : Supervisor
    """
    return ("PROBING",) if machine.rivals else ()


def spell_value(value: Value) -> str:
    """A number, as a guard's reader has it.

    Parameters
    ----------
    value : Value

    Examples
    --------
    >>> spell_value(Operation("*", Entry("turning", 0), Entry("turning", 0)))
    'turning[0]^2'
    """
    if isinstance(value, Entry):
        return value.name if value.place is None else f"{value.name}[{value.place}]"
    if isinstance(value, Operation):
        if value.sign == "*" and value.left == value.right and isinstance(value.left, Entry):
            return f"{spell_value(value.left)}^2"
        return f"{spell_value(value.left)} {value.sign} {spell_value(value.right)}"
    if isinstance(value, Name | Label):
        return value.name
    assert isinstance(value, Number | Whole)
    return f"{value.value:g}"


def spell_condition(condition: Condition, inside: type | None = None) -> str:
    """A guard, as one says it.

    Parameters
    ----------
    condition : Condition
    inside : type, optional
        The kind of the one that it is part of: it is in brackets where they say anything.

    Examples
    --------
    >>> spell_condition(All((Compare(">=", Entry("since"), Name("MOST")), Not(Reported(("DIVERGED",))))))
    'since >= MOST and not status DIVERGED'
    """
    if isinstance(condition, All | Either):
        word = " and " if isinstance(condition, All) else " or "
        text = word.join(spell_condition(one, type(condition)) for one in condition.conditions)
        return text if inside in (None, type(condition)) else f"({text})"
    if isinstance(condition, Not):
        return f"not {spell_condition(condition.condition, Not)}"
    if isinstance(condition, Reported):
        return f"status {' or '.join(condition.bits)}"
    assert isinstance(condition, Compare)
    text = f"{spell_value(condition.left)} {condition.sign} {spell_value(condition.right)}"
    return text.replace("==", "=")


def modes_context(machine: Supervisor, sample_time: float) -> dict[str, Any]:
    """What the report tells of the machine.

    Parameters
    ----------
    machine : Supervisor
    sample_time : float
        s.
    """
    stays = {name: f"{1e3 * count * sample_time:.3g}" for name, count in longest_stays(machine).items()}
    stays |= {name: f"{stays[name]}; more where no motion is asked for" for name in waiting(machine)}
    return {
        "rivals": machine.rivals,
        "modes": [{"mode": mode, "stay": stays.get(mode.name, "no limit")} for mode in machine.modes],
        "transitions": [
            {
                "number": number,
                "source": t.source,
                "target": t.target or "stays",
                "where": spell_condition(t.guard),
                "why": t.why,
                "actions": ", ".join(f"{a.name} (rival)" if isinstance(a, OnRival) else a for a in t.actions),
                "reason": t.reason,
            }
            for number, t in enumerate(machine.transitions, start=1)
        ],
        "reasons": machine.reasons,
    }
