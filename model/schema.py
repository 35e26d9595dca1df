"""The schema of a drive file: its sections, their units and ranges."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
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


class Stated(BaseModel):
    """Base of what a file states: unknown keys, numbers in quotes and truth values in a number's place are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _numbers_are_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        """Pydantic takes "2.875" for a number, and true for 1: in a file that is a slip."""
        key = info.field_name or ""
        if cls.model_fields[key].annotation not in {str, bool}:
            for entry in value if isinstance(value, list) else [value]:
                if isinstance(entry, bool) or (isinstance(entry, str) and _reads_as_number(entry)):
                    shown = str(entry).lower() if isinstance(entry, bool) else repr(entry)
                    raise ValueError(f"{key} = {shown} is no number: write it without quotes, as 0.5 or 1e-3.")
        return value


def _reads_as_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


class _OnlyStated(Stated):
    @model_serializer(mode="wrap")
    def _stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What may be left out, and is, does not show."""
        return {key: value for key, value in dump(self).items() if value is not None}


class Motor(Stated):
    """Motor data, SI, amplitude-invariant, d axis on the magnet flux."""

    stator_resistance: Resistance = Field(description="of a phase")
    inductance_d: Inductance = Field(description="of a phase, along the magnets")
    inductance_q: Inductance = Field(
        description="of a phase, across the magnets; equal to inductance_d for machine surface"
    )
    magnet_flux: FluxLinkage = Field(description="flux linkage of the magnets, peak of a phase")
    pole_pairs: Annotated[int, Field(ge=1, le=200, strict=True)] = Field(
        description="p: electrical angle over mechanical"
    )
    inertia: Inertia = Field(description="with what is coupled to the shaft")
    friction: Friction = Field(description="torque over speed")


class Model(Stated):
    """Which equations, and how they are sampled.

    ``machine``: a shipped word, or ``FILE.py:CLASS`` (:mod:`model.machines.own`).
    ``adaptive`` motor data wander and return to the motor's own within ``adaptive_time``, where nothing is learnt.
    """

    machine: str = Field(description="surface, salient, salient_flux, or FILE.py:CLASS of your own")
    mechanics: Literal["constant_speed", "load_torque"] = Field(
        default="constant_speed", description="what f knows of the load: nothing, or a torque that is a state"
    )
    discretization: Literal["euler", "exact"] = Field(
        description="forward Euler (eq. 7), or what is closer to the motor at the same T"
    )
    sample_time: SampleTime = Field(description="T, the time between two steps")
    adaptive: list[Literal["magnet_flux", "stator_resistance", "dead_time_voltage"]] = Field(
        default=[], description="motor data that are states beside the others"
    )
    adaptive_time: SlowTime = Field(
        default=1.0, description="within which an adaptive state returns to the motor's value"
    )

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


class Filter(Stated):
    """Kinds to generate and their tuning; every number here stays data in the generated struct.

    ``root_order``: the states in the order in which P is factored (eq. 13, 18); by default that of the state.
    """

    kinds: Annotated[list[Literal["ekf", "ukf", "ckf", "ickf"]], Field(min_length=1)] = Field(
        description="filters to generate"
    )
    gain: Literal["cubature", "jacobian"] = Field(
        default="cubature", description="of the ICKF: cubature points about each iterate, or its Jacobian (eq. 29, 30)"
    )
    max_iterations: Annotated[int, Field(ge=1, le=100, strict=True)] = Field(default=3, description="N_max of the ICKF")
    tolerance: Annotated[float, Field(gt=0, le=1.0)] = Field(default=1e-6, description="eps of eq. 33")
    initial_state: list[Annotated[float, Field(ge=-1e6, le=1e6)]] | None = Field(
        default=None, description="x_0; default zeros, motor data for adaptive states"
    )
    initial_covariance: list[Variance] = Field(description="diagonal of P_0, an entry a state")
    process_noise: list[Variance] = Field(description="diagonal of Q, added in each step, an entry a state")
    measurement_noise: Annotated[list[Variance], Field(min_length=2, max_length=2)] = Field(
        description="diagonal of R: variances of i_alpha and i_beta, A^2"
    )
    root_order: list[str] | None = Field(default=None, description="states in the order in which P is factored")


class OperatingBox(Stated):
    """Declared range: the certificate holds inside it, inputs beyond it are rejected by the step.

    Speed is mechanical. A drive that declares no box gets a wide one.
    """

    current: Current = Field(default=1000.0, description="largest of a phase")
    voltage: Voltage = Field(default=2000.0, description="largest of a phase")
    speed: Speed = Field(default=500.0, description="largest, mechanical")
    load_torque: Torque = Field(default=20.0, description="largest, where the load is a state")


class Rated(Stated):
    """The task a drive is made for: mechanical speed and torque that scenarios and trajectories take."""

    speed: Speed = Field(description="mechanical")
    torque: Torque = Field(description="at that speed")


class Start(Stated):
    """What is known of the rotor that stands: its angle is the initial state's, within ``angle`` degrees, or unknown.

    Where it is unknown the supervisor lets a second filter run beside the first one until the rotor has turned;
    ``filters = 1`` does without, where the sample time has no room for two. With ``method = "align"`` a direct current
    turns a rotor that stands to the initial state's angle (:mod:`model.alignment`), and one filter begins there.
    """

    angle: Literal["unknown"] | Annotated[float, Field(ge=0.0, le=90.0), Unit("degrees")] = Field(
        default="unknown", description="how far the rotor may stand from initial_state, or unknown"
    )
    filters: Literal[1, 2] | None = Field(
        default=None,
        description="2: a rival until the rotor has turned; default: 2 where angle is unknown and T at least 50 us",
    )
    method: Literal["align"] | None = Field(
        default=None, description="align: a direct current turns the rotor to the angle of initial_state first"
    )
    align_current: FadingCurrent = Field(
        default=None, description="that current; default: 0.8 of the largest, less where reluctance is large"
    )

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """An alignment that is not stated does not show."""
        hidden = {"method", "align_current"}
        return {key: value for key, value in dump(self).items() if value is not None or key not in hidden}


class Tolerance(Stated):
    """How far motor data may be off: half the width of the range each lies in, relative to the datum itself.

    The filter takes a datum's error for noise that stays alike for ``correlation_time``, see
    :mod:`model.machines.tolerance`; a datum that is an adaptive state is held within. ``inductance`` holds for each
    axis, and one says nothing of the other; ``dead_time`` for all that the inverter takes. A leg whose current has no
    sure sign keeps what it takes for ``unsure_samples``; half a sample: another sign in each.
    """

    stator_resistance: HalfWidth = Field(default=0.0, description="half-width of R, of its value")
    inductance: HalfWidth = Field(default=0.0, description="half-width of each inductance")
    magnet_flux: HalfWidth = Field(default=0.0, description="half-width of psi_m")
    dead_time: HalfWidth = Field(default=0.0, description="half-width of what the inverter takes")
    correlation_time: ShortTime = Field(default=5e-4, description="for which an error stays alike")
    unsure_samples: Samples = Field(default=4.0, description="for which a leg without a sure sign keeps what it takes")


class Control(_OnlyStated):
    """Field-oriented control: what the regulators' gains are computed from, and what the inverter offers.

    ``max_torque`` and ``max_power`` (mechanical, driving and braking alike) hold beside ``max_current`` where they are
    stated: what a gearbox, a battery or a law allows.
    """

    dc_link: Voltage = Field(default=311.0, description="voltage of the DC link")
    max_current: Current = Field(default=20.0, description="largest current, peak of a phase")
    max_torque: TorqueLimit = Field(default=None, description="largest torque at the shaft, driving and braking")
    max_power: PowerLimit = Field(default=None, description="largest mechanical power, driving and braking")
    current_bandwidth: Bandwidth = Field(default=1500.0, description="of the current regulators")
    speed_bandwidth: Bandwidth = Field(default=60.0, description="of the speed regulator")


class Inverter(Stated):
    """What the inverter takes from the voltage that is commanded (:mod:`model.inverter`).

    ``switching_frequency``: by default one period a sample. ``switch_drop``: of a switch or diode that conducts.
    ``fading_current``: below it a leg's sign is linear; by default what suits sensor and largest current.
    ``compensation_current``: the same for the controller's compensation; by default that of the model.
    """

    dead_time: DeadTime = Field(default=0.0, description="of a leg")
    switching_frequency: SwitchingFrequency = Field(default=None, description="default: one period a sample")
    switch_drop: SwitchDrop = Field(default=0.0, description="of a switch or diode that conducts")
    fading_current: FadingCurrent = Field(
        default=None,
        description="below it the sign of a leg's current fades; default: what suits sensor and largest current",
    )
    compensation_current: FadingCurrent = Field(
        default=None, description="the same in the controller's compensation; default: fading_current"
    )

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A current that is not stated does not show."""
        return {key: value for key, value in dump(self).items() if value is not None or not key.endswith("_current")}


class Budget(Stated):
    """Limits of a step's cost; ``generate`` fails beyond. Cycles are computed from published ones (150 MHz C28x).

    ``cycles``: the dearest filter alone; ``controller_cycles``: with the controller around it, the whole interrupt;
    ``k``: cycles an addition or multiplication is priced at, 2.5 typical, 5 the bound; ``ram_words``: the largest
    filter's state struct.
    """

    cycles: CycleCount = Field(default=None, description="most of the dearest filter's step")
    controller_cycles: CycleCount = Field(default=None, description="most of the whole interrupt")
    k: Annotated[float, Field(ge=1.0, le=10.0)] = Field(
        default=2.5, description="cycles an addition or multiplication is priced at"
    )
    ram_words: Annotated[int | None, Field(ge=10, le=10_000, strict=True), Unit("16-bit words")] = Field(
        default=None, description="most of a filter's struct"
    )


#: The target of a drive file that names none.
DEFAULT_TARGET = "f28335"


class TargetChoice(Stated):
    """The processor that C is generated for: ``name`` is a file of ``codegen/targets/chips``.

    ``constant_time``: every step of a filter whose status is 0 takes the same path, whatever its numbers.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")] = Field(
        default=DEFAULT_TARGET, description="a file of codegen/targets/chips"
    )
    constant_time: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="true: every step of a filter whose status is 0 executes the same instructions"
    )

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is left out does not show: folders of before read the same."""
        return {key: value for key, value in dump(self).items() if key != "constant_time" or value}


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
    def _alignment_is_possible(self) -> Drive:
        start, m, most = self.start, self.motor, self.control.max_current
        if start is None or start.method is None:
            if start is not None and start.align_current is not None:
                raise ValueError('start.align_current is for an alignment. Add method = "align", or drop it.')
            return self
        if start.filters == 2:
            raise ValueError('start.filters = 2 with method = "align": an aligned rotor has one filter. Drop filters.')
        reluctance = m.inductance_q - m.inductance_d
        if reluctance > 0.0:
            most = min(most, 0.9 * m.magnet_flux / reluctance)
        if start.align_current is not None and start.align_current > most:
            raise ValueError(
                f"start.align_current = {start.align_current:g} A is beyond {most:g} A, the largest current or, with "
                "reluctance, 0.9 of the one beyond which a rotor turns away from its axis."
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
    def constant_time(self) -> bool:
        """Whether every step of a filter whose status is 0 takes the same path."""
        return self.target is not None and self.target.constant_time

    @property
    def switching_frequency(self) -> float:
        """Switching periods a second, Hz: one a sample unless ``[inverter]`` says otherwise."""
        stated = self.inverter.switching_frequency if self.inverter else None
        return stated or 1.0 / self.model.sample_time
