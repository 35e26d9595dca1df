"""The facts file: what a person has of a drive, in the units it is known in; read, checked and turned into SI.

>>> facts = parse_facts(EXAMPLE, "example.toml")
>>> f"{facts.R:.2f} ohm, {facts.psi_m:.4f} Wb, {facts.speed:.1f} rad/s"
'0.30 ohm, 0.0070 Wb, 314.2 rad/s'
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from model.drives.load import explain
from model.drives.text import EncodingError, read_text
from model.schema import (
    Current,
    FluxLinkage,
    Friction,
    Inductance,
    Inertia,
    Resistance,
    SampleTime,
    Speed,
    Stated,
    Torque,
    Unit,
    Voltage,
)
from runtime.recorded.units import RPM
from runtime.system.errors import UserError

LineResistance = Annotated[float, Field(ge=2e-5, le=2e3), Unit("ohm")]
LineInductance = Annotated[float, Field(ge=2e-7, le=1.0), Unit("H")]
BackEmf = Annotated[float, Field(ge=1e-3, le=1e5), Unit("V/krpm")]
SpeedConstant = Annotated[float, Field(ge=1e-2, le=1e6), Unit("rpm/V")]
Rpm = Annotated[float, Field(ge=1.0, le=1e6), Unit("r/min")]
Power = Annotated[float, Field(ge=1e-3, le=1e8), Unit("W")]
Frequency = Annotated[float, Field(ge=100.0, le=1e6), Unit("Hz")]
Noise = Annotated[float, Field(ge=1e-6, le=1e4), Unit("A")]
DeadTime = Annotated[float, Field(ge=0.0, le=1e-4), Unit("s")]
Degrees = Annotated[float, Field(ge=0.0, le=180.0), Unit("degrees")]
StepTime = Annotated[float, Field(ge=1e-3, le=1e4), Unit("s")]
Share = Annotated[float, Field(ge=0.0, le=0.9), Unit("of the value")]
PairCount = Annotated[int, Field(ge=1, le=200, strict=True), Unit("pairs")]
BitCount = Annotated[int, Field(ge=4, le=24, strict=True), Unit("bits")]
PoleCount = Annotated[int, Field(ge=2, le=400, multiple_of=2, strict=True), Unit("poles")]

#: Degrees about 0 within which the rotor stands at the start, where a facts file does not say.
START_ANGLE = 30.0
#: Noise of a current sensor where a facts file does not say, of its range.
NOISE_SHARE = 1e-3


class Section(Stated):
    """Base of the sections: keys with their units, ranges, defaults and meanings.

    ``title``: its name in the file. ``alternatives``: quantities that can be stated in several ways; a way is a key, or
    some that go together.
    """

    title: ClassVar[str] = ""
    alternatives: ClassVar[tuple[tuple[tuple[str, ...], ...], ...]] = ()

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        for ways in self.alternatives:
            self._one_of(ways)
        return self

    def _one_of(self, ways: tuple[tuple[str, ...], ...]) -> None:
        """ValueError unless exactly one of the ways to state a quantity is taken, whole."""
        stated = [way for way in ways if any(getattr(self, key) is not None for key in way)]
        words = [" and ".join(f"{self.title}.{key}" for key in way) for way in ways]
        if not stated:
            raise ValueError(f"{' or '.join(words)} is missing; one is enough.")
        if len(stated) > 1:
            keys = [key for way in stated for key in way if getattr(self, key) is not None]
            both = " and ".join(f"{self.title}.{key}" for key in keys)
            raise ValueError(f"{both} state the same quantity; leave one of them out.")
        for key in stated[0]:
            if getattr(self, key) is None:
                raise ValueError(f"{self.title}.{key} is missing: {' and '.join(stated[0])} go together.")


class MotorFacts(Section):
    """The motor: star-equivalent phase values, or those between two terminals."""

    title = "motor"
    alternatives = (
        (("stator_resistance",), ("line_resistance",)),
        (("inductance_d", "inductance_q"), ("line_inductance",)),
        (("magnet_flux",), ("ke_v_per_krpm",), ("kv_rpm_per_v",)),
        (("pole_pairs",), ("poles",)),
    )

    stator_resistance: Resistance | None = Field(None, description="resistance of a phase")
    line_resistance: LineResistance | None = Field(None, description="resistance between two terminals")
    inductance_d: Inductance | None = Field(None, description="inductance of a phase along the magnets, L_d")
    inductance_q: Inductance | None = Field(None, description="inductance of a phase across the magnets, L_q")
    line_inductance: LineInductance | None = Field(None, description="inductance between two terminals, round rotor")
    magnet_flux: FluxLinkage | None = Field(None, description="flux linkage of the magnets, psi_m")
    ke_v_per_krpm: BackEmf | None = Field(None, description="Ke: back-EMF between two terminals at 1000 r/min, rms")
    kv_rpm_per_v: SpeedConstant | None = Field(
        None, description="Kv: speed over the peak voltage between two terminals"
    )
    pole_pairs: PairCount | None = Field(None, description="pole pairs")
    poles: PoleCount | None = Field(None, description="poles")
    inertia: Inertia = Field(description="inertia, with what is coupled to the shaft")
    friction: Friction = Field(default=0.0, description="friction that grows with speed")

    @property
    def pairs(self) -> int:
        """Pole pairs."""
        return self.pole_pairs or (self.poles or 0) // 2

    @property
    def resistance(self) -> float:
        """Of a phase, ohm; between two terminals are two phases."""
        return self.stator_resistance or (self.line_resistance or 0.0) / 2

    @property
    def inductances(self) -> tuple[float, float]:
        """L_d and L_q, H; between two terminals of a round rotor are two of them."""
        if self.line_inductance is not None:
            return self.line_inductance / 2, self.line_inductance / 2
        return self.inductance_d or 0.0, self.inductance_q or 0.0

    @property
    def flux(self) -> float:
        """Of the magnets, Wb.

        Back-EMF between terminals is sqrt(3) psi_m omega_e at its peak. ``ke_v_per_krpm`` is its rms at 1000 r/min,
        ``kv_rpm_per_v`` the speed at which its peak is 1 V.
        """
        if self.ke_v_per_krpm is not None:
            return self.ke_v_per_krpm * math.sqrt(2 / 3) / (self.pairs * 1000 / RPM)
        if self.kv_rpm_per_v is not None:
            return 1 / (math.sqrt(3) * self.pairs * self.kv_rpm_per_v / RPM)
        return self.magnet_flux or 0.0


class RatedFacts(Section):
    """The task: nameplate speed, torque or power, and the largest current that may flow."""

    title = "rated"
    alternatives = ((("speed_rpm",), ("speed",)), (("torque",), ("power",)))

    speed_rpm: Rpm | None = Field(None, description="rated speed")
    speed: Speed | None = Field(None, description="rated speed")
    torque: Torque | None = Field(None, description="rated torque")
    power: Power | None = Field(None, description="rated power at the shaft")
    max_current: Current = Field(description="largest current that may flow, peak of a phase")

    @property
    def omega(self) -> float:
        """Mechanical speed, rad/s."""
        return self.speed or (self.speed_rpm or 0.0) / RPM

    @property
    def shaft_torque(self) -> float:
        """N m."""
        return self.torque or (self.power or 0.0) / self.omega


class ToleranceFacts(Section):
    """Half-widths, of the value, within which the motor's data are known."""

    title = "tolerance"

    stator_resistance: Share = Field(default=0.2, description="how far off the resistance may be, warm too, as a share")
    inductance: Share = Field(default=0.1, description="how far off the inductance may be, as a share")
    magnet_flux: Share = Field(default=0.05, description="how far off the magnets' flux may be, as a share")
    inertia: Share = Field(default=0.2, description="how far off the inertia may be, as a share")


class InverterFacts(Section):
    """DC link and timing."""

    title = "inverter"
    alternatives = ((("sample_time",), ("pwm_frequency",)),)

    dc_link: Voltage = Field(description="DC link voltage")
    sample_time: SampleTime | None = Field(None, description="sample time")
    pwm_frequency: Frequency | None = Field(None, description="PWM frequency, one sample a period")
    dead_time: DeadTime = Field(default=0.0, description="dead time")

    @model_validator(mode="after")
    def _short(self) -> Self:
        if self.dead_time > 0.2 * self.period:
            raise ValueError(
                f"inverter.dead_time = {self.dead_time:g} s is more than a fifth of the sample time, "
                f"{self.period:g} s. Did you mean {self.dead_time * 1e-3:g} s?"
            )
        return self

    @property
    def period(self) -> float:
        """Sample time, s: one sample a period of the PWM."""
        return self.sample_time or 1 / (self.pwm_frequency or math.inf)


class SensorFacts(Section):
    """The current sensors: full scale of either sign, converter's bits, noise."""

    title = "sensor"

    range: Current = Field(description="largest current that the sensors measure, of either sign")
    bits: BitCount = Field(default=12, description="bits of the converter")
    noise: Noise | None = Field(
        None, description=f"noise of a measured current, rms; else {NOISE_SHARE:g} of the range"
    )


class StartFacts(Section):
    """How far the rotor may stand from angle 0 at the start, degrees electrical; "unknown" is 180."""

    title = "start"

    angle: Degrees = Field(
        default=START_ANGLE, description="how far off angle 0 the rotor may start, electrical, or unknown"
    )

    @field_validator("angle", mode="before")
    @classmethod
    def _unknown(cls, angle: Any) -> Any:
        return 180.0 if angle == "unknown" else angle


class LoadFacts(Section):
    """How often the load steps by about the rated torque."""

    title = "load"

    step_every: StepTime = Field(default=0.3, description="time between load steps of about the rated torque")


class FactsFile(Section):
    """A whole facts file."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$", description="name: small letters, digits and _")]
    motor: MotorFacts
    rated: RatedFacts
    tolerance: ToleranceFacts = ToleranceFacts()
    inverter: InverterFacts
    sensor: SensorFacts
    start: StartFacts = StartFacts()
    load: LoadFacts = LoadFacts()


#: The sections of a facts file.
SECTIONS: dict[str, type[Section]] = {
    section.title: section
    for section in (MotorFacts, RatedFacts, ToleranceFacts, InverterFacts, SensorFacts, StartFacts, LoadFacts)
}


@dataclass(frozen=True)
class Facts:
    """What is known, in SI: ohm, H, Wb, kg m^2, N m s/rad, mechanical rad/s, N m, A, V, s; angles in rad electrical.

    ``d_R`` .. ``d_J`` are half-widths of the value. ``angle`` is the largest angle from 0 at the start; pi: unknown.
    """

    name: str
    R: float
    L_d: float
    L_q: float
    psi_m: float
    p: int
    J: float
    D: float
    speed: float
    torque: float
    max_current: float
    d_R: float
    d_L: float
    d_psi: float
    d_J: float
    dc_link: float
    T: float
    dead_time: float
    range: float
    bits: int
    noise: float
    angle: float
    step_every: float

    @property
    def omega_e(self) -> float:
        """Electrical speed at the rated point, rad/s."""
        return self.p * self.speed

    @property
    def voltage(self) -> float:
        """Largest voltage of a phase, V: the inner circle of the hexagon."""
        return self.dc_link / math.sqrt(3)

    @property
    def sigma(self) -> float:
        """Noise of a current as sampled, A rms, the converter's rounding in it."""
        step = 2 * self.range / 2**self.bits
        return math.sqrt(self.noise**2 + step**2 / 12)


def read_facts(path: Path) -> Facts:
    """Read and check a facts file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        One line that names file, key, unit and range.
    """
    try:
        data = tomllib.loads(read_text(path))
    except (OSError, EncodingError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise UserError(f"facts '{path.name}': cannot be read: {reason}.") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"facts '{path.name}': not valid TOML: {error}") from None
    return parse_facts(data, path.name)


def parse_facts(data: Mapping[str, Any], where: str) -> Facts:
    """Check the tables of a facts file and turn them into SI.

    Parameters
    ----------
    data : mapping
        As tomllib reads them.
    where : str
        Name of the source in errors.

    Raises
    ------
    UserError
        One line that names source, key, unit and range.
    """
    try:
        file = FactsFile.model_validate(data)
    except ValidationError as error:
        problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        more = f" ({len(problems) - 1} more like it)" if len(problems) > 1 else ""
        raise UserError(f"facts '{where}': {explain(problems[0], SECTIONS, FactsFile)}{more}") from None
    return _in_si(file)


def _in_si(file: FactsFile) -> Facts:
    motor, rated, tolerance = file.motor, file.rated, file.tolerance
    L_d, L_q = motor.inductances
    return Facts(
        name=file.name,
        R=motor.resistance,
        L_d=L_d,
        L_q=L_q,
        psi_m=motor.flux,
        p=motor.pairs,
        J=motor.inertia,
        D=motor.friction,
        speed=rated.omega,
        torque=rated.shaft_torque,
        max_current=rated.max_current,
        d_R=tolerance.stator_resistance,
        d_L=tolerance.inductance,
        d_psi=tolerance.magnet_flux,
        d_J=tolerance.inertia,
        dc_link=file.inverter.dc_link,
        T=file.inverter.period,
        dead_time=file.inverter.dead_time,
        range=file.sensor.range,
        bits=file.sensor.bits,
        noise=file.sensor.noise or NOISE_SHARE * file.sensor.range,
        angle=math.radians(file.start.angle),
        step_every=file.load.step_every,
    )


#: The shortest facts file that is whole.
EXAMPLE: dict[str, Any] = {
    "name": "example",
    "motor": {
        "stator_resistance": 0.3,
        "line_inductance": 0.5e-3,
        "magnet_flux": 7e-3,
        "pole_pairs": 4,
        "inertia": 1e-5,
    },
    "rated": {"speed_rpm": 3000, "torque": 0.15, "max_current": 10.0},
    "inverter": {"dc_link": 24.0, "sample_time": 100e-6},
    "sensor": {"range": 20.0},
}
