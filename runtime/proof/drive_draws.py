"""What a drive is tried with, in C, in NumPy and by hand: inputs, and memory as no run would leave it so soon."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from runtime.proof.align import LEFT_ACROSS
from runtime.proof.mode_walk import NEAR
from runtime.proof.modes import Modes

#: Interrupts of an alignment after those of a drive that aligns.
ALIGNED = 100
#: Interrupts in RUNNING, many with currents to reject, of a drive that learns from the square wave's ripple.
LEARNING = 40


def inputs(hand: Modes, rng: np.random.Generator, dtype: Any) -> tuple[Any, Any]:
    """Currents, A, mostly small; reference, rad/s, and DC link, V; now and then one that is no number.

    Parameters
    ----------
    hand : Modes
        Gives the scales.
    rng : np.random.Generator
    dtype : type
    """
    phase = rng.uniform(-1, 1, 2) * hand.most * rng.choice([0.02, 0.3, 2.0], p=(0.7, 0.2, 0.1))
    phase = np.where(rng.random(2) < 0.02, np.nan, phase)
    command = np.array([rng.uniform(-1, 1) * hand.speed, hand.link * rng.uniform(0.4, 1.4)])
    command = np.where(rng.random(2) < 0.02, rng.choice([np.nan, np.inf, -np.inf, 0.0], 2), command)
    return tuple(dtype(i) for i in phase), tuple(dtype(v) for v in command)


def set_drive(d: SimpleNamespace, module: ModuleType, hand: Modes, rng: np.random.Generator, dtype: Any) -> bool:
    """Now and then another mode with what it allows, counts near their ends, and regulators that have regulated.

    Parameters
    ----------
    d : SimpleNamespace
        Changed.
    module : ModuleType
        The generated module.
    hand : Modes
    rng : np.random.Generator
    dtype : type

    Returns
    -------
    bool
        Whether it was changed.
    """
    if rng.random() < 0.7:
        return False
    s = d.supervisor
    more = ("RUNNING",) * 2 if hasattr(s, "aligns") else ()  # the one mode of such a drive with torque
    name = str(rng.choice([*module.MODES, *more]))
    _set_mode(s, name, module, hand, rng, dtype)
    for field in ("fresh", "anew", "acknowledged"):
        setattr(s, field, np.int64(rng.integers(2)))
    s.since = np.int64(rng.integers(0, hand.samples(0.01)))
    s.quiet, s.content = np.int64(hand.samples(0.002) - 1), np.int64(hand.samples(0.003) - 1)
    s.failures = np.int64(rng.integers(0, 11))
    s.eased = (dtype(rng.random()),)
    if hasattr(s, "asked"):
        s.asked = (dtype(rng.uniform(-1, 1) * hand.speed),)
    if hasattr(d, "resistance"):
        d.resistance = (dtype(rng.uniform(-1, 1) * module.MOST_RESISTANCE),)
    d.control.integrator = tuple(dtype(v) for v in rng.uniform(-1, 1, 4))
    _set_angle(d.control.filter, module, rng, dtype)
    d.control.filter.x = tuple(
        dtype(rng.uniform(-0.1, 0.1) * hand.speed) if k == 2 else value for k, value in enumerate(d.control.filter.x)
    )
    for field in ("v_acting", "v_queued"):
        setattr(d.control, field, tuple(dtype(v) for v in rng.uniform(-1, 1, 2)))
    return True


def _set_mode(
    s: SimpleNamespace, name: str, module: ModuleType, hand: Modes, rng: np.random.Generator, dtype: Any
) -> None:
    """A mode with what it allows."""
    s.mode = np.int64(module.MODES.index(name))
    s.runs = np.int64(name in ("CATCHING", "STARTING", "RUNNING"))
    s.torque = np.int64(name in ("STARTING", "RUNNING"))
    if hasattr(s, "rivals"):
        s.rivals = np.int64(name == "STARTING")
    if hasattr(s, "aligns"):
        s.aligns, s.calm = np.int64(name == "ALIGNING"), np.int64(hand.calm - rng.integers(0, 3))
        way, size = rng.uniform(-np.pi, np.pi), rng.uniform(0, 1) * hand.align_current
        s.axis = tuple(dtype(v) for v in (np.cos(way), np.sin(way), size))
        s.aligning = (dtype(rng.choice([0.0, 0.7, 1.0, 1.6, 2.0])),)


def count(hand: Modes, module: ModuleType, samples: int) -> int:
    """Of :func:`draws`.

    Parameters
    ----------
    hand : Modes
    module : ModuleType
        The generated module.
    samples : int
    """
    return samples + (ALIGNED if hand.aligns else 0) + (LEARNING if hasattr(module, "inject") else 0)


def draws(
    d: SimpleNamespace, module: ModuleType, hand: Modes, rng: np.random.Generator, dtype: Any, samples: int
) -> Iterator[tuple[bool, Any, Any]]:
    """Whether the drive was changed, and currents and command, interrupt by interrupt; then what it alone does.

    Parameters
    ----------
    d : SimpleNamespace
        Changed, now and then.
    module : ModuleType
        The generated module.
    hand : Modes
    rng : np.random.Generator
    dtype : type
    samples : int
    """
    for _ in range(samples):
        yield set_drive(d, module, hand, rng, dtype), *inputs(hand, rng, dtype)
    for _ in range(ALIGNED if hand.aligns else 0):
        yield True, *_set_aligned(d, module, hand, rng, dtype)
    for _ in range(LEARNING if hasattr(module, "inject") else 0):
        yield True, *_set_learning(d, module, hand, rng, dtype)


def _set_aligned(
    d: SimpleNamespace, module: ModuleType, hand: Modes, rng: np.random.Generator, dtype: Any
) -> tuple[Any, Any]:
    """ALIGNING, with a current beside its axis about what is left to the rotor; some of it, and of links, is none."""
    _set_mode(d.supervisor, "ALIGNING", module, hand, rng, dtype)
    d.control.integrator = tuple(dtype(v) for v in hand.link * rng.uniform(-0.8, 0.8, 4))  # in some v is at its limit
    across = LEFT_ACROSS * hand.most * rng.choice([-1, 1]) * (1 + rng.choice(NEAR))
    i = (rng.uniform(-1, 1) * hand.most + 1j * across) * complex(*d.supervisor.axis[:2])
    phase = np.array([i.real, -i.real / 2 + np.sqrt(3) / 2 * i.imag])
    phase[rng.integers(2)] *= rng.choice([1.0, np.nan, np.inf, 1e6], p=(0.85, 0.05, 0.05, 0.05))
    link = hand.link * rng.uniform(0.4, 1.4) * rng.choice([1.0, np.nan, np.inf, 1e6], p=(0.85, 0.05, 0.05, 0.05))
    return tuple(dtype(v) for v in phase), (dtype(0.0), dtype(link))


def _set_learning(
    d: SimpleNamespace, module: ModuleType, hand: Modes, rng: np.random.Generator, dtype: Any
) -> tuple[Any, Any]:
    """RUNNING with some resistance learnt; more than half of the currents are to be rejected."""
    _set_mode(d.supervisor, "RUNNING", module, hand, rng, dtype)
    d.resistance = (dtype(rng.uniform(-1, 1) * module.MOST_RESISTANCE),)
    phase, command = inputs(hand, rng, dtype)
    strange = rng.choice([1.0, np.nan, np.inf, 1e6], 2, p=(0.6, 0.15, 0.15, 0.1))
    return tuple(dtype(i * s) for i, s in zip(phase, strange, strict=True)), command


def _set_angle(f: SimpleNamespace, module: ModuleType, rng: np.random.Generator, dtype: Any) -> None:
    """An angle that is known well, or not, and then by no current, either: as a variance, or as the pivot of one."""
    known, own, words = rng.random() < 0.5, module.VARIANCES[3], getattr(f, module.COVARIANCE)
    variance = dtype(0.01 if known else rng.uniform(0.1, 0.6))
    setattr(f, module.COVARIANCE, tuple(variance if k == own else word for k, word in enumerate(words)))
    f.R = tuple(dtype(r if known else 1e6) for r in module.DEFAULTS["R"])
