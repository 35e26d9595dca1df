"""A wrong square wave, and a resistance learnt wrongly from its ripple."""

from __future__ import annotations

from tests.mutants.catalogue.supervisor import FLUX, Rows, rows_of

_WAVE: Rows = (
    ("as much for both delays", "(answer if delay else -answer)", "answer", ("pytest tests/model/test_injection.py",)),
    ("no answer of the regulator", "2.0 * least / drive.model.sample_time + (answer if delay else -answer)", "2.0 * least / drive.model.sample_time", ("pytest tests/model/test_injection.py",)),
    ("no tolerance of the inductance", "(1.0 - (off or UNSTATED))", "(1.0 - off)", ("pytest tests/model/test_injection.py",)),
    ("room of two pairs of legs", "ca.fmin(rooms[0], ca.fmin(rooms[1], rooms[2]))", "ca.fmin(rooms[0], rooms[1])", FLUX),
    ("room for the other sign", "span - s * d", "span + s * d", FLUX),
    ("as much room for a short pulse", "/ (span * span))", "/ span)", FLUX),
    ("the wave never fades", "ca.fmax(amplitude * left, 0.0)", "ca.fmax(amplitude, 0.0)", FLUX),
    ("a negative wave", "ca.fmax(amplitude * left, 0.0)", "amplitude * left", FLUX),
    ("legs not centred", "centre = 0.5 - 0.5 * (lowest + highest)", "centre = 0.0 * (lowest + highest)", FLUX),
    ("told half of it", "v[1] + added[1]]", "v[1] + 0.5 * added[1]]", FLUX),
    ("a sign that stays", "[amplitude, -sign]", "[amplitude, sign]", FLUX),
)  # fmt: skip

_LEARNING: Rows = (
    ("learnt the other way", "before - learning_gain(drive) * shown", "before + learning_gain(drive) * shown", FLUX),
    ("learnt at speed", "shown = sign * heard * left * across", "shown = sign * heard * across", FLUX),
    ("learnt by the ripple along the axis", "_, across = rotor", "across, _ = rotor", FLUX),
    ("a larger wave teaches faster", "ca.fmin(ca.fmax(amplitude, 0.0), injected_voltage(drive))", "ca.fmax(ca.fmax(amplitude, 0.0), injected_voltage(drive))", FLUX),
    ("a negative wave teaches", "ca.fmin(ca.fmax(amplitude, 0.0), injected_voltage(drive))", "ca.fmin(amplitude, injected_voltage(drive))", FLUX),
    ("axes that are alike teach as well", "_trusted(drive) * bandwidth**2", "bandwidth**2", ("pytest tests/model/test_resistance.py",)),
    ("the current's direction forgotten", "left * across * i_q", "left * across", FLUX),
    ("no least resistance", "ca.fmax(ca.fmin(before - learning_gain(drive) * shown, most), -most)", "ca.fmin(before - learning_gain(drive) * shown, most)", FLUX),
    ("always the largest resistance", "ca.fmin(before - learning_gain(drive) * shown, most)", "ca.fmin(ca.fmax(before - learning_gain(drive) * shown, most), most)", FLUX),
    ("added to the voltage", "v[k] - resistance * believed[k]", "v[k] + resistance * believed[k]", FLUX),
    ("of the resistance before", "v[k] - resistance * believed[k]", "v[k] - before * believed[k]", FLUX),
    ("a loop twice as fast", "_trusted(drive) * bandwidth**2", "4 * _trusted(drive) * bandwidth**2", ("pytest tests/model/test_resistance.py",)),
    ("any tolerance is the usual one", "(share or UNSTATED)", "UNSTATED", ("pytest tests/model/test_resistance.py",)),
)  # fmt: skip


WAVE = (
    *rows_of("model/loop/injection.py", _WAVE),
    *rows_of("model/loop/resistance.py", _LEARNING),
)
