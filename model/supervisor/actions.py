"""What the supervisor counts at every interrupt, and what its transitions do."""

from __future__ import annotations

from model.alignment import aligns
from model.filters.conditions import (
    All,
    Compare,
    Condition,
    Either,
    Entry,
    Name,
    Not,
    Number,
    Operation,
    Reported,
    Value,
    Whole,
    square,
    total,
)
from model.filters.program import Call, Count, If, Node, Restart, Set, Wrap
from model.machines.state_space import StateSpaceModel
from model.schema import Drive
from model.supervisor.blocks import axis_block, onward_block, place_block, probe_block, reading_block, turning_block
from model.supervisor.words import Action, CopyFilter, ExchangeFilters, equals, is_label, within


def watch(drive: Drive, model: StateSpaceModel, rivals: bool) -> tuple[Node, ...]:
    """What is counted in every mode, and of the step that ran.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    rivals : bool
        There is a second filter.
    """
    probe, phase = [Entry("probe", k) for k in range(2)], [Entry("phase", k) for k in range(2)]
    trip = Name("TRIP_SQUARED")
    good = All((equals("rejected", 0), equals("diverged", 0), Not(Reported(("RESTARTED",)))))
    return (
        Count("since", "MOST_SAMPLES"),
        _way(probe[0], rivals),
        If(
            is_label("mode", "PROBING"),
            (Set(probe[1], Operation("+", probe[1], Number(1.0))),),
            (Set(probe[1], Number(0.0)),),
        ),
        *(_asked(probe[0]) if rivals else ()),
        If(is_label("mode", "WAITING"), (Call(onward_block(drive)),)),
        _eased(),
        *(_aligning(drive, model) if aligns(drive) else ()),
        If(
            is_label("mode", "RESTING"),
            (_in_a_row("quiet", within("phase", "ZERO_SQUARED"), "REST_SAMPLES"),),
            (_clear("quiet"),),
        ),
        If(Not(is_label("mode", "FAULT")), (_clear("acknowledged"),)),
        _in_a_row("excess", Either(tuple(Compare(">", square(i), trip) for i in phase)), "MAX_EXCESS"),
        If(
            equals("runs", 1),
            (
                _in_a_row("rejected", Reported(("INPUT_REJECTED",)), "MAX_REJECTED"),
                _in_a_row("diverged", Reported(("DIVERGED",)), "MAX_DIVERGED"),
                _in_a_row("content", good, "LOCKED_SAMPLES"),
                Call(turning_block(drive, model)),
                _silence(model, phase),
                _in_a_row("open", Either(tuple(_half_turn(k) for k in range(3))), "MAX_OPEN"),
            ),
        ),
    )


def _way(way: Entry, rivals: bool) -> If:
    """Where the reference points; a start goes on as it began while no motion is asked for, or NaN is."""
    forward, backward = (Set(way, Number(1.0)),), (Set(way, Number(-1.0)),)
    pointing = If(Compare("<", Name("reference"), Number(0.0)), backward, forward)
    if not rivals:
        return pointing
    wanted = Compare(">", square(Name("reference")), Name("STILL_SQUARED"))
    return If(wanted, (pointing,), (If(Not(Compare("<", way, Number(0.0))), forward),))


def _asked(way: Value) -> tuple[Node, ...]:
    """A start turns fast enough that its windows tell the angle, whatever the reference is; NaN stays what it is."""
    asked, reference = Entry("asked", 0), Name("reference")
    slow = Compare("<", square(reference), Name("START_SPEED_SQUARED"))
    return Set(asked, reference), If(slow, (Set(asked, Operation("*", way, Name("START_SPEED"))),))


def _eased() -> If:
    """A rotor that was caught gets its torque little by little, from the first step on; any other all of it."""
    eased = Entry("eased", 0)
    more = Set(eased, Operation("+", eased, Name("EASE")))
    return If(
        is_label("mode", "CATCHING"),
        (Set(eased, Name("EASE")),),
        (
            If(is_label("mode", "RUNNING"), (more,), (Set(eased, Number(1.0)),)),
            If(Not(Compare("<=", eased, Number(1.0))), (Set(eased, Number(1.0)),)),
        ),
    )


def _aligning(drive: Drive, model: StateSpaceModel) -> tuple[Node, ...]:
    """Calm is a current that points along the axis, once that has arrived: a rotor that swings makes one across it."""
    progress, axis = Entry("aligning", 0), [Entry("axis", k) for k in range(3)]
    arrived = Compare(">=", progress, Number(2.0))
    calm = _in_a_row("calm", All((arrived, within("missing", "ZERO_SQUARED"))), "CALM_SAMPLES")
    nothing = (*(Set(entry, Number(0.0)) for entry in (progress, *axis)), _clear("calm"))
    return (If(is_label("mode", "ALIGNING"), (Call(axis_block(drive, model)), calm), nothing),)


def _in_a_row(counter: str, where: Condition, most: str) -> If:
    """One more in a row, or none; never beyond a limit, as an int that counts on would come round."""
    return If(where, (Count(counter, most),), (_clear(counter),))


def _silent(k: int, current: Value) -> tuple[Set, If]:
    """How far the rotor turned while this phase carried no current and another one did; i_c = -(i_a + i_b)."""
    silent = Entry("silent", k)
    more = Set(silent, Operation("+", silent, Entry("turning", 4)))
    return more, If(Compare(">", square(current), Name("ZERO_SQUARED")), (Set(silent, Number(0.0)),))


def _silence(model: StateSpaceModel, phase: list[Entry]) -> If:
    """For how far the rotor turned without a current in a phase, where it turns fast enough that its speed is one.

    At rest R's voltage may be taken for a speed, and a phase has no current for as long as the rotor stands so.
    """
    omega = Entry("x", _rotor(model)[0])
    return If(
        Compare(">", square(omega), Name("OPEN_SPEED_SQUARED")),
        (
            If(
                Either(tuple(Compare(">", square(i), Name("PROBE_SQUARED")) for i in phase)),
                tuple(node for k, i in enumerate((*phase, total(*phase))) for node in _silent(k, i)),
                tuple(_less_silent(k) for k in range(3)),
            ),
        ),
    )


def _less_silent(k: int) -> If:
    """Where no phase carries a current a tenth of the turn is taken back: pulses now and then are no open phase."""
    silent, turn = Entry("silent", k), Entry("turning", 4)
    less = Operation("-", silent, Operation("*", Name("FORGOTTEN_TURN"), turn))
    return If(Compare(">", Operation("*", silent, turn), Number(0.0)), (Set(silent, less),))


def _half_turn(k: int) -> Condition:
    """So far a healthy phase is never silent; one whose sensor is stuck, or full, is for a while."""
    return Compare(">=", square(Entry("silent", k)), Name("SILENT_TURN_SQUARED"))


def _clear(counter: str) -> Set:
    return Set(Entry(counter), Whole(0))


def _mark(field: str) -> Set:
    return Set(Entry(field), Whole(1))


def _minus(value: Value) -> Operation:
    return Operation("-", Number(0.0), value)


def actions(drive: Drive, model: StateSpaceModel, rivals: bool) -> tuple[Action, ...]:
    """What transitions do.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    rivals : bool
        There is a second filter.
    """
    return (
        *_counting(),
        *_reading(drive),
        *_guesses(drive, model),
        *_filter_begins(model),
        *(_rival_begins(drive, model) if rivals else ()),
        *(_aligned(model) if aligns(drive) else ()),
    )


def _counting() -> tuple[Action, ...]:
    steady = Compare(">=", Entry("steady"), Name("STEADY_WINDOWS"))
    return (
        Action("fail", "One more attempt that failed.", (Count("failures", "MAX_FAILURES"),)),
        Action(
            "forget",
            "The next attempt is the first one again.",
            (
                _clear("failures"),
                _clear("reason"),
                _clear("open"),
                *(Set(Entry("silent", k), Number(0.0)) for k in range(3)),
            ),
        ),
        Action(
            "count_steady",
            "After some windows in a row the attempts that went before are forgotten.",
            (Count("steady", "STEADY_WINDOWS"), If(steady, (_clear("failures"),))),
        ),
        Action(
            "begin_anew",
            "Regulators have not regulated yet, and nothing is counted.",
            (_clear("rejected"), _clear("diverged"), _clear("content"), _mark("anew")),
        ),
        Action("void_voltages", "No voltage is under way: it was zero.", (_mark("fresh"),)),
    )


def _reading(drive: Drive) -> tuple[Action, ...]:
    """A current that zero voltage let flow."""
    named = ("reading", "first", "probe", "towards", "guess")
    reading, first, probe, towards, guess = ([Entry(name, k) for k in range(4)] for name in named)
    known = Set(Entry("readings"), Name("MAX_READINGS")), _mark("mirrored")
    forward = Compare(">", reading[3], Name("LEAST_SINE"))
    backward = Compare(">", _minus(reading[3]), Name("LEAST_SINE"))
    return (
        Action("await_reading", "No current was read yet.", (_clear("readings"),)),
        Action("take_reading", "The current's direction and size.", (Call(reading_block()),)),
        Action(
            "keep_reading",
            "The first reading, from which the later ones' angle counts.",
            (Set(first[0], reading[0]), Set(first[1], reading[1]), _mark("readings")),
        ),
        Action(
            "guess_from_probe",
            "The rotor turns as the current turned, if that was far enough; in the end as the reference says.",
            (
                Count("readings", "MAX_READINGS"),
                _clear("mirrored"),
                If(forward, (Set(probe[0], Number(1.0)), *known)),
                If(backward, (Set(probe[0], Number(-1.0)), *known)),
                Call(probe_block(drive)),
                Set(guess[2], towards[2]),
                Set(guess[3], towards[3]),
                If(Compare("<", towards[0], Number(0.0)), (Set(guess[3], Operation("-", Name("PI"), guess[3])),)),
                If(Compare("<", towards[1], Number(0.0)), (Set(guess[3], _minus(guess[3])),)),
                *_spread("UNKNOWN_SPEED", "UNKNOWN_ANGLE"),
            ),
        ),
    )


def _spread(speed: str, angle: str) -> tuple[Set, ...]:
    return Set(Entry("spread", 0), Name(speed)), Set(Entry("spread", 1), Name(angle))


def _guesses(drive: Drive, model: StateSpaceModel) -> tuple[Action, ...]:
    """Speed and angle to begin with, and the states that belong to them."""
    omega, theta = _rotor(model)
    half_turn = (
        Set(Entry("guess", 2), _minus(Entry("x", omega))),
        Set(Entry("guess", 3), Operation("+", Entry("x", theta), Name("PI"))),
    )
    return (
        Action(
            "guess_mirrored",
            "Half a turn on, and the other way round: what makes the same voltage at this instant.",
            (*half_turn, _mark("mirrored"), *_spread("UNKNOWN_SPEED", "UNKNOWN_ANGLE")),
        ),
        Action("place", "The states that carry the measured currents there.", (Call(place_block(drive)),)),
    )


def _rotor(model: StateSpaceModel) -> tuple[int, int]:
    names = [state.name for state in model.states]
    return names.index("omega"), names.index("theta")


def _filter_begins(model: StateSpaceModel) -> tuple[Action, ...]:
    """The filter from a guess, or as its file says; and torque."""
    names = [state.name for state in model.states]
    slow = [names.index(state.name) for state in model.adaptive.states]
    omega, theta = _rotor(model)
    x, guess = [Entry("x", k) for k in range(len(names))], [Entry("guess", k) for k in range(4)]
    speed, angle = Entry("spread", 0), Entry("spread", 1)

    def variance(state: int, value: Value) -> Set:
        return Set(Entry("variance", state), value)

    flux = tuple(variance(k, Operation("*", Name("FLUX_SQUARED"), angle)) for k in range(2))
    return (
        Action(
            "start_filter",
            "The filter from anew at the guess, with the guess's spread.",
            (
                Restart(),
                *(Set(x[state], guess[k]) for k, state in enumerate((0, 1, omega, theta))),
                Wrap(x[theta]),
                *(flux if model.states[0].unit == "Wb" else ()),
                variance(omega, speed),
                variance(theta, angle),
                *(variance(k, Operation("*", Name("HELD"), Entry("P_0", k))) for k in slow),
            ),
        ),
        Action("start_at_rest", "The filter as the drive file begins it.", (Restart(), _clear("steady"))),
        Action(
            "learn",
            "Torque is allowed, and motor data that are states are learnt again." if slow else "Torque is allowed.",
            (*(variance(k, Entry("P_0", k)) for k in slow), _clear("steady")),
        ),
        Action(
            "begin_window",
            "From here on the angle's turning is compared with the speed.",
            (
                Set(Entry("turning", 0), Number(0.0)),
                Set(Entry("turning", 1), Number(0.0)),
                Set(Entry("turning", 2), x[theta]),
            ),
        ),
    )


def _aligned(model: StateSpaceModel) -> tuple[Action, ...]:
    """The rotor stands along the axis, or as far from there as its load turns it."""
    guess, (_, theta) = [Entry("guess", k) for k in range(4)], _rotor(model)
    place = Set(guess[2], Number(0.0)), Set(guess[3], Entry("x_0", theta))
    return (
        Action("guess_aligned", "The rotor stands along the axis.", (*place, *_spread("REST_SPEED", "START_ANGLE"))),
    )


def _rival_begins(drive: Drive, model: StateSpaceModel) -> tuple[Action, ...]:
    """A start from an unknown angle: where filter and rival begin, and begin again."""
    omega, theta = _rotor(model)
    guess, x = [Entry("guess", k) for k in range(4)], [Entry("x", k) for k in range(len(model.states))]
    aside = If(
        equals("side", 0),
        (Set(guess[3], Operation("+", x[theta], Name("HALF_PI"))), _mark("side")),
        (Set(guess[3], Operation("-", x[theta], Name("HALF_PI"))), _clear("side")),
    )
    rest = _spread("REST_SPEED", "START_ANGLE")
    return (
        Action("copy_filter", "The rival is what the filter is, tuned as it is.", (CopyFilter(),)),
        Action("exchange_filters", "The rival is followed from now on.", (ExchangeFilters(), _clear("good"))),
        Action(
            "guess_rest",
            "The rotor stands, or nearly, where the drive file says;",
            (Set(guess[2], Number(0.0)), Set(guess[3], Entry("x_0", theta)), *rest, _clear("windows"), _clear("good")),
        ),
        Action("guess_opposite", "or half a turn from there.", (Set(guess[3], Operation("+", guess[3], Name("PI"))),)),
        Action(
            "guess_half_turn",
            "The rival half a turn from the filter, which turned.",
            (
                Set(guess[2], _minus(x[omega])),
                Set(guess[3], Operation("+", x[theta], Name("PI"))),
                *_spread("MIRROR_SPEED", "START_ANGLE"),
            ),
        ),
        Action(
            "guess_aside",
            "The rival a quarter of a turn from the filter, on either side in turn: nothing turned.",
            (Set(guess[2], Number(0.0)), aside, *rest),
        ),
        Action("count_window", "One more window of STARTING.", (Count("windows", "MAX_WINDOWS"),)),
        Action(
            "level_scores",
            "Both filters are judged by what they expect from now on.",
            (Set(Entry("nis"), Number(0.0)), Count("windows", "MAX_WINDOWS")),
        ),
        Action("count_good", "One more window in which the angle turned as stated.", (Count("good", "GOOD_WINDOWS"),)),
        Action("count_none", "The next good window is the first one.", (_clear("good"),)),
    )
