"""Where link D-E starts: draws of the operating box made harder in several ways, and the trajectory cut to pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import BoxSamples
from codegen.evidence.certificate import full_matrices
from codegen.ir.small_angle import LIMIT, UNKNOWN
from runtime.estimator.c_backend import CBackend
from runtime.estimator.numpy_backend import NumpyBackend

Array = NDArray[Any]

#: Pieces the trajectory is cut into for up to seven states: no multiple of any vector's length.
PIECES = 21


def piece_count(module: ModuleType) -> int:
    """How many pieces the trajectory is cut into: two more for each state beyond the seventh, which has a lane.

    Parameters
    ----------
    module : ModuleType
        The generated Python module.
    """
    return PIECES + 2 * max(0, len(module.STATES) - 7)


#: Angles at which the last bit of each coefficient of sine and cosine shows, sought among four million.
TELLING = (1.5846115350723267, -1.4174660444259644, 3.141575574874878, 1.687328815460205, 1.6679680347442627)


@dataclass(frozen=True)
class Start:
    """Filters side by side, a lane each: where they start, what they are told, how they are tuned.

    Parameters
    ----------
    where : str
        In few words, for the tables.
    x : array, (n, lanes)
    words : array, (packed, lanes)
        Of the covariance, as the module keeps it.
    u, y : array, (steps, 2, lanes)
    tuning : dict
        Fields of the filter, each (lanes,) or (entries, lanes).
    """

    where: str
    x: Array
    words: Array
    u: Array
    y: Array
    tuning: dict[str, Array] = field(default_factory=dict)

    @property
    def lanes(self) -> int:
        """Number of lanes."""
        return int(self.x.shape[1])

    def load(self, backend: CBackend | NumpyBackend) -> None:
        """Every lane as it starts.

        Parameters
        ----------
        backend : CBackend | NumpyBackend
            "numpy" or "c".
        """
        backend.reset(self.x.copy(), self.words.copy())
        if isinstance(backend, NumpyBackend):
            for name, value in self.tuning.items():
                if name == "max_iterations":  # one number for all lanes of an array
                    backend.filter.max_iterations = int(value[0])
                else:
                    single = value.astype(np.float32)
                    setattr(backend.filter, name, tuple(single) if single.ndim == 2 else single)
        else:
            set_tuning(backend.filters, self.tuning)


def set_tuning(filters: Any, tuning: dict[str, Array]) -> None:
    """Fields of C structs, a lane each.

    Parameters
    ----------
    filters : object
        Filter kinds.
    tuning : dict of str to Array
    """
    for name, value in tuning.items():
        for k, entry in enumerate(value.T.tolist()):
            setattr(filters[k], name, entry)


def from_box(module: ModuleType, box: BoxSamples) -> Iterator[Start]:
    """Single steps from draws of the operating box: as they are, turned far, angle alone unknown, one corner a lane.

    Parameters
    ----------
    module : ModuleType
        The generated Python module.
    box : BoxSamples
        Where the state and the inputs may lie.
    """
    x, u, y = (a.astype(np.float32) for a in (box.x, box.u[None], box.y[None]))
    words = module.pack(full_matrices(box.P, len(x))).astype(np.float32)
    yield Start("box", x, words, u, y)
    yield Start("box, wide turns", x, _turned(module, words, 2 * LIMIT), u, y)
    yield _sharp(module, x, u, y)
    corners = _corners(module, x, u, y)
    if corners is not None:
        yield corners


def _sharp(module: ModuleType, x: Array, u: Array, y: Array) -> Start:
    """At rest, nothing uncertain or about to be but the angle, every other measurement rejected.

    What only a bend moves is then not rounded off in what is larger.
    """
    x, y = x.copy(), y.copy()
    x[2], x[module.ANGLE, : len(TELLING)], y[0, 0, ::2] = 0.0, TELLING, np.nan
    Q = 1e-12 * np.array(module.DEFAULTS["Q"])
    words = _diagonal(module, 1e6 * Q, x.shape[1])
    tuning = {"Q": np.tile(Q[:, None], x.shape[1])}
    return Start("box, angle alone unknown", x, _turned(module, words, UNKNOWN), u, y, tuning)


def _corners(module: ModuleType, x: Array, u: Array, y: Array) -> Start | None:
    """One thing at a time, in one lane of many healthy ones: beside another, it might not be what is noticed.

    An L is absurd behind pivots that are not; a state is, and no innovation tells; a turn, once or twice halved, is
    exactly what counts as small; one column alone turns far, or too far to know the angle.
    """
    if module.COVARIANCE != "LD":
        return None
    order, n, word = module.ORDER, len(x), module.word
    pole_pairs = getattr(module, "POLE_PAIRS", 1.0)  # a factor of one is no constant of the module
    theta, omega, half = module.ANGLE, module.STATES.index("omega"), 0.5 * module.SAMPLE_TIME * pole_pairs
    angle = module.ROWS[theta]
    absurd = [k for k in range(n) if k != module.ANGLE]
    apart, far = 16, [(column, z) for column in range(angle + 2) for z in (2 * LIMIT, 1.5 * UNKNOWN)]
    lanes = apart * (1 + len(absurd) + 2 + len(far))
    x, u, y = (a[..., np.arange(lanes) % x.shape[1]] for a in (x, u, y))
    Q, nis = np.tile(np.array(module.DEFAULTS["Q"])[:, None], lanes), np.zeros(lanes)
    words = _diagonal(module, Q[:, 0], lanes)
    place = iter(range(7, lanes, apart))
    # --- an L that is absurd; a mean innovation beyond its limit has it looked at
    lane = next(place)
    x[2, lane], x[module.ANGLE, lane] = 0.0, 0.0
    Q[:, lane], nis[lane] = 1e-30, 2 * module.DEFAULTS["nis_max"]
    words[:, lane] = _diagonal(module, Q[:, lane], 1)[:, 0]
    words[word(0, 1), lane] = 10 * module.SANE_LIMIT
    # --- each state
    for state, lane in zip(absurd, place, strict=False):
        x[:, lane], y[0, :, lane], Q[:, lane] = 0.0, np.nan, 1e-30
        x[state, lane] = 2 * module.SANE_LIMIT
        words[:, lane] = _diagonal(module, Q[:, lane], 1)[:, 0]
    # --- turns of the angle's own column: once and twice halved, exactly small
    for power, lane in zip((1, 2), place, strict=False):
        words[word(theta, theta), lane] = np.float32(LIMIT / n) * np.float32(4) ** power
    # --- each column alone, and the speed's in half a step
    for (column, z), lane in zip(far, place, strict=False):
        if column == angle + 1:
            words[word(omega, omega), lane] = z / n / half**2
        elif column == angle:
            words[word(theta, theta), lane] = z / n
        else:
            other = order[column]
            words[word(theta, other), lane] = np.sqrt(z / n / words[word(other, other), lane])
    return Start("box, one corner", x, words, u, y, {"Q": Q, "nis": nis})


def _diagonal(module: ModuleType, variances: Array, lanes: int) -> Array:
    """The words of a covariance without correlations, (n,) in every lane."""
    return np.repeat(np.array(module.diagonal(variances, 0.0), dtype=np.float32)[:, None], lanes, axis=1)


def _turned(module: ModuleType, given: Array, widest: float) -> Array:
    """Covariances in which every column turns theta by a d^2 up to ``widest``; P as it is."""
    words, order, theta, word = given.copy(), module.ORDER, module.ANGLE, module.word
    if module.COVARIANCE != "LD":
        return words
    n, rng = len(order), np.random.default_rng(2)
    for other in order[: module.ROWS[theta]]:
        z = rng.uniform(0, widest / n, words.shape[1])
        words[word(theta, other)] = np.sqrt(z / words[word(other, other)])
    words[word(theta, theta)] = rng.uniform(0, widest / n, words.shape[1])
    return words


# --- pieces of the trajectory


def pieces(module: ModuleType, u: Array, y: Array) -> Start:
    """The trajectory (steps, 2) cut up, its pieces side by side, each with a tuning of its own.

    Every third piece starts with an angle so uncertain that its turns are wide, one each with turns that are
    exactly what counts as small, and as not too wide. Three inputs are to be rejected, four are just allowed.

    Parameters
    ----------
    module : ModuleType
        The generated Python module.
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    """
    count = piece_count(module)
    steps, limits = len(u) // count, module.DEFAULTS
    u, y = (a[: steps * count].reshape(count, steps, 2).transpose(1, 2, 0).copy() for a in (u, y))
    u[steps // 2, 0, 1], y[steps // 3, 1, 2], y[steps // 4, 0, -1] = np.nan, np.inf, 1e9
    for axis, lane in ((0, 4), (1, 7)):
        u[-1, axis, lane], y[-1, axis, lane + 1] = limits["u_max"], limits["y_max"]
    uncertain = np.where(np.arange(count) % 3 == 0, np.float32(16), np.float32(1))
    words = module.pack(np.diag(limits["P_0"])).astype(np.float32)[:, None] * uncertain
    x = np.repeat(np.array(limits["x_0"], dtype=np.float32)[:, None], count, axis=1)
    spread = np.arange(count, dtype=np.float32) - np.float32(9.5)
    x[2], x[module.ANGLE] = 20 * spread, 0.25 * spread  # at rest a turn turns nothing
    x[2, 12], x[module.ANGLE, 12] = 0.0, 3.1415925  # where sine is all that is left of pi's parts
    _at_their_worst(module, x, words)
    return Start("pieces", x, words, u, y, _tuning(module))


def _at_their_worst(module: ModuleType, x: Array, words: Array) -> None:
    """The worst state and covariance, in place: D is its diagonal in either form while L is 1.

    Turns that halved are exactly what counts as small, that are exactly not too wide, that are too wide by the
    angle's own column; wide in one column alone, and in all. A variance below nothing, which must meet its floor.
    """
    n, order, theta, word = len(x), module.ORDER, module.ANGLE, module.word
    own, speed = word(theta, theta), module.VARIANCES[module.STATES.index("omega")]
    for lane, z in ((7, 4 * UNKNOWN), (10, 4 * LIMIT), (13, UNKNOWN)):
        words[own, lane], words[speed, lane] = z / n, 0.0
    if module.COVARIANCE != "LD":
        return  # a Cholesky factor has no floor: one of these would be no number, and no number has many bits
    for column, other in enumerate(order[: module.ROWS[theta]]):
        wide = np.sqrt(2 * LIMIT / n / words[word(other, other), 1])
        words[word(theta, other), 2 + 3 * column] = words[word(theta, other), 1] = wide
    words[own, 1] = 2 * LIMIT / n
    first = word(theta, order[0])
    words[first, 10] = words[first, 2]  # a wide one beside it: else nobody asks again
    x[2, 6] = 2e12
    words[0, 3], words[0, 9] = np.nan, -1e13  # no number, and absurd: to be restarted
    words[own, 0] = 8 * UNKNOWN / n  # unknown, but nothing else to repair
    Q = module.DEFAULTS["Q"]
    for i, below in enumerate(order):
        for state in order:
            words[word(state, state), 14 + i] = -0.25 * Q[state] if state == below else 1e-3 * Q[state]


def _tuning(module: ModuleType) -> dict[str, Array]:
    """Q, R, P_0 and limits of each lane are data, so is its first mean; N_max is the drive file's plus one."""
    given, lane = module.DEFAULTS, np.arange(piece_count(module))
    one_axis_worse = np.where(lane % 5 == 3, np.array([[64.0], [1.0]]), np.where(lane % 5 == 1, [[1.0], [64.0]], 1.0))
    tuned = {
        "Q": np.outer(given["Q"], 2.0 ** (lane % 3)),
        "R": np.outer(given["R"], 2.0 ** (lane % 2)) * one_axis_worse,
        "P_0": np.outer(given["P_0"], 2.0 ** (lane % 2)),
        "tolerance": np.where(lane % 5 == 4, 0.0, given["tolerance"] * 2.0 ** (lane % 4)),
        "max_iterations": np.full(len(lane), given["max_iterations"] + 1),
    }
    if "nis_max" in given:
        tuned["nis_max"] = np.where(lane % 4 == 1, 1.0, given["nis_max"])
        tuned["nis_weight"] = given["nis_weight"] * 2.0 ** (lane % 3)
        tuned["nis"] = np.where(lane == 5, 4e9, 0.0)  # absurd, but nothing to repair
    return tuned
