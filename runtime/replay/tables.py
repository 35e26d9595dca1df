"""The results of a replay, as Rich tables."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from runtime.recorded.truth import Errors
from runtime.replay.replay import NOT_CONVERGED, REJECTED, Replay
from runtime.replay.statistics import LAGS, Consistency
from runtime.style.tables import columns_table, pairs_table


def replay_tables(replay: Replay) -> RenderableType:
    """Run, errors against the truth, innovation statistics.

    Parameters
    ----------
    replay : Replay

    Returns
    -------
    rich renderable
    """
    parts: list[RenderableType] = [_run(replay), ""]
    if replay.errors is not None:
        parts += [_errors(replay.errors, "theta" in replay.conventions), ""]
    if replay.consistency is not None:
        parts += [_consistency(replay.consistency), Text(replay.consistency.verdict)]
    else:
        parts += ["too few measurements were taken for statistics of the innovations"]
    return Group(*parts)


def _run(replay: Replay) -> Table:
    t = replay.recorded.t
    backend = {"c": "generated C", "numpy": "generated NumPy"}[replay.backend]
    sigma = replay.P(slice(-1, None))[0].diagonal() ** 0.5
    end = zip(replay.state_names, replay.x[-1], sigma, replay.state_units, strict=True)
    counts = f"{replay.count(REJECTED):,} rejected, {replay.count(NOT_CONVERGED):,} iterations not converged"
    return pairs_table(
        [
            ("filter", f"{replay.drive} {replay.kind}, {backend}, {replay.dtype}"),
            ("data", f"{len(t):,} samples, {t[-1] - t[0]:.6g} s, T = {replay.sample_time * 1e6:g} us"),
            ("status", counts),
            ("at the end", ", ".join(f"{name} {x:.5g} +- {s:.2g} {unit}" for name, x, s, unit in end)),
        ]
    )


def _errors(errors: Errors, other_convention: bool) -> Table:
    stepped = errors.load_step_at is not None
    step = f" at {errors.load_step_at:.4g} s" if stepped else ""
    rows = (
        (f"speed, largest{' before the load step' if stepped else ''}", errors.speed_start, "r/min"),
        ("speed, rms at the end", errors.speed_steady_rms, "r/min"),
        (f"speed, largest after the load step{step}", errors.speed_load_step, "r/min"),
        ("position, largest", errors.position_max, "deg electrical"),
        ("position, rms at the end", errors.position_steady_rms, "deg electrical"),
        ("position, last row", errors.position_end, "deg electrical"),
        ("load torque, rms at the end", errors.load_torque_steady_rms, "N m"),
        ("load torque, last row", errors.load_torque_end, "N m"),
    )
    table = columns_table("estimate minus truth", "", "", left=(0, 2))
    for what, value, unit in rows:
        if value is not None:
            table.add_row(what, f"{value:.3f}", unit)
    if errors.lost and other_convention:
        table.add_row(Text("the truth's angle has another convention, as it seems", style="yellow"), "", "")
    elif errors.lost:
        table.add_row(Text("the rotor is LOST at the end", style="bold red"), "", "")
    return table


def _consistency(found: Consistency) -> Table:
    table = columns_table(
        "innovations, y minus what the filter expected", "found", "95 % of a consistent filter", left=(0, 2)
    )
    low, high = found.nis_band
    table.add_row("normalised innovation squared, mean", f"{found.nis_mean:.4g}", f"{low:.4g} .. {high:.4g}")
    table.add_row("steps inside their own 95 % band", f"{100 * found.nis_inside:.1f} %", "95 %")
    for name, bias in zip(("alpha", "beta"), found.bias, strict=True):
        table.add_row(f"mean, {name}, in sigma", f"{bias:+.4f}", f"+- {found.bias_band:.4f}")
    for name, row in zip(("alpha", "beta"), found.correlation, strict=True):
        lag = max(range(LAGS), key=lambda k: abs(row[k]))
        label = f"largest autocorrelation, {name} (lag {lag + 1})"
        table.add_row(label, f"{row[lag]:+.4f}", f"+- {found.correlation_band:.4f}")
    table.add_row(f"autocorrelations beyond the band, lags 1 .. {LAGS}", f"{100 * found.outside:.0f} %", "5 %")
    for name, p in zip(("alpha", "beta"), found.ljung_box, strict=True):
        table.add_row(f"Ljung-Box p, {name}", f"{p:.2g}", "over 0.05")
    return table
