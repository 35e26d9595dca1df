"""Link "modes": all that a declared machine can do, state by state: where it gets to, how it gets out, and how soon.

The states are the machine's modes with its integers. Where a property does not depend on how large the limits are,
small ones stand for them, in the same order: a count of 3 that ends at 3 takes the way of one of 30 that ends at 30,
as all counts go on by one or begin anew. How long a mode lasts does depend on them; it is found with the limits as
they are, of the integers that have a part in it, the others answering both ways: no mode lasts longer than that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from model.filters.conditions import Compare, Entry, Name, square
from model.supervisor.words import Supervisor
from runtime.proof.abstract import Machine, State, Taken, liveness, relevant
from runtime.proof.mode_numbers import READINGS
from runtime.proof.result import Link, Row

#: Where no gate may be on, whatever else is declared.
OFF = ("RESTING", "WAITING", "FAULT")
#: Reasons that no further attempt can mend.
AT_ONCE = (("RUNNING", "PHASE"), ("RESTING", "CURRENT"))
#: What a count's limit becomes: so large that a count can be none, some and enough, and a start has its good window
#: and the one that ends it.
ENOUGH = 2
#: So many readings of a current: none, the first, one that does not tell which way the rotor turns, and enough.
ENOUGH_READINGS = 3
#: Where every count ends, beyond all limits.
LAST = "MOST_SAMPLES"
#: What the reference's square is beyond where it asks for motion.
STILL = "STILL_SQUARED"
#: States after which the search gives up: the machine has some thousands.
MOST_STATES = 200_000
#: Integers that tell how long a mode lasts; the longest stay is found with these as they are.
CLOCKS = ("since", "mirrored", "readings", "windows")


@dataclass
class Explored:
    """The reachable states, and what an interrupt does from each."""

    machine: Machine
    edges: dict[State, list[Taken]] = field(default_factory=dict)

    def from_states(self, first: list[State]) -> Explored:
        """Everything that can be reached.

        Parameters
        ----------
        first : list of State

        Raises
        ------
        RuntimeError
            There are more states than can be looked at.
        """
        waiting = list(first)
        while waiting:
            state = waiting.pop()
            if state in self.edges:
                continue
            if len(self.edges) > MOST_STATES:
                raise RuntimeError(f"more than {MOST_STATES} states of the supervisor")
            found = {(taken.number, taken.after): taken for taken in self.machine.interrupts(state)}
            self.edges[state] = list(found.values())
            waiting += [taken.after for taken in found.values()]
        return self

    def reaching(self, wanted: set[State]) -> set[State]:
        """States from which some way leads to one of these.

        Parameters
        ----------
        wanted : set of State
        """
        before: dict[State, list[State]] = {}
        for state, taken in self.edges.items():
            for one in taken:
                before.setdefault(one.after, []).append(state)
        found, waiting = set(wanted), list(wanted)
        while waiting:
            for state in before.get(waiting.pop(), []):
                if state not in found:
                    found.add(state)
                    waiting.append(state)
        return found


def small_limits(machine: Supervisor) -> dict[str, float]:
    """The limits with small numbers in the place of those that integers are compared with, in the same order.

    Times, which may run side by side, keep their order among each other: by how many of them are smaller. Other counts
    end at :data:`ENOUGH`.

    Parameters
    ----------
    machine : Supervisor
    """
    limits = {limit.name: limit.value for limit in machine.limits}
    timed = {name for name in limits if name.endswith("_SAMPLES")} - {LAST}
    times = sorted({limits[name] for name in timed})
    small = {name: min(value, ENOUGH) for name, value in limits.items() if isinstance(value, int)}
    small |= {name: 1 + times.index(limits[name]) for name in timed}
    small["MAX_READINGS"] = ENOUGH_READINGS
    return limits | small | {LAST: len(times) + ENOUGH}


def _compared(machine: Supervisor) -> dict[str, set[str]]:
    """By integer: the limits that it is compared with."""
    found: dict[str, set[str]] = {}
    for transition in machine.transitions:
        for part in _parts(transition.guard):
            if isinstance(part.left, Entry) and part.left.place is None and isinstance(part.right, Name):
                found.setdefault(part.left.name, set()).add(part.right.name)
    return found


def _parts(condition: object) -> Iterator[Compare]:
    if isinstance(condition, Compare):
        yield condition
    inner = getattr(condition, "conditions", (getattr(condition, "condition", None),))
    for part in inner:
        if part is not None:
            yield from _parts(part)


def explore(machine: Supervisor) -> Explored:
    """All states that are reached from power-up, and from a self-test that failed.

    Parameters
    ----------
    machine : Supervisor
    """
    abstract = Machine(machine, small_limits(machine), relevant(machine))
    abstract.live = liveness(abstract)
    zeros = dict.fromkeys(abstract.kept, 0)
    none, refused = ("another", "REASON_SELF_TEST")
    first = [
        abstract.state("RESTING", {**zeros, "reason": none}),
        abstract.state("FAULT", {**zeros, "reason": refused}),
    ]
    return Explored(abstract).from_states(first)


# --- how long


def longest_stay(machine: Supervisor, modes: tuple[str, ...]) -> float:
    """Interrupts after which the last of these modes is left, at most; infinite where it may never be.

    Of the time in a mode only the numbers at a limit differ in what may happen: all before take the same ways, and the
    last of them leaves latest. Where nothing turns PROBING waits for a reference that asks for motion: here it does.

    Parameters
    ----------
    machine : Supervisor
    modes : tuple of str
        The first is where it begins.
    """
    limits = {limit.name: limit.value for limit in machine.limits}
    kept = frozenset(relevant(machine) & set(CLOCKS))
    wanted = {square(Name("reference")): limits[STILL]} if STILL in limits else {}
    abstract = Machine(machine, limits, kept, wanted)
    ends = sorted({int(limits[name]) for name in _compared(machine)["since"]})
    ends = sorted({end + more for end in ends for more in (-1, 0)} | {1})
    known: dict[State, float] = {}
    open_states: set[State] = set()

    def longest(state: State) -> float:
        """From a state after an interrupt, before the next one counts."""
        mode, values = state[0], dict(state[1])
        if mode not in modes:
            return 0.0
        if state in known:
            return known[state]
        if state in open_states or len(known) > MOST_STATES:
            return float("inf")
        open_states.add(state)
        later = next((end for end in ends if end > values["since"]), None)
        if later is None:
            return float("inf")
        values["since"] = later - 1  # what comes between stays as it may
        wait = later - 1 - dict(state[1])["since"]
        steps = {taken.after for taken in abstract.interrupts(abstract.state(mode, values))}
        known[state] = wait + 1 + max(longest(after) for after in steps)
        open_states.discard(state)
        return known[state]

    begins = [dict.fromkeys(kept, 0) | {name: value} for name in kept - {"since"} for value in (0, 1)]
    return max(longest(abstract.state(modes[0], {**values, "since": 0, "windows": 0})) for values in begins)


# --- the link


def link_exhaust(machine: Supervisor, drive: str, sample_time: float, promised: Mapping[str, int]) -> Link:
    """What holds of every state that the machine can be in.

    Parameters
    ----------
    machine : Supervisor
    drive : str
        Its name.
    sample_time : float
        s.
    promised : mapping of str to int
        Samples that a mode may last, as the statement by hand has them.
    """
    found = explore(machine)
    rows = (*_reached(found), *_off(found), *_out(found), *_failures(found), *_times(machine, sample_time, promised))
    data = f"{len(found.edges)} states, {sum(map(len, found.edges.values()))} interrupts"
    return Link("modes", "declared machine, every state", drive, "", "", data, tuple(rows))


def _row(stage: str, meaning: str, wrong: int, compared: int) -> Row:
    return Row("-", stage, meaning, float(wrong), 0.0, compared)


def _reached(found: Explored) -> Iterator[Row]:
    m = found.machine.machine
    modes = {state[0] for state in found.edges}
    taken = Counter(one.number for edges in found.edges.values() for one in edges)
    never = [number for number in range(1, len(m.transitions) + 1) if not taken[number]]
    yield _row("every mode is reached", "modes that are not", len(set(found.machine.modes) - modes), len(m.modes))
    which = f": {never[0]}" if never else ""
    yield _row(f"every transition can be taken{which}", "that cannot", len(never), len(m.transitions))


def _off(found: Explored) -> Iterator[Row]:
    """Gates are off where they must be; torque takes a filter that runs, and that an inverter."""
    modes = found.machine.modes.values()
    on = sum(mode.inverter for mode in modes if mode.name in OFF)
    held = sum(not mode.inverter for mode in modes if mode.name not in OFF)
    yield _row("inverter off in RESTING, WAITING and FAULT", "modes in which it is not", on, len(OFF))
    yield _row("inverter on elsewhere", "modes in which it is not", held, len(modes) - len(OFF))
    odd = sum(
        (mode.aligns and (mode.runs or mode.torque or not mode.inverter))
        or (mode.torque and not mode.runs)
        or (mode.runs and not mode.inverter)
        or (mode.rivals and not mode.torque)
        for mode in modes
    )
    yield _row("torque only where the filter runs, and that only with the inverter", "modes", odd, len(modes))
    direct = sum(one.after[0] == "RUNNING" and state[0] in OFF for state, edges in found.edges.items() for one in edges)
    yield _row("no torque straight after the inverter was off", "interrupts", direct, len(found.edges))


def _out(found: Explored) -> Iterator[Row]:
    """Some way leads to RUNNING from everywhere, but after a self-test that failed: there none leads anywhere."""
    running = {state for state in found.edges if state[0] == "RUNNING"}
    faults = {state for state in found.edges if state[0] == "FAULT"}
    refused = {state for state in faults if dict(state[1]).get("reason") == "REASON_SELF_TEST"}
    stuck = set(found.edges) - found.reaching(running) - refused
    yield _row("a way to RUNNING from every state", "states without", len(stuck), len(found.edges))
    leaving = sum(one.after not in refused or one.number != 0 for state in refused for one in found.edges[state])
    none = leaving + (not refused)
    yield _row("only power-up leaves a self-test that failed", "ways out", none, len(refused))
    entering = sum(
        one.after in refused for state, edges in found.edges.items() if state not in refused for one in edges
    )
    yield _row("no fault of the drive is taken for that one", "ways in", entering, len(found.edges))


def _failures(found: Explored) -> Iterator[Row]:
    """An attempt that fails is counted; so many in a row end in FAULT, and nothing but success forgets them.

    What no attempt can mend ends there at once.
    """
    rows = enumerate(found.machine.machine.transitions, start=1)
    at_once = {number for number, row in rows if row.target == "FAULT" and (row.source, row.reason) in AT_ONCE}
    most = found.machine.limits["MAX_FAILURES"]
    uncounted = forgotten = missed = entered = 0
    for state, edges in found.edges.items():
        before = dict(state[1]).get("failures", 0)
        for one in edges:
            after = dict(one.after[1]).get("failures", 0)
            fails = one.after[0] == "RESTING" and state[0] not in {"RESTING", "FAULT"}
            uncounted += fails and after != min(before + 1, most)
            success = state[0] == one.after[0] == "RUNNING" or state[0] == "FAULT" or one.after[0] == "FAULT"
            forgotten += after < before and not success
            if state[0] == "RESTING" and before >= most:
                entered += 1
                missed += one.after[0] != "FAULT"
            else:
                missed += one.after[0] == "FAULT" and state[0] != "FAULT" and one.number not in at_once
    count = sum(map(len, found.edges.values()))
    yield _row("every attempt that fails is counted", "that are not", uncounted, count)
    yield _row("only success or an acknowledgement forgets", "interrupts that do else", forgotten, count)
    missed += entered == 0
    yield _row(
        "so many failures in a row, an open phase, or currents that never rest, and nothing else, end in FAULT",
        "interrupts that do else",
        missed,
        entered,
    )


def _times(machine: Supervisor, sample_time: float, promised: Mapping[str, int]) -> Iterator[Row]:
    """Every mode that must end ends in time; and the attempt as a whole."""
    must_end = tuple(mode.name for mode in machine.modes if not mode.lasting)
    attempt = tuple(mode for mode in must_end if mode != "RESTING")
    for mode in must_end:
        stay = longest_stay(machine, (mode,))
        took = f"{stay:.0f} samples, {1e3 * sample_time * stay:.4g} ms"
        yield Row("-", f"{mode} ends: {took}", "samples beside the promise", abs(stay - promised.get(mode, 0)), 0.0, 1)
    first = "PROBING"
    if first in must_end:
        again = (READINGS - 1) * (promised[first] + promised.get("WAITING", 0))  # each reading's current dies out
        stay = longest_stay(machine, (first, *attempt))
        allowed = sum(promised[mode] for mode in attempt) + again
        took = f"{stay:.0f} samples, {1e3 * sample_time * stay:.4g} ms"
        yield Row("-", f"from {first} to RUNNING or RESTING: {took}", "samples", stay, float(allowed), 1)
