"""The task that suits a drive: rated speed and torque, from its [rated] section or from what motor and inverter allow.

Scenarios, the proof's trajectory and fault surveys take their speeds and loads from here: a motor for 24 V must not
meet the 5 N m of a machine a hundred times its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from model.schema import Drive

#: The task of a drive file that states none, where the motor can do it: 1000 r/min (in rad/s) and 5 N m.
USUAL_SPEED, USUAL_TORQUE = 1000.0 * math.pi / 30.0, 5.0
#: Shares of base speed and of largest torque between which a task that is not stated is kept: there is enough
#: back-EMF to see the rotor by, and voltage and current are left to control it.
SPEED_SHARES, TORQUE_SHARES = (0.4, 0.8), (0.1, 0.5)
#: Largest share of the operating box, and of the inverter's voltage that the resistance may take.
BOX_SHARE, DROP_SHARE = 0.8, 0.5
#: A rms of a current sensor that no drive file states, unless its filter is tuned for less.
USUAL_NOISE = 0.05
#: rad: electrical angle that the rotor may turn in a sample.
TURN = 0.33
#: Shares of the largest torque: what friction may take, and what is left to accelerate with.
FRICTION_SHARE, ACCELERATION_SHARE = 0.3, 0.5


@dataclass(frozen=True)
class Rating:
    """What a drive is made for.

    ``speed`` mechanical rad/s, ``torque`` N m and the ``current`` (A, amplitude) that makes it; the limits of motor and
    inverter behind them: ``base_speed`` rad/s, at which ``torque`` takes the whole voltage; ``largest_torque`` N m, up
    to the rated speed, within the largest torque and power that the file states; ``slow_torque`` N m, the same of a
    slow rotor, which no power limits.
    """

    speed: float
    torque: float
    current: float
    base_speed: float
    largest_torque: float
    slow_torque: float

    def ramp(self, inertia: float, least: float) -> float:
        """Time in which half of the largest torque accelerates to the rated speed, s.

        Parameters
        ----------
        inertia : float
            kg m^2.
        least : float
            A shorter time is lengthened to this one, s.
        """
        return max(least, inertia * self.speed / (ACCELERATION_SHARE * self.largest_torque))

    def start_ramp(self, inertia: float, least: float) -> float:
        """The time of a reference to the rated speed that half of a slow rotor's torque can follow from rest, s.

        Where a power is stated the rotor falls behind later on: a reference that waited for it would ask for hardly any
        torque at rest.

        Parameters
        ----------
        inertia : float
            kg m^2.
        least : float
            A shorter time is lengthened to this one, s.
        """
        return max(least, inertia * self.speed / (ACCELERATION_SHARE * self.slow_torque))


def rating(drive: Drive) -> Rating:
    """The task of a drive: as its file states it, else the usual one as far as it suits the motor.

    Parameters
    ----------
    drive : Drive
        Motor data, current and voltage limits, operating box; ``[rated]`` where it is stated.
    """
    box, control, m = drive.operating_box, drive.control, drive.motor
    at_rest = DROP_SHARE * inverter_voltage(drive) / m.stator_resistance
    slow = largest = allowed_torque(drive, min(control.max_current, BOX_SHARE * box.current, at_rest))
    torque = min(max(USUAL_TORQUE, TORQUE_SHARES[0] * largest), TORQUE_SHARES[1] * largest)
    torque = drive.rated.torque if drive.rated else min(torque, BOX_SHARE * box.load_torque)
    current = mtpa_current(drive, torque)
    base = base_speed(drive, current)
    speed = min(max(USUAL_SPEED, SPEED_SHARES[0] * base), SPEED_SHARES[1] * base)
    ends = [speed, BOX_SHARE * box.speed, TURN / (m.pole_pairs * drive.model.sample_time)]
    ends += [FRICTION_SHARE * largest / m.friction] if m.friction else []
    speed = drive.rated.speed if drive.rated else min(ends)
    if control.max_power is not None and control.max_power < largest * speed:
        largest = control.max_power / speed
        torque = drive.rated.torque if drive.rated else min(torque, TORQUE_SHARES[1] * largest)
        current = mtpa_current(drive, torque)
    return Rating(speed, torque, current, base, largest, slow)


def allowed_torque(drive: Drive, current: float) -> float:
    """The most torque that a slow rotor gets, N m: of a current amplitude, or what the drive file allows.

    Parameters
    ----------
    drive : Drive
    current : float
        Amplitude, A.
    """
    most = drive.control.max_torque
    torque = mtpa_torque(drive, current)
    return torque if most is None else min(most, torque)


def mtpa_currents(drive: Drive, current: float) -> tuple[float, float]:
    """i_d, i_q (A) of a current amplitude (A) on the curve of maximum torque per ampere.

    Parameters
    ----------
    drive : Drive
    current : float
        Amplitude, A.
    """
    m = drive.motor
    reluctance = (m.inductance_q - m.inductance_d) * current / m.magnet_flux
    share = 2 * reluctance / (1 + math.sqrt(1 + 8 * reluctance * reluctance))
    return -share * current, math.sqrt(1 - share * share) * current


def mtpa_torque(drive: Drive, current: float) -> float:
    """Torque of a current amplitude on the curve of maximum torque per ampere, N m.

    Parameters
    ----------
    drive : Drive
    current : float
        Amplitude, A.
    """
    m = drive.motor
    i_d, i_q = mtpa_currents(drive, current)
    return 1.5 * m.pole_pairs * (m.magnet_flux + (m.inductance_d - m.inductance_q) * i_d) * i_q


def mtpa_current(drive: Drive, torque: float) -> float:
    """Least current amplitude that makes a torque, A: the inverse of :func:`mtpa_torque`.

    Torque grows faster than current on the curve, so Newton's steps from the current that the magnet alone would ask
    for come down to it without overshoot.

    Parameters
    ----------
    drive : Drive
    torque : float
        At least 0, N m.
    """
    m = drive.motor
    current = torque / (1.5 * m.pole_pairs * m.magnet_flux)
    for _ in range(60):
        i_d, i_q = mtpa_currents(drive, current)
        excess = mtpa_torque(drive, current) - torque
        # Along the curve torque is stationary in the current's angle, so its slope is that at the angle held.
        slope = 1.5 * m.pole_pairs * (m.magnet_flux + 2 * (m.inductance_d - m.inductance_q) * i_d) * i_q
        following = current - excess * current / slope if slope > 0 else current
        if not 0.0 < following < current:
            break
        current = following
    return current


def base_speed(drive: Drive, current: float) -> float:
    """Mechanical speed at which a current on the MTPA curve takes the whole voltage of the inverter, rad/s.

    v^2 = (R i_d - omega_e L_q i_q)^2 + (R i_q + omega_e (psi_m + L_d i_d))^2, solved for omega_e.

    Parameters
    ----------
    drive : Drive
    current : float
        Amplitude, A.

    Returns
    -------
    float
        0 where the resistance alone takes the voltage.
    """
    m = drive.motor
    v = inverter_voltage(drive)
    i_d, i_q = mtpa_currents(drive, current)
    psi_d, psi_q = m.magnet_flux + m.inductance_d * i_d, m.inductance_q * i_q
    flux, left = math.hypot(psi_d, psi_q), v * v - (m.stator_resistance * current) ** 2
    if left <= 0.0:
        return 0.0
    along = m.stator_resistance * (i_q * psi_d - i_d * psi_q) / flux
    return (math.sqrt(along * along + left) - along) / (flux * m.pole_pairs)


def inverter_voltage(drive: Drive) -> float:
    """Largest voltage amplitude, V: the dc link over sqrt(3), or the operating box where that ends first.

    Parameters
    ----------
    drive : Drive
    """
    return min(drive.control.dc_link / math.sqrt(3.0), drive.operating_box.voltage)


def sensor_noise(measurement_noise: Sequence[float]) -> float:
    """Noise of the phase-current sensors that simulations take, A rms: the usual one, or the filter's own if less.

    Parameters
    ----------
    measurement_noise : sequence of float
        As the drive file states it, A^2: alpha's is that of a phase.
    """
    return min(USUAL_NOISE, math.sqrt(measurement_noise[0]))
