"""Link "injection": the square wave on the d axis, by hand and generated.

Draws over all that the controller may hand on: duty cycles at and beside their limits, links that are missing, speeds
beyond the one at which the wave has faded. By hand it is one complex number, turned to the rotor and read on three
legs.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from runtime.proof.result import Link, Row

Array = NDArray[np.float64]

#: Some twenty roundings in float64, on the scale of a duty cycle and of the DC link.
ALLOWED = 1e-13
DRAWS = 400
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
    room = link * max(0.0, 1.0 - np.ptp(duty)) / np.sqrt(3.0)
    size = min(room, amplitude * max(0.0, 1.0 - abs(rotor[0]) / faded))
    pulse = sign * size * np.exp(1j * rotor[1])
    waved = duty + np.real(pulse * np.exp(-2j * np.pi / 3 * np.arange(3))) / link
    return waved + (1.0 - waved.max() - waved.min()) / 2, v + pulse


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
        amplitude, sign = link * rng.uniform(0, 0.6), rng.choice([-1.0, 1.0])
        found = module.inject(tuple(rotor), tuple(duty), tuple(v), (measured,), (amplitude, sign), math)
        wanted = injected(rotor, duty, complex(*v), measured, amplitude, sign, faded)
        errors.append(
            [
                np.max(np.abs(np.array(found[0]) - wanted[0])),
                abs(complex(*found[1]) - wanted[1]) / link,
                abs(found[2][0] - amplitude) + abs(found[2][1] + sign),
                max(0.0, np.max(np.abs(np.array(found[0]) - 0.5)) - 0.5),
            ]
        )
    worst = [float(value) if np.isfinite(value) else float("inf") for value in np.max(np.array(errors), axis=0)]
    named = {
        "duty cycles": ALLOWED,
        "voltage, of the DC link": ALLOWED,
        "amplitude kept, sign changed": 0.0,
        "duty cycles beyond 0 .. 1": ALLOWED,
    }
    rows = tuple(
        Row("-", name, "square wave on the d axis", value, allowed, DRAWS)
        for (name, allowed), value in zip(named.items(), worst, strict=True)
    )
    return Link("injection", "wave by hand = generated float64", drive, kind, gain, f"{DRAWS} draws", rows)
