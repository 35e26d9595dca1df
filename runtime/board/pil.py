"""Link G: the filter on the user's board against the host's own, step by step, over a line that may fail.

Every step is compared or reported lost. ``free``: both filters start alike and run on their own bits, so that one
differing bit anywhere shows. ``single``: each step of the host starts from the state the board reported before it,
which isolates one step; within the certificate only this is meaningful, because the certificate is of one step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.board.board import Answer, Board, Identity, check_identity
from runtime.board.link import Counts, NoAnswerError, RefusedError, UnpluggedError
from runtime.board.twin import Twin, word_names
from runtime.estimator.folder import GeneratedFolder
from runtime.system.errors import UserError, take_interrupt
from runtime.system.values import read_word

Array = NDArray[Any]
Progress = Callable[[int], None]

#: Status bit: whether a step took its inputs. (The other bit, converged or not, may hang on a rounding.)
INPUT_REJECTED = 1

MODES = ("free", "single")
#: A division that errs by 3 ulp, as Newton steps do, errs by six roundings of half an ulp.
ROUNDINGS = 6.0

TOLERANCES = ("bits", "certificate")


@dataclass(frozen=True)
class Divergence:
    """The first value that is not as it must be; bits are hex, ``allowed`` says what would have passed."""

    step: int
    element: str
    expected: float
    found: float
    expected_bits: str
    found_bits: str
    allowed: str

    def __str__(self) -> str:
        where = "after reset" if self.step < 0 else f"at step {self.step}"
        return (
            f"first divergence {where}, {self.element}: expected {self.expected:.9g} ({self.expected_bits}), "
            f"found {self.found:.9g} ({self.found_bits}), allowed {self.allowed}"
        )


@dataclass
class PilResult:
    """The result of a run over the line. ``lost``: steps that no retry brought through, so not compared.

    ``used``: largest share of the certificate between board and host in a step; ``beyond``: steps with more than
    all of it.
    """

    identity: Identity
    mode: str
    tolerance: str
    wanted: int
    compared: int = 0
    different: int = 0
    lost: list[int] = field(default_factory=list)
    ticks: list[int] = field(default_factory=list)
    used: float = 0.0
    beyond: int = 0
    divergence: Divergence | None = None
    counts: Counts = field(default_factory=Counts)
    board_repeats: int | None = None
    board_bad_frames: int | None = None
    ended: str = ""
    interrupted: bool = False

    @property
    def passed(self) -> bool:
        """Every step was compared, and every one agreed."""
        return self.compared == self.wanted > 0 and self.divergence is None and not self.different

    def net_ticks(self) -> Array:
        """Timer ticks of each compared step, less what reading the timer takes."""
        return np.maximum(np.array(self.ticks, dtype=np.int64) - self.identity.ticks_of_nothing, 0)

    def to_json(self, ticks_hz: float | None) -> dict[str, Any]:
        """Plain data for ``--json``.

        Parameters
        ----------
        ticks_hz : float or None
            Rate of the board's timer, Hz; None: not known.
        """
        facts = asdict(self)
        ticks = self.net_ticks()
        facts["ticks"] = tick_facts(ticks, ticks_hz)
        return {"link": "G", "passed": self.passed, **facts}


def tick_facts(ticks: Array, ticks_hz: float | None) -> dict[str, Any]:
    """Minimum, median, maximum and histogram of ticks a step, in seconds too where the rate is known.

    The last bin holds the slowest hundredth, which may be far away: steps that an interrupt cut in two.

    Parameters
    ----------
    ticks : ndarray
    ticks_hz : float or None
        Rate of the board's timer, Hz; None: not known.
    """
    if not ticks.size:
        return {}
    figures = {"min": int(ticks.min()), "median": float(np.median(ticks)), "max": int(ticks.max())}
    usual = int(np.quantile(ticks, 0.99, method="lower"))
    edges = np.unique(np.linspace(figures["min"], usual + 1, num=10).round())
    if figures["max"] >= edges[-1]:
        edges = np.append(edges, figures["max"])
    counts, _ = np.histogram(ticks, bins=edges)
    facts: dict[str, Any] = {**figures, "histogram": {"edges": edges.tolist(), "counts": counts.tolist()}}
    if ticks_hz:
        facts |= {"ticks_hz": ticks_hz, "seconds": {name: value / ticks_hz for name, value in figures.items()}}
    return facts


class _Judge:
    """Compares one answer with what the host expects, and remembers the first that fails."""

    def __init__(self, folder: GeneratedFolder, kind: str, backend: str, result: PilResult) -> None:
        self.result = result
        self.twin = Twin(folder, kind, backend, "float32")
        self.exact = Twin(folder, kind, "numpy", "float64")
        self.certificate = folder.manifest["filters"][kind]["certificate"]
        self.angle = folder.module.ANGLE

    def expect(self, before: Array, u: Array, y: Array) -> tuple[Array, int, int]:
        """The host's step. ``free`` goes on from the host's own state, ``single`` from ``before``."""
        if self.result.mode == "single":
            self.twin.words = before
        return self.twin.step(u, y)

    def bits(self, step: int, expected: tuple[Array, int, int], answer: Answer) -> bool:
        """All state words, status and iterations as bits."""
        words, status, iterations = expected
        a = np.append(words.view(np.uint32), [status, iterations]).astype(np.uint32)
        b = np.append(answer.words.view(np.uint32), [answer.status, answer.iterations]).astype(np.uint32)
        unequal = np.flatnonzero(a != b)
        if unequal.size and self.result.divergence is None:
            k = int(unequal[0])
            values = [np.append(w.astype(float), [s, i]) for w, s, i in (expected, _triple(answer))]
            name = [*self.twin.word_names, "status", "iterations"][k]
            hexes = (f"0x{int(a[k]):08X}", f"0x{int(b[k]):08X}")
            self.result.divergence = Divergence(
                step, name, float(values[0][k]), float(values[1][k]), *hexes, allowed="identical bits"
            )
        return not unequal.size

    def certified(
        self, step: int, before: Array, inputs: tuple[Array, Array], expected: tuple[Array, int, int], answer: Answer
    ) -> bool:
        """The board's step against the host's from the same state: no further apart than the certificate.

        The certificate's draws do not cover every state: in the first steps after P_0 the host's own float32 may
        leave it. Such a step may take :data:`ROUNDINGS` times what float32 does there, and is counted.
        """
        words, status, _ = expected
        P, found = self.twin.P, self.twin.covariance(answer.words)
        shares = self._shares(words, P, answer.words, found)
        worst = float(shares.max())
        if worst > 1.0:
            self.exact.words = before
            exact, _, _ = self.exact.step(*inputs)
            here = float(self._shares(exact, self.exact.P, words, P).max())
            shares = shares / max(1.0, ROUNDINGS * here)
            self.result.beyond += 1
        self.result.used = max(self.result.used, worst)
        good = bool(np.all(shares <= 1.0)) and not (status ^ answer.status) & INPUT_REJECTED
        if not good and self.result.divergence is None:
            n = len(self.twin.names)
            lower = np.tril_indices(n)
            pairs = [*zip(words[:n], answer.words[:n], strict=True), *zip(P[lower], found[lower], strict=True)]
            self.result.divergence = self._beyond(step, shares, pairs, status, answer)
        return good

    def _shares(self, words: Array, P: Array, other: Array, other_P: Array) -> Array:
        """How much of the certificate lies between two states: each of x, then the lower triangle of P."""
        n = len(self.twin.names)
        dx = np.abs(other[:n].astype(float) - words[:n])
        dx[self.angle] = abs(np.remainder(dx[self.angle] + np.pi, 2 * np.pi) - np.pi)
        sigma = np.sqrt(np.diag(P).astype(float))
        dP = (np.abs(other_P.astype(float) - P) / np.outer(sigma, sigma))[np.tril_indices(n)]
        shares = np.concatenate([dx / np.array(self.certificate["x"]), dP / self.certificate["P"]])
        return np.where(np.isnan(shares), np.inf, shares)

    def _beyond(
        self, step: int, shares: Array, pairs: list[tuple[Any, Any]], status: int, answer: Answer
    ) -> Divergence:
        if np.all(shares <= 1.0):
            hexes = (f"0x{status:08X}", f"0x{answer.status:08X}")
            return Divergence(step, "status", status, answer.status, *hexes, "the same verdict on the inputs")
        k, n = int(np.argmax(shares)), len(self.twin.names)
        names = word_names(self.twin.names, "P")
        allowed = f"{self.certificate['x'][k]:g}" if k < n else f"{self.certificate['P']:g} of sqrt(Pii Pjj)"
        a, b = (float(value) for value in pairs[k])
        return Divergence(step, names[k], a, b, _hex(a), _hex(b), f"{allowed} apart (certificate)")


def _hex(value: float) -> str:
    return f"0x{int(np.float32(value).view(np.uint32)):08X}"


def _triple(answer: Answer) -> tuple[Array, int, int]:
    return answer.words, answer.status, answer.iterations


def check_settings(mode: str | None, tolerance: str) -> str:
    """The mode that fits the tolerance: a free run for bits, single steps for the certificate.

    Parameters
    ----------
    mode : str or None
    tolerance : str
        "bits" or "certificate".

    Raises
    ------
    UserError
        On unknown words, or a free run judged by a certificate of single steps.
    """
    read_word(tolerance, "tolerance", TOLERANCES)
    mode = mode or ("free" if tolerance == "bits" else "single")
    read_word(mode, "mode", MODES)
    if tolerance == "certificate" and mode == "free":
        raise UserError("the certificate is of one step: use --mode single with --tolerance certificate.")
    return mode


def run_pil(
    board: Board,
    folder: GeneratedFolder,
    u: Array,
    y: Array,
    mode: str = "free",
    tolerance: str = "bits",
    backend: str = "numpy",
    progress: Progress = lambda done: None,
) -> PilResult:
    """Step the board through u, y (N, 2) and compare each step. Ends early on Ctrl-C or a dead line, and says so.

    Parameters
    ----------
    board : Board
        The board, open.
    folder : GeneratedFolder
        The generated folder.
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    mode : str, optional
    tolerance : str, optional
        "bits" or "certificate".
    backend : str, optional
        "numpy" or "c".
    progress : Progress, optional
        Told how far the work is.

    Raises
    ------
    UserError
        If the board's firmware is not this folder's.
    """
    identity = board.identity
    check_identity(identity, folder.manifest)
    result = PilResult(identity, mode, tolerance, wanted=len(u))
    judge = _Judge(folder, identity.kind, backend, result)
    try:
        _walk(board, judge, u.astype(np.float32), y.astype(np.float32), progress)
        result.board_repeats, result.board_bad_frames = board.line_figures()
    except KeyboardInterrupt:
        take_interrupt()
        result.ended, result.interrupted = "interrupted", True
    except UnpluggedError as error:
        result.ended = f"{error}: is the cable plugged in?"
    except RefusedError as error:
        result.ended = f"the board refuses to go on ({error}): did it restart?"
    except (NoAnswerError, UserError):
        result.ended = "the board no longer answers"
    result.counts = board.link.counts
    return result


def _walk(board: Board, judge: _Judge, u: Array, y: Array, progress: Progress) -> None:
    """All steps. After a lost one the board is put where the host's step ended, and both go on from there."""
    result = judge.result
    start = board.reset()
    judge.bits(-1, (judge.twin.words, 0, 0), start)
    before = start.words
    for k in range(len(u)):
        expected = judge.expect(before, u[k], y[k])
        try:
            answer = board.step(u[k], y[k])
        except NoAnswerError:
            result.lost.append(k)
            before = expected[0]
            board.set_state(before)
            progress(k + 1)
            continue
        result.ticks.append(answer.ticks)
        if result.tolerance == "bits":
            good = judge.bits(k, expected, answer)
        else:
            good = judge.certified(k, before, (u[k], y[k]), expected, answer)
        result.compared += 1
        result.different += not good
        before = answer.words
        progress(k + 1)
