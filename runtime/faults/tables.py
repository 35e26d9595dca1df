"""Tables of faults in operation: whether, and how fast, a drive recovers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table
from rich.text import Text

from runtime.drive.scenario import LATE, REACHED_OF_RATED
from runtime.faults.standstill import BACK_TIME, SLIP_SHARE
from runtime.faults.starts import Start, Starts, largest, times
from runtime.faults.survey import ALONE_SEEDS, ANGLE_BAND, Outcome, Recovery, column
from runtime.style.tables import columns_table

LEGEND = (
    f"recovery: from the fault's end until the drive has torque and the estimate stays within {REACHED_OF_RATED:.0%} "
    f"of rated speed and {ANGLE_BAND:g} degrees electrical of the truth, median (worst). Since the fault began, worst "
    "of all runs: errors of the estimate while the drive had torque, dip of the true speed, current. said: status bits "
    "in the fault and 10 ms behind it, and in how many runs a bit or a reaction came, if not in all; at: its sample, "
    f"the latest. alone: the generated controller without the example interrupt's reaction, {ALONE_SEEDS} runs at most."
)

COLUMNS = ("fault", "recovered", "recovery, ms", "r/min", "deg", "dip", "A", "said", "at")
ALONE = ("alone", "ms", "dip", "A")


def fault_table(outcomes: Sequence[Outcome]) -> Table:
    """One drive with one filter: a row a fault."""
    names = *COLUMNS, *ALONE
    table = columns_table(*names, left=(0, 7), whole=range(len(names)))
    for outcome in outcomes:
        table.add_row(*_cells(outcome))
    return table


def _cells(outcome: Outcome) -> list[str | Text]:
    runs, alone = outcome.recoveries, outcome.alone
    return [
        outcome.fault.title,
        Text(count_text(runs), style="green" if outcome.recovered else "bold red"),
        recovery_text(runs),
        worst_text(runs, "speed_error"),
        worst_text(runs, "angle_error"),
        worst_text(runs, "deviation"),
        worst_text(runs, "current"),
        said_text(runs),
        told_text(runs),
        count_text(alone),
        recovery_text(alone),
        worst_text(alone, "deviation"),
        worst_text(alone, "current"),
    ]


def count_text(runs: Sequence[Recovery]) -> str:
    """How many of all recovered, and how many ended in FAULT with the reason said."""
    off = sum(run.safe and not run.recovered for run in runs)
    return f"{sum(run.recovered for run in runs)}/{len(runs)}" + (f", {off} in FAULT" if off else "")


def recovery_text(runs: Sequence[Recovery]) -> str:
    """Median and worst recovery time, ms."""
    times = column([run for run in runs if run.recovered], "time") * 1e3
    return f"{np.median(times):.1f} ({np.max(times):.1f})" if len(times) else "-"


def worst_text(runs: Sequence[Recovery], name: str) -> str:
    """The largest of a figure; a run that did not stay a number is the worst."""
    worst = float(np.max(column(runs, name)))
    return f"{worst:.0f}" if np.isfinite(worst) else "no number"


def said_text(runs: Sequence[Recovery]) -> str:
    """The bits that any of the runs saw, and in how many of them anything was said."""
    bits = int(np.bitwise_or.reduce(column(runs, "status")))
    heard = int(np.count_nonzero(column(runs, "told") >= 0))
    share = "" if heard in (0, len(runs)) else f" {heard}/{len(runs)}"
    return (f"0x{bits:x}" if bits else "-") + share


def told_text(runs: Sequence[Recovery]) -> str:
    """The latest first sample at which something was said."""
    told = int(np.max(column(runs, "told")))
    return f"{told}" if told >= 0 else "-"


STARTS_LEGEND = (
    f"locked: in the last {LATE * 1e3:g} ms the drive runs, the estimated angle stays within {ANGLE_BAND:g} degrees "
    "electrical of the truth, and the rotor turns as it should. ms: from power-up (of a reversal: from its end) until "
    "that holds for good, median (worst). kept: runs that never left RUNNING again. FAULT: runs that ended there, "
    "inverter off. Worst of all runs: deg, angle error while running; wrong way, speed against the reference, r/min; "
    "current, share of the largest."
)
#: What the words mean in a row of standstill.
STANDSTILL_LEGEND = (
    f"standstill, locked: a salient drive ran all the time under load, its angle within {ANGLE_BAND:g} degrees, and "
    f"turned as wanted afterwards; a round rotor may have slipped, but turned no faster than {SLIP_SHARE:.0%} of rated "
    f"speed and was back {BACK_TIME * 1e3:g} ms after the reference had risen, or ended in FAULT if the drive has no "
    "rival filter. ms: from when it was wanted to turn again. wrong way: speed either way while rest was wanted. "
    "ripple: amplitude of the injected current, % of what rated torque takes, or of the largest where none is stated."
)
#: What the words mean in a row of slow starts.
SLOW_LEGEND = (
    f"slow, locked: as from rest, and never in FAULT; a salient drive was within {ANGLE_BAND:g} degrees at the crawl, "
    "too; one without a rival filter may have ended in FAULT. ms: from when the rated speed was wanted. deg: at the "
    "crawl; of a round rotor it says nothing."
)

STARTS_COLUMNS = (
    "drive",
    "filter",
    "task",
    "runs",
    "locked",
    "FAULT",
    "ms",
    "kept",
    "deg",
    "wrong way",
    "current",
    "ripple",
)


def starts_table(starts: Sequence[Starts]) -> Table:
    """A row a drive, filter and task."""
    table = columns_table(*STARTS_COLUMNS, left=(0, 1, 2), whole=range(len(STARTS_COLUMNS)))
    for item in starts:
        runs, until = item.runs, times(item.runs)
        table.add_row(
            item.drive,
            item.kind,
            item.task.title,
            str(len(runs)),
            Text(str(sum(run.locked for run in runs)), style="green" if item.locked else "bold red"),
            str(sum(bool(run.gave_up) for run in runs)),
            f"{until[0] * 1e3:.0f} ({until[1] * 1e3:.0f})" if until else "-",
            str(sum(run.kept for run in runs)),
            _largest(runs, "angle", ".0f"),
            _largest(runs, "wrong_way", ".0f") if item.task.told else "-",
            _largest(runs, "current", ".2f"),
            _largest(runs, "ripple", ".1%").rstrip("%"),
        )
    return table


def _largest(runs: Sequence[Start], name: str, spec: str) -> str:
    """The largest of a figure, or a dash where the task does not ask for it."""
    value = largest(runs, name)
    return format(value, spec) if value == value else "-"
