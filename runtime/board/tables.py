"""Results of a board, as Rich tables: a run of link G, and a recording while it goes on."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from runtime.board.pil import PilResult, tick_facts
from runtime.board.record import COLUMNS, Recording
from runtime.style.tables import pairs_table

BAR = 40


def pil_tables(result: PilResult, ticks_hz: float | None) -> RenderableType:
    """Steps, line and time of a run.

    Parameters
    ----------
    result : PilResult
        The result.
    ticks_hz : float or None
        Rate of the board's timer, Hz; None: not known.
    """
    identity, counts = result.identity, result.counts
    how = "from equal starts, on its own bits" if result.mode == "free" else "each from the board's state before it"
    steps = f"{result.compared:,} compared, {len(result.lost):,} lost on the line, of {result.wanted:,}; {how}"
    agreed = "identical bits" if result.tolerance == "bits" else "within the certificate"
    rows = [
        ("board", f"{identity.drive} {identity.kind}, firmware of pmsm-ickf {identity.version}"),
        ("steps", steps),
        (agreed, f"{result.compared - result.different:,} of {result.compared:,} steps"),
    ]
    if result.tolerance == "certificate":
        beyond = f"; {result.beyond:,} steps beyond it, judged by what float32 does there on the host"
        used = f"{result.used:.3g} of what it allows, at most" + (beyond if result.beyond else "")
        rows.append(("certificate used", used))
    rows.append(
        (
            "line",
            f"{counts.requests:,} requests, sent again {counts.resent:,} times: {counts.damaged_answers:,} damaged "
            f"frames at the host, {counts.damaged_requests:,} reported by the board, {counts.timeouts:,} silences, "
            f"{counts.doubled_answers:,} doubled answers",
        )
    )
    if result.board_repeats is not None:
        figures = f"answered {result.board_repeats:,} repeated requests without stepping again, "
        rows.append(
            ("board's count", figures + f"dropped {result.board_bad_frames:,} damaged frames (both modulo 65536)")
        )
    parts: list[RenderableType] = [pairs_table(rows)]
    if result.ticks:
        parts += ["", _time_table(result, ticks_hz)]
    return Group(*parts)


def _time_table(result: PilResult, ticks_hz: float | None) -> RenderableType:
    facts = tick_facts(result.net_ticks(), ticks_hz)
    figures = ", ".join(f"{name} {facts[name]:,g}" for name in ("min", "median", "max"))
    title = f"ticks of the board's timer a step, reading it taken off: {figures}"
    if ticks_hz:
        title += "; " + ", ".join(f"{name} {1e6 * value:.4g} us" for name, value in facts["seconds"].items())
    table = Table(show_header=False, show_edge=False, pad_edge=False, box=None)
    table.add_column(justify="right")
    table.add_column(justify="right")
    table.add_column()
    edges, counts = facts["histogram"]["edges"], facts["histogram"]["counts"]
    for low, high, count in zip(edges[:-1], edges[1:], counts, strict=True):
        span = f"{low:,.0f}" if low == high else f"{low:,.0f} .. {high:,.0f}"
        table.add_row(span, f"{count:,}", "#" * round(BAR * count / max(counts)))
    return Group(Text(title), table)


def recording_table(recording: Recording, last: bool = True) -> RenderableType:
    """Counts, and the latest sample.

    Parameters
    ----------
    recording : Recording
        What was recorded.
    last : bool, optional
    """
    seconds = f" over {recording.recent[-1][0]:.6g} s of the board's time" if recording.recent else ""
    gaps = f"{recording.lost:,} frames in {recording.gaps:,} gaps"
    if recording.first_gaps:
        gaps += ", the first at t = " + ", ".join(f"{t:.6g}" for t in recording.first_gaps[:5]) + " s"
    rows = [
        ("samples", f"{recording.rows:,}{seconds}"),
        ("lost on the line", gaps),
        ("damaged frames", f"{recording.damaged:,}"),
    ]
    if recording.left_out:
        rows.append(("left out by the board", f"{recording.left_out:,} times (the line is slower than the samples)"))
    if recording.restarts:
        rows.append(("restarts of the board", f"{recording.restarts:,}"))
    if last and recording.recent:
        values = zip(COLUMNS[1:7], recording.recent[-1][1:7], strict=True)
        rows.append(("latest", ", ".join(f"{name} {value:.4g}" for name, value in values)))
    return pairs_table(rows)
