"""Run recorded data through a generated filter."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.estimator import Estimator, load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.recorded.clock import Clock, check_clock
from runtime.recorded.data import Recorded
from runtime.recorded.truth import Errors, errors
from runtime.replay.conventions import conventions
from runtime.replay.innovations import Expectations, Innovations
from runtime.replay.statistics import Consistency, consistency
from runtime.replay.wiring import MISFIT_WORDS, TRIED, find_wiring
from runtime.replay.words import Inputs, Words
from runtime.system.errors import UserError
from runtime.system.files import whole_file, write_facts

Array = NDArray[Any]
Progress = Callable[[float], None]

#: Steps between two reports of progress, by back end.
CHUNK = {"c": 131_072, "numpy": 1_000}
#: Rows of P worked out at once while they are written.
BLOCK = 16_384

REJECTED, NOT_CONVERGED = 1, 2
#: An angle beyond it, rad, has lost the digits within a turn.
FARTHEST = 1e6


@dataclass(frozen=True)
class Settings:
    """Which filter, and where it starts: ``x0`` in state order, or the drive's own start turned to ``theta0`` rad."""

    kind: str | None = None
    backend: str = "c"
    dtype: str = "float32"
    x0: tuple[float, ...] | None = None
    theta0: float | None = None


@dataclass(frozen=True)
class Replay:
    """A run over recorded data of N rows: x (N, n), status (N,), covariance ``words`` that :meth:`P` unpacks.

    ``conventions``: what a truth seems to be, by its name, where it is of another convention than the estimate.
    """

    drive: str
    kind: str
    backend: str
    dtype: str
    sample_time: float
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    recorded: Recorded
    x: Array
    words: Words | Array
    status: Array
    unpack: Callable[[Array], Array]
    notes: list[str]
    errors: Errors | None
    innovations: Innovations
    consistency: Consistency | None
    conventions: dict[str, str] = field(default_factory=dict)

    def P(self, rows: slice | Array) -> Array:
        """Work out the covariances (., n, n) of some rows.

        Parameters
        ----------
        rows : slice or ndarray
        """
        return self.unpack(self.words[rows])

    @property
    def finite(self) -> bool:
        """Whether every estimate is a number."""
        return bool(np.all(np.isfinite(self.x)))

    @property
    def unused(self) -> bool:
        """Whether the filter rejected most rows."""
        return 2 * self.count(REJECTED) > len(self.status)

    def count(self, bit: int) -> int:
        """Count the rows whose status has a bit.

        Parameters
        ----------
        bit : int
        """
        return int(np.count_nonzero(self.status & bit))

    def to_json(self) -> dict[str, Any]:
        """Every figure, as plain data."""
        t = self.recorded.t
        return {
            "drive": self.drive,
            "filter": self.kind,
            "backend": self.backend,
            "dtype": self.dtype,
            "data": str(self.recorded.path),
            "samples": len(t),
            "seconds": float(t[-1] - t[0]),
            "sample_time": self.sample_time,
            "rejected": self.count(REJECTED),
            "not_converged": self.count(NOT_CONVERGED),
            "finite": self.finite,
            "notes": self.notes,
            "errors": self.errors.to_json() if self.errors else None,
            "innovations": self.consistency.to_json() if self.consistency else None,
            "end": dict(zip(self.state_names, (float(v) if np.isfinite(v) else None for v in self.x[-1]), strict=True)),
        }

    def write_json(self, path: Path) -> None:
        """Write :meth:`to_json` into a file.

        Parameters
        ----------
        path : Path
        """
        write_facts(path, self.to_json())

    def write_estimates(self, path: Path) -> None:
        """Write t, x, P, status as .npz; P in float32 and block by block, so that memory never holds all of it.

        Parameters
        ----------
        path : Path
        """
        check_estimates(path)
        n = len(self.state_names)
        with whole_file(path) as whole, zipfile.ZipFile(whole, "w") as archive:
            for name, column in (("t", self.recorded.t), ("x", self.x), ("status", self.status)):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, column, allow_pickle=False)
            with archive.open("P.npy", "w", force_zip64=True) as file:
                header = {"descr": "<f4", "fortran_order": False, "shape": (len(self.x), n, n)}
                np.lib.format.write_array_header_1_0(file, header)
                for first in range(0, len(self.x), BLOCK):
                    file.write(self.P(slice(first, first + BLOCK)).astype("<f4").tobytes())


def check_estimates(path: Path) -> None:
    """Refuse a path that estimates cannot be written to.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
    """
    if path.suffix != ".npz":
        raise UserError(f"'{path}': estimates are written as .npz (t, x, P, status).")


@np.errstate(all="ignore")  # absurd data or a diverged filter show in the figures, not in warnings
def replay(
    folder: GeneratedFolder, recorded: Recorded, settings: Settings, progress: Progress = lambda share: None
) -> Replay:
    """Run a filter over recorded data, one step a row; missing rows are bridged by prediction.

    Parameters
    ----------
    folder : GeneratedFolder
    recorded : Recorded
    settings : Settings
        Filter, back end, precision, start.
    progress : callable
        Told the share that is done, 0 .. 1.

    Raises
    ------
    UserError
        No such filter, no C compiler, a start of the wrong shape, times that do not fit the drive's sample time, or no
        row that the filter accepts.
    """
    estimator = load_folder(folder, settings.kind, settings.backend, settings.dtype)
    clock = check_clock(recorded.t, estimator.sample_time, recorded.path, folder.drive)
    estimator.reset(x0=start(estimator, settings))
    inputs = Inputs(recorded.u, recorded.y, clock, np.dtype(settings.dtype))
    x, words, status, found = _run(estimator, folder.module, inputs, CHUNK[settings.backend], progress)
    judged = consistency(found)
    wired = None
    if judged is not None and judged.suspicious:
        wired = find_wiring(recorded, TRIED[settings.backend], lambda head: _innovations_of(folder, head, settings))
        if wired is None and not judged.fits:
            wired = f"{MISFIT_WORDS}, nor in another order or sign of the phases: units, motor data, --x0, --theta0?"
    pole_pairs = int(folder.manifest["parameters"]["motor"]["pole_pairs"])
    others = {} if wired else conventions(recorded, x, judged, pole_pairs)
    notes = [*recorded.notes, *clock.notes, *_rejections(recorded, status, estimator.tuning), *others.values()]
    notes += [wired] if wired else []
    return Replay(
        drive=folder.drive,
        kind=estimator.filter,
        backend=settings.backend,
        dtype=settings.dtype,
        sample_time=estimator.sample_time,
        state_names=estimator.state_names,
        state_units=estimator.state_units,
        recorded=recorded,
        x=x,
        words=words,
        status=status,
        unpack=estimator.unpack,
        notes=notes,
        errors=errors(recorded.t, x, estimator.state_names, recorded.truth),
        innovations=found,
        consistency=judged,
        conventions=others,
    )


def _innovations_of(folder: GeneratedFolder, recorded: Recorded, settings: Settings) -> Innovations:
    """The innovations alone, of a short recording whose clock was found good."""
    estimator = load_folder(folder, settings.kind, settings.backend, settings.dtype)
    estimator.reset(x0=start(estimator, settings))
    inputs = Inputs(recorded.u, recorded.y, Clock(None, len(recorded.u), []), np.dtype(settings.dtype))
    return _run(estimator, folder.module, inputs, CHUNK[settings.backend], lambda share: None)[3]


def start(estimator: Estimator, settings: Settings) -> Array | None:
    """Return the state to start from; None: the drive's own.

    Parameters
    ----------
    estimator : Estimator
    settings : Settings

    Raises
    ------
    UserError
        A start of the wrong shape, or one that is no number.
    """
    if settings.x0 is not None and settings.theta0 is not None:
        raise UserError("--x0 holds the angle already: give it or --theta0, not both.")
    if settings.x0 is not None:
        if len(settings.x0) != len(estimator.state_names):
            needed = ",".join(estimator.state_names)
            raise UserError(f"--x0 has {len(settings.x0)} numbers; this drive's state is {needed}.")
        if not np.all(np.isfinite(settings.x0)):
            raise UserError("--x0 holds what is no number: a filter cannot start there.")
        return np.array(settings.x0)
    if settings.theta0 is None:
        return None
    if not abs(settings.theta0) <= FARTHEST:
        raise UserError(f"--theta0 {settings.theta0:g} is no angle in rad.")
    x = np.array(estimator.tuning["x_0"], dtype=float)
    # Flux linkages or currents turn with the rotor.
    turned = complex(x[0], x[1]) * np.exp(1j * (settings.theta0 - x[3]))
    x[0], x[1], x[3] = turned.real, turned.imag, np.remainder(settings.theta0 + np.pi, 2 * np.pi) - np.pi
    return x


def _run(
    estimator: Estimator, module: ModuleType, inputs: Inputs, chunk: int, progress: Progress
) -> tuple[Array, Words, Array, Innovations]:
    """x (N, n), covariance words, status (N,) and innovations, row by row; what is between chunks is let go."""
    n, N = len(estimator.state_names), inputs.rows
    x = np.empty((N, n), dtype=estimator.dtype)
    status = np.empty(N, dtype=np.int32)
    found = Innovations(np.empty((N, 2), dtype=x.dtype), np.empty((N, 3), dtype=x.dtype))
    words = Words(estimator.backend, inputs, chunk)
    expectations = Expectations(module, estimator.filter, estimator.dtype)
    for first in range(0, inputs.steps, chunk):
        last = min(first + chunk, inputs.steps)
        x_0, words_0 = estimator.backend.state()
        words.mark()
        u, y = inputs.of(first, last)
        trace = estimator.run(u, y)
        before = np.vstack([x_0, trace.x[:-1]]), np.vstack([words_0, trace.words[:-1]])
        innovations = expectations.innovations(u, y, *before)
        rows, steps = inputs.places(first, last)
        x[rows], status[rows] = trace.x[steps], trace.status[steps]
        found.nu[rows], found.S[rows] = innovations.nu[steps], innovations.S[steps]
        words.keep(trace.words)
        progress(last / inputs.steps)
    return x, words, status, found


def _rejections(recorded: Recorded, status: Array, tuning: dict[str, Any]) -> Sequence[str]:
    """The inputs that the filter rejected, in words; UserError if that was everything."""
    rejected = np.flatnonzero(status & REJECTED)
    if not len(rejected):
        return []
    limits = f"beyond {tuning['u_max']:g} V or {tuning['y_max']:g} A, or not a number"
    if len(rejected) == len(status):
        raise UserError(
            f"'{recorded.path}': the filter rejects every row, {limits}. Are voltages in V and currents in A? "
            "Otherwise --scale i_alpha=mA."
        )
    k = rejected[0]
    first = f"the first at t = {recorded.t[k]:.6g} s: u = ({_two(recorded.u[k])}) V, i = ({_two(recorded.y[k])}) A"
    return [f"{len(rejected):,} of {len(status):,} rows rejected ({limits}) and bridged by prediction; {first}"]


def _two(pair: Array) -> str:
    return f"{pair[0]:.4g}, {pair[1]:.4g}"
