"""The schema of a drive file: its sections, their units and ranges."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)


class DriveError(ValueError):
    """A drive file that cannot be used; the message is one line and says what, where and what would be right."""


class Unit:
    """Annotation of a physical key: its unit, used in error messages and tables."""

    def __init__(self, symbol: str) -> None:
        self.symbol = symbol


Resistance = Annotated[float, Field(ge=1e-5, le=1e3), Unit("ohm")]
Inductance = Annotated[float, Field(ge=1e-7, le=0.5), Unit("H")]
FluxLinkage = Annotated[float, Field(ge=1e-5, le=100.0), Unit("Wb")]
Inertia = Annotated[float, Field(ge=1e-11, le=1e8), Unit("kg m^2")]
Friction = Annotated[float, Field(ge=0.0, le=1e6), Unit("N m s / rad")]
ShortTime = Annotated[float, Field(ge=1e-6, le=1.0), Unit("s")]
SlowTime = Annotated[float, Field(ge=1e-2, le=1e6), Unit("s")]
SampleTime = Annotated[float, Field(ge=1e-6, le=1e-2), Unit("s")]
Current = Annotated[float, Field(ge=1e-3, le=1e5), Unit("A")]
Voltage = Annotated[float, Field(ge=1e-1, le=1e5), Unit("V")]
Bandwidth = Annotated[float, Field(ge=0.1, le=1e5), Unit("rad/s")]
Torque = Annotated[float, Field(ge=1e-7, le=1e7), Unit("N m")]
Speed = Annotated[float, Field(ge=0.1, le=3e4), Unit("rad/s")]
TorqueLimit = Annotated[float | None, Field(ge=1e-7, le=1e7), Unit("N m")]
PowerLimit = Annotated[float | None, Field(ge=1e-6, le=1e9), Unit("W")]
DeadTime = Annotated[float, Field(ge=0.0, le=1e-4), Unit("s")]
SwitchingFrequency = Annotated[float | None, Field(ge=100.0, le=1e6), Unit("Hz")]
SwitchDrop = Annotated[float, Field(ge=0.0, le=20.0), Unit("V")]
FadingCurrent = Annotated[float | None, Field(ge=1e-5, le=1e5), Unit("A")]
CycleCount = Annotated[int | None, Field(ge=100, le=1_000_000, strict=True), Unit("cycles")]
HalfWidth = Annotated[float, Field(ge=0.0, le=0.9)]
Samples = Annotated[float, Field(ge=0.5, le=1000.0)]
#: The C asks for 1e-18 .. 1e18 of Q and R: float32 must hold products and quotients of two.
Variance = Annotated[float, Field(ge=1e-18, le=1e12)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)


class _OnlyStated(_Section):
    @model_serializer(mode="wrap")
    def _stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What may be left out, and is, does not show."""
        return {key: value for key, value in dump(self).items() if value is not None}


class Motor(_Section):
    """Motor data, SI, amplitude-invariant, d axis on the magnet flux."""

    stator_resistance: Resistance
    inductance_d: Inductance
    inductance_q: Inductance
    magnet_flux: FluxLinkage
    pole_pairs: Annotated[int, Field(ge=1, le=200, strict=True)]
    inertia: Inertia
    friction: Friction


class Model(_Section):
    """Which equations, and how they are sampled.

    ``machine``: a shipped word, or ``FILE.py:CLASS`` (:mod:`model.machines.own`).
    ``adaptive`` motor data wander and return to the motor's own within ``adaptive_time``, where nothing is learnt.
    """

    machine: str
    mechanics: Literal["constant_speed", "load_torque"] = "constant_speed"
    discretization: Literal["euler", "exact"]
    sample_time: SampleTime
    adaptive: list[Literal["magnet_flux", "stator_resistance", "dead_time_voltage"]] = []
    adaptive_time: SlowTime = 1.0

    @property
    def return_rate(self) -> float:
        """The share of its way back that an adaptive state goes in a sample: T / adaptive_time, to a power of two."""
        return float(2.0 ** round(math.log2(self.sample_time / self.adaptive_time)))

    @field_validator("adaptive")
    @classmethod
    def _each_once(cls, words: list[str]) -> list[str]:
        for word in words:
            if words.count(word) > 1:
                raise ValueError(f"model.adaptive names '{word}' twice.")
        return words


class Filter(_Section):
    """Kinds to generate and their tuning; every number here stays data in the generated struct.

    ``root_order``: the states in the order in which P is factored (eq. 13, 18); by default that of the state.
    """

    kinds: Annotated[list[Literal["ekf", "ukf", "ckf", "ickf"]], Field(min_length=1)]
    gain: Literal["cubature", "jacobian"] = "cubature"
    max_iterations: Annotated[int, Field(ge=1, le=100, strict=True)] = 3
    tolerance: Annotated[float, Field(gt=0, le=1.0)] = 1e-6
    initial_state: list[Annotated[float, Field(ge=-1e6, le=1e6)]] | None = None
    initial_covariance: list[Variance]
    process_noise: list[Variance]
    measurement_noise: Annotated[list[Variance], Field(min_length=2, max_length=2)]
    root_order: list[str] | None = None


class OperatingBox(_Section):
    """Declared range: the certificate holds inside it, inputs beyond it are rejected by the step.

    Speed is mechanical. A drive that declares no box gets a wide one.
    """

    current: Current = 1000.0
    voltage: Voltage = 2000.0
    speed: Speed = 500.0
    load_torque: Torque = 20.0


class Rated(_Section):
    """The task a drive is made for: mechanical speed and torque that scenarios and trajectories take."""

    speed: Speed
    torque: Torque


class Start(_Section):
    """What is known of the rotor that stands: its angle is the initial state's, within ``angle`` degrees, or unknown.

    Where it is unknown the supervisor lets a second filter run beside the first one until the rotor has turned;
    ``filters = 1`` does without, where the sample time has no room for two.
    """

    angle: Literal["unknown"] | Annotated[float, Field(ge=0.0, le=90.0), Unit("degrees")] = "unknown"
    filters: Literal[1, 2] | None = None


class Tolerance(_Section):
    """How far motor data may be off: half the width of the range each lies in, relative to the datum itself.

    The filter takes a datum's error for noise that stays alike for ``correlation_time``, see
    :mod:`model.machines.tolerance`; a datum that is an adaptive state is held within. ``inductance`` holds for each
    axis, and one says nothing of the other; ``dead_time`` for all that the inverter takes. A leg whose current has no
    sure sign keeps what it takes for ``unsure_samples``; half a sample: another sign in each.
    """

    stator_resistance: HalfWidth = 0.0
    inductance: HalfWidth = 0.0
    magnet_flux: HalfWidth = 0.0
    dead_time: HalfWidth = 0.0
    correlation_time: ShortTime = 5e-4
    unsure_samples: Samples = 4.0


class Control(_OnlyStated):
    """Field-oriented control: what the regulators' gains are computed from, and what the inverter offers.

    ``max_torque`` and ``max_power`` (mechanical, driving and braking alike) hold beside ``max_current`` where they are
    stated: what a gearbox, a battery or a law allows.
    """

    dc_link: Voltage = 311.0
    max_current: Current = 20.0
    max_torque: TorqueLimit = None
    max_power: PowerLimit = None
    current_bandwidth: Bandwidth = 1500.0
    speed_bandwidth: Bandwidth = 60.0


class Inverter(_Section):
    """What the inverter takes from the voltage that is commanded (:mod:`model.inverter`).

    ``switching_frequency``: by default one period a sample. ``switch_drop``: of a switch or diode that conducts.
    ``fading_current``: below it a leg's sign is linear; by default what suits sensor and largest current.
    ``compensation_current``: the same for the controller's compensation; by default that of the model.
    """

    dead_time: DeadTime = 0.0
    switching_frequency: SwitchingFrequency = None
    switch_drop: SwitchDrop = 0.0
    fading_current: FadingCurrent = None
    compensation_current: FadingCurrent = None

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A current that is not stated does not show."""
        return {key: value for key, value in dump(self).items() if value is not None or not key.endswith("_current")}


class Budget(_Section):
    """Limits of a step's cost; ``generate`` fails beyond. Cycles are computed from published ones (150 MHz C28x).

    ``cycles``: the dearest filter alone; ``controller_cycles``: with the controller around it, the whole interrupt;
    ``k``: cycles an addition or multiplication is priced at, 2.5 typical, 5 the bound; ``ram_words``: the largest
    filter's state struct.
    """

    cycles: CycleCount = None
    controller_cycles: CycleCount = None
    k: Annotated[float, Field(ge=1.0, le=10.0)] = 2.5
    ram_words: Annotated[int | None, Field(ge=10, le=10_000, strict=True), Unit("16-bit words")] = None


#: The target of a drive file that names none.
DEFAULT_TARGET = "f28335"


class TargetChoice(_Section):
    """The processor that C is generated for: ``name`` is a file of ``codegen/targets/chips``."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")] = DEFAULT_TARGET


class Drive(_OnlyStated):
    """A validated drive file.

    ``sha256`` is the hash of the file's text, with the machine file's behind it where there is one; it goes into the
    generated header. ``machine_text`` is the text of a machine file of one's own.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    motor: Motor
    model: Model
    filter: Filter
    operating_box: OperatingBox = OperatingBox()
    control: Control = Control()
    inverter: Inverter | None = None
    budget: Budget = Budget()
    rated: Rated | None = None
    tolerance: Tolerance | None = None
    start: Start | None = None
    target: TargetChoice | None = None
    sha256: str = ""
    machine_text: Annotated[str, Field(exclude=True, repr=False)] = ""

    @model_validator(mode="after")
    def _machine_fits_motor(self) -> Drive:
        motor = self.motor
        if self.model.machine == "surface" and motor.inductance_d != motor.inductance_q:
            raise ValueError(
                f"motor.inductance_q = {motor.inductance_q:g} H differs from inductance_d = {motor.inductance_d:g} H; "
                "machine 'surface' needs them equal. Did you mean machine = 'salient' or 'salient_flux'?"
            )
        return self

    @model_validator(mode="after")
    def _dead_time_fits_period(self) -> Drive:
        inverter = self.inverter
        if inverter is not None and inverter.dead_time * self.switching_frequency > 0.25:
            raise ValueError(
                f"inverter.dead_time = {inverter.dead_time:g} s is more than a quarter of a switching period at "
                f"{self.switching_frequency:g} Hz. Did you mean {inverter.dead_time / 1e3:g} s?"
            )
        return self

    @property
    def stated(self) -> dict[str, Any]:
        """The sections as a manifest keeps them; a section that may be left out and is, is not told."""
        return self.model_dump(mode="json", exclude={"sha256", "name"})

    @property
    def target_name(self) -> str:
        """The processor that C is generated for."""
        return self.target.name if self.target else DEFAULT_TARGET

    @property
    def switching_frequency(self) -> float:
        """Switching periods a second, Hz: one a sample unless ``[inverter]`` says otherwise."""
        stated = self.inverter.switching_frequency if self.inverter else None
        return stated or 1.0 / self.model.sample_time
