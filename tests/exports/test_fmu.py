"""FMUs in fmpy: valid, and the same bits as the estimator, alone and in a closed loop of two."""

from __future__ import annotations

import ctypes
import re
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi1
import fmpy.fmi2
import fmpy.fmi3
import fmpy.validation
import numpy as np
import pytest

from runtime.exports.description import base_unit
from runtime.exports.fmu import write_fmu
from runtime.exports.variables import PARTS, variables
from runtime.system.errors import UserError
from tests.conftest import ALL_DRIVES
from tests.exports.drives import STEPS, closed_loop, filter_run, folder_of


def made(folder: Path, drive: str, part: str, version: int) -> Path:
    generated = folder_of(drive)
    path = folder / f"{drive}_{part}_{version}.fmu"
    path.write_bytes(write_fmu(generated, generated.chosen(None), part, version))
    return path


@contextmanager
def instance(path: Path) -> Any:
    """An FMU in initialization mode, and the references of its variables."""
    about = fmpy.read_model_description(str(path))
    place = fmpy.extract(str(path))
    kind = fmpy.fmi2.FMU2Slave if about.fmiVersion == "2.0" else fmpy.fmi3.FMU3Slave
    token = about.guid if about.fmiVersion == "2.0" else about.instantiationToken
    slave = kind(
        guid=token, unzipDirectory=place, modelIdentifier=about.coSimulation.modelIdentifier, instanceName="one"
    )
    slave.instantiate()
    if about.fmiVersion == "2.0":
        slave.setupExperiment()
    slave.enterInitializationMode()
    try:
        yield slave, {variable.name: variable.valueReference for variable in about.modelVariables}
    finally:
        slave.freeInstance()
        shutil.rmtree(place)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("part", PARTS)
def test_valid(tmp_path: Path, part: str, version: int) -> None:
    for drive in ("servo_24v", "ipmsm_flux"):
        assert fmpy.validation.validate_fmu(str(made(tmp_path, drive, part, version))) == []


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    "drive", [pytest.param(d, marks=() if d == "servo_24v" else pytest.mark.thorough) for d in ALL_DRIVES]
)
def test_filter_has_the_bits_of_the_estimator(tmp_path: Path, drive: str, version: int) -> None:
    rows, states, status = filter_run(drive)
    folder = folder_of(drive)
    names = [f"{name}_estimate" for name in folder.module.STATES]
    T, real = folder.module.SAMPLE_TIME, float if version == 2 else np.float32
    inputs = [(name, real) for name in ("u_alpha", "u_beta", "i_alpha", "i_beta")]
    signals = np.zeros(STEPS, dtype=[("time", float), *inputs])
    signals["time"] = T * np.arange(STEPS)
    for (name, _), column in zip(inputs, rows.T, strict=True):
        signals[name] = column
    with instance(made(tmp_path, drive, "filter", version)) as (slave, place):
        slave.exitInitializationMode()
        get = slave.getReal if version == 2 else slave.getFloat32
        put = slave.setReal if version == 2 else slave.setFloat32
        count = slave.getInteger if version == 2 else slave.getInt32
        into, out = [place[name] for name, _ in inputs], [place[name] for name in names]
        for k in range(STEPS):
            put(into, [float(value) for value in rows[k]])
            slave.doStep(currentCommunicationPoint=k * T, communicationStepSize=T)
            assert np.array_equal(np.array(get(out), dtype=np.float32), states[k], equal_nan=True), k
            assert count([place["status"]])[0] == status[k], k
    assert len(set(status)) > 1  # the rejected inputs were among them


def test_simulated_by_fmpy(tmp_path: Path) -> None:
    rows, states, _ = filter_run("servo_24v")
    rows = rows[:1000]
    signals = np.zeros(1000, dtype=[(name, float) for name in ("time", "u_alpha", "u_beta", "i_alpha", "i_beta")])
    signals["time"] = 1e-4 * np.arange(1000)
    for name, column in zip(signals.dtype.names[1:], rows.T, strict=True):
        signals[name] = column
    path = made(tmp_path, "servo_24v", "filter", 2)
    result = fmpy.simulate_fmu(
        str(path), stop_time=0.1, step_size=1e-4, output_interval=1e-4, input=signals, output=["omega_estimate"]
    )
    assert np.array_equal(result["omega_estimate"][1:1001].astype(np.float32), states[:1000, 2])


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    "drive", [pytest.param(d, marks=() if d == "servo_24v" else pytest.mark.thorough) for d in ALL_DRIVES]
)
def test_two_in_a_closed_loop(tmp_path: Path, drive: str, version: int) -> None:
    """Drive and motor, exchanging values once a sample: the bits of the generated sources in a loop of their own."""
    folder = folder_of(drive)
    T = folder.module.SAMPLE_TIME
    speed, load, expected = closed_loop(drive, folder.chosen(None))
    drive_fmu, motor_fmu = (made(tmp_path, drive, part, version) for part in ("drive", "motor"))
    with instance(drive_fmu) as (control, c), instance(motor_fmu) as (motor, m):
        for slave in (control, motor):
            slave.exitInitializationMode()
        single = ("getReal", "setReal") if version == 2 else ("getFloat32", "setFloat32")
        double = ("getReal", "setReal") if version == 2 else ("getFloat64", "setFloat64")
        integer = ("getInteger", "setInteger") if version == 2 else ("getInt32", "setInt32")

        def get(slave: Any, kind: tuple[str, str], places: dict[str, int], *names: str) -> list[float]:
            return list(getattr(slave, kind[0])([places[name] for name in names]))

        def put(slave: Any, kind: tuple[str, str], places: dict[str, int], values: dict[str, Any]) -> None:
            getattr(slave, kind[1])([places[name] for name in values], list(values.values()))

        for k in range(STEPS):
            duty = get(control, single, c, "duty_a", "duty_b", "duty_c")
            gates = get(control, integer, c, "gates")
            phase = get(motor, single, m, "i_a", "i_b")
            put(control, single, c, {"i_a": phase[0], "i_b": phase[1], "speed_reference": float(speed[k])})
            put(motor, single, m, {f"duty_{leg}": value for leg, value in zip("abc", duty, strict=True)})
            put(motor, integer, m, {"gates": int(gates[0])})
            put(motor, double, m, {"load_torque": float(load[k])})
            for slave in (control, motor):
                slave.doStep(currentCommunicationPoint=k * T, communicationStepSize=T)
            row = [
                *get(motor, single, m, "i_a", "i_b"),
                *get(motor, double, m, "omega", "theta", "torque"),
                *get(control, single, c, "duty_a", "duty_b", "duty_c"),
                *get(control, integer, c, "gates", "mode", "status"),
            ]
            assert np.array_equal(row, expected[k]), (k, row, expected[k])
    assert {4, 6} & set(expected[:, 9].astype(int)), "the drive has started"
    assert np.abs(expected[:, 2]).max() > 0.2 * folder.manifest["parameters"]["operating_box"]["speed"]


@pytest.mark.parametrize("version", [2, 3])
def test_data_may_be_set(tmp_path: Path, version: int) -> None:
    """Tunable at any time, fixed before the first sample alone, outputs never."""
    error = fmpy.fmi1.FMICallException
    with instance(made(tmp_path, "servo_24v", "drive", version)) as (slave, place):
        put = slave.setReal if version == 2 else slave.setFloat32
        get = slave.getReal if version == 2 else slave.getFloat32
        whole = slave.setInteger if version == 2 else slave.setInt32
        advance = get([place["gain.advance"]])[0]
        whole([place["delay"]], [0])
        put([place["x_0.stator_resistance"]], [0.25])
        slave.exitInitializationMode()
        assert get([place["gain.advance"]])[0] == pytest.approx(advance / 3)  # T / 2 instead of 3 T / 2
        assert get([place["stator_resistance_estimate"]])[0] == np.float32(0.25)
        put([place["gain.max_current"]], [3.0])
        slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=2e-4)
        for name in ("omega_estimate", "x_0.omega"):
            with pytest.raises(error):
                put([place[name]], [1.0])
        with pytest.raises(error):
            whole([place["delay"]], [1])
        with pytest.raises(error):
            slave.doStep(currentCommunicationPoint=2e-4, communicationStepSize=1.5e-4)


@pytest.mark.parametrize("version", [2, 3])
def test_goes_back_to_a_state(tmp_path: Path, version: int) -> None:
    rows, states, _ = filter_run("servo_24v")
    with instance(made(tmp_path, "servo_24v", "filter", version)) as (slave, place):
        slave.exitInitializationMode()
        two = version == 2
        get, put = (slave.getReal, slave.setReal) if two else (slave.getFloat32, slave.setFloat32)
        names = ("u_alpha", "u_beta", "i_alpha", "i_beta")

        def step(k: int) -> Any:
            put([place[name] for name in names], [float(value) for value in rows[k]])
            slave.doStep(currentCommunicationPoint=k * 1e-4, communicationStepSize=1e-4)
            return get([place["theta_estimate"]])[0]

        for k in range(20):
            step(k)
        kept = slave.getFMUstate() if two else slave.getFMUState()
        packed = slave.serializeFMUstate(kept) if two else slave.serializeFMUState(kept)
        first = [step(k) for k in range(20, 40)]
        again = slave.deSerializeFMUstate(packed) if two else slave.deserializeFMUState(packed)
        (slave.setFMUstate if two else slave.setFMUState)(again)
        assert [step(k) for k in range(20, 40)] == first
        assert first[-1] == states[39, 3]
        slave.reset()


def test_every_function_of_the_standards_is_there(tmp_path: Path) -> None:
    """As the standards' own headers list them, which fmpy carries."""
    for version in (2, 3):
        header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h").read_text(encoding="utf-8")
        names = re.findall(rf"^ *FMI{version}_Export +fmi{version}\w+TYPE +(fmi{version}\w+);", header, re.MULTILINE)
        names = [name for name in names if version == 3 or name not in MODEL_EXCHANGE_2]
        place = fmpy.extract(str(made(tmp_path, "servo_24v", "filter", version)))
        (binary,) = Path(place).glob("binaries/*/*.so")
        library = ctypes.CDLL(str(binary))
        assert len(names) > 25
        assert [name for name in names if not hasattr(library, name)] == []
        shutil.rmtree(place)


MODEL_EXCHANGE_2 = {
    "fmi2EnterEventMode",
    "fmi2NewDiscreteStates",
    "fmi2EnterContinuousTimeMode",
    "fmi2CompletedIntegratorStep",
    "fmi2SetTime",
    "fmi2SetContinuousStates",
    "fmi2GetDerivatives",
    "fmi2GetEventIndicators",
    "fmi2GetContinuousStates",
    "fmi2GetNominalsOfContinuousStates",
}


def test_same_bytes_again() -> None:
    folder = folder_of("servo_24v")
    assert write_fmu(folder, "ckf", "filter", 3) == write_fmu(folder, "ckf", "filter", 3)


def test_units() -> None:
    """By hand: V is kg m^2 s^-3 A^-1; every unit of every part is known."""
    assert base_unit("V/A") == {"kg": 1, "m": 2, "s": -3, "A": -2}
    assert base_unit("(rad/s)^2") == {"rad": 2, "s": -2}
    assert base_unit("(N m)^2") == {"kg": 2, "m": 4, "s": -4}
    assert base_unit("N m s/rad") == {"kg": 1, "m": 2, "s": -1, "rad": -1}
    assert base_unit("kg m^2") == {"kg": 1, "m": 2}
    for drive in ALL_DRIVES:
        for part in PARTS:
            for variable in variables(folder_of(drive), part):
                assert not variable.unit or base_unit(variable.unit)


def test_another_machine_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(UserError, match="FMI 2 has no name for riscv64"):
        write_fmu(folder_of("servo_24v"), "ckf", "filter", 2)
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    with pytest.raises(UserError, match="--fmi 3"):
        write_fmu(folder_of("servo_24v"), "ckf", "filter", 2)
