"""Link "injection": the square wave on the d axis and the resistance learnt from its ripple, by hand and generated.

Draws over all that the controller may hand on: duty cycles at and beside their limits, links that are missing, speeds
beyond the one at which the wave has faded. By hand it is one complex number, turned to the rotor and read on three
legs; the room that they have for it is found by halving.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from runtime.proof.result import Link, Row

Array = NDArray[np.float64]

#: Some twenty roundings in float64, on the scale of a duty cycle and of the DC link.
ALLOWED = 1e-13
DRAWS = 400
#: Halvings of the pulse until it fits the legs: float64 has no more digits.
HALVINGS = 60
#: V: a DC link measured lower counts as this much.
LEAST_LINK = 1.0


def injected(
    rotor: Array, duty: Array, v: complex, link: float, amplitude: float, sign: float, faded: float
) -> tuple[Array, complex]:
    """Duty cycles and voltage with a pulse of the wave.

    Parameters
    ----------
    rotor : ndarray, (2,)
        Speed, rad/s mechanical, and angle, rad electrical.
    duty : ndarray, (3,)
    v : complex
        Stator voltage of these duty cycles, V.
    link, amplitude : float
        DC link and the wave's amplitude, V.
    sign : float
        1 or -1.
    faded : float
        Speed at which nothing is left of the wave, rad/s.
    """
    link = link if link > LEAST_LINK else LEAST_LINK
    size, legs = amplitude * max(0.0, 1.0 - abs(rotor[0]) / faded), np.exp(-2j * np.pi / 3 * np.arange(3))
    size = min(size, 2 * link) if size > 0.0 else 0.0  # from corner to corner the hexagon measures 4 / 3 of the link
    pulse = sign * np.exp(1j * rotor[1])
    size = _fitting(duty, np.real(pulse * legs) / link, size)
    waved = duty + np.real(size * pulse * legs) / link
    return waved + (1.0 - waved.max() - waved.min()) / 2, v + size * pulse


def _fitting(duty: Array, more: Array, size: float) -> float:
    """The size of a pulse, at most this one, with which no two legs are further apart than a period."""
    if np.ptp(duty + size * more) <= 1.0:
        return size
    fits, beyond = 0.0, size
    for _ in range(HALVINGS):
        middle = 0.5 * (fits + beyond)
        fits, beyond = (middle, beyond) if np.ptp(duty + middle * more) <= 1.0 else (fits, middle)
    return fits


def learnt(
    rotor: Array, i: complex, believed: complex, wave: tuple[float, float], before: float, module: ModuleType
) -> float:
    """The resistance beyond the motor data, ohm, after a sample.

    Parameters
    ----------
    rotor : ndarray, (2,)
        Speed, rad/s mechanical, and angle, rad electrical.
    i, believed : complex
        Stator current measured and as the filter believes it, A.
    wave : tuple of float
        Amplitude of the square wave, V, and its sign in the interval that ended.
    before : float
        What was learnt so far, ohm.
    module : ModuleType
        Its gain, its limit, and the speed at which the wave has faded.
    """
    axis = np.exp(-1j * rotor[1])
    error, current = (axis * (i - believed)).imag, (axis * believed).imag
    left = max(0.0, 1.0 - abs(rotor[0]) * module.PER_FADED_SPEED)
    heard = min(wave[0], module.MOST_HEARD) if wave[0] > 0.0 else 0.0
    after = before - module.LEARNING_GAIN * heard * wave[1] * left * error * current
    return float(np.sign(after) * min(abs(after), module.MOST_RESISTANCE))


def link_injection(module: ModuleType, drive: str, kind: str, gain: str, link: float, seed: int = 5) -> Link:
    """By hand against generated float64.

    Parameters
    ----------
    module : ModuleType
        The generated module; one whose drive injects.
    drive, kind, gain : str
        Names of the drive and of its filter.
    link : float
        DC link of the drive file, V.
    seed : int, optional
    """
    rng, math = np.random.default_rng(seed), module.MATH["float64"]
    faded = 1.0 / module.PER_FADED_SPEED
    errors = []
    for k in range(DRAWS):
        duty = np.clip(rng.uniform(-0.2, 1.2, 3), 0.0, 1.0) if k % 2 else rng.uniform(0.2, 0.8, 3)
        v, rotor = rng.uniform(-link, link, 2), np.array([rng.uniform(-2, 2) * faded, rng.uniform(-4, 4)])
        measured = (link * rng.uniform(0.5, 1.5), 0.0, -link)[0 if k % 5 else k // 5 % 3]
        amplitude, sign = _amplitude(rng, link), rng.choice([-1.0, 1.0])
        with np.errstate(invalid="ignore"):  # an infinite wave of which speed leaves nothing
            found = module.inject(tuple(rotor), tuple(duty), tuple(v), (measured,), (amplitude, sign), math)
        wanted = injected(rotor, duty, complex(*v), measured, amplitude, sign, faded)
        errors.append(
            [
                np.max(np.abs(np.array(found[0]) - wanted[0])),
                abs(complex(*found[1]) - wanted[1]) / link,
                float(not np.array_equal(found[2], (amplitude, -sign), equal_nan=True)),
                max(0.0, np.max(np.abs(np.array(found[0]) - 0.5)) - 0.5),
            ]
        )
    named = {
        "duty cycles": ALLOWED,
        "voltage, of the DC link": ALLOWED,
        "amplitude kept, sign changed": 0.0,
        "duty cycles beyond 0 .. 1": ALLOWED,
    }
    rows = [*_rows(errors, named, "square wave on the d axis"), *_resistance(module, link, rng)]
    return Link("injection", "wave by hand = generated float64", drive, kind, gain, f"{2 * DRAWS} draws", tuple(rows))


def _amplitude(rng: np.random.Generator, link: float) -> float:
    """The wave's, V: mostly one that fits, now and then negative, no number, or absurd."""
    return float(rng.choice([link * rng.uniform(0, 0.6), -link, np.nan, np.inf, 1e3 * link], p=[0.8, *[0.05] * 4]))


def _rows(errors: list[list[float]], named: Mapping[str, float], what: str) -> list[Row]:
    """The worst of every column; what is no number is infinitely far off."""
    worst = [float(value) if np.isfinite(value) else float("inf") for value in np.max(np.array(errors), axis=0)]
    return [
        Row("-", name, what, value, allowed, DRAWS) for (name, allowed), value in zip(named.items(), worst, strict=True)
    ]


def _resistance(module: ModuleType, link: float, rng: np.random.Generator) -> list[Row]:
    """The learnt resistance, of its largest, and the voltage less what it takes; some draws reach the limit."""
    math, most, errors, limited = module.MATH["float64"], module.MOST_RESISTANCE, [], set()
    omega, theta = (module.STATES.index(name) for name in ("omega", "theta"))
    current = module.GAIN[module.GAIN_NAMES.index("max_current")]
    for _ in range(DRAWS):
        x = np.array(module.DEFAULTS["x_0"]) * rng.uniform(0.8, 1.2, len(module.STATES))
        x[:2] = rng.uniform(-1, 1, 2) * (module.DEFAULTS["x_0"][0] or current)  # flux linkages, or currents
        x[omega], x[theta] = rng.uniform(-1.5, 1.5) / module.PER_FADED_SPEED, rng.uniform(-np.pi, np.pi)
        believed = complex(*module.believed_currents(tuple(x), math))
        i = believed + current * rng.choice([1e-3, 0.1]) * complex(*rng.uniform(-1, 1, 2))
        phase = (i.real, (np.sqrt(3.0) * i.imag - i.real) / 2)
        wave, v = (_amplitude(rng, link), rng.choice([-1.0, 1.0])), rng.uniform(-link, link, 2)
        before = most * float(np.clip(rng.uniform(-1.3, 1.3), -1.0, 1.0))
        found = module.learn_resistance(tuple(x), phase, wave, (before,), tuple(v), math)
        wanted = learnt(x[[omega, theta]], i, believed, wave, before, module)
        limited.add(abs(wanted) == most)
        errors.append(
            [abs(found[0][0] - wanted) / most, abs(complex(*found[1]) - complex(*v) + wanted * believed) / link]
        )
    named = {"learnt, of the most": ALLOWED, "voltage less its own, of the DC link": ALLOWED}
    rows = _rows(errors, named, "resistance from the ripple")
    return [*rows, Row("-", "limit never reached, or always", "resistance", float(2 - len(limited)), 0.0, DRAWS)]
