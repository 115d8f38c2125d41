"""What differs between PX4 v1.17 and v1.18, as both answered in SITL; what does not differ is in the other files."""

from __future__ import annotations

import math
from typing import Final

import pytest
from harness.running_plant import HOVER_THRUST, quadrotor
from pymavlink.dialects.v20 import development as mavlink

from companion.control import attitude
from companion.mavlink.codec import FrameParser, decode_cold
from companion.mavlink.px4 import Result
from sitl.autopilot.attitude_reference import AttitudeReference
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.commands import VehicleCommand, execute
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.parameters import PX4_DEFAULTS, ManualLossAction, OffboardLossAction, Parameters, Px4Version
from sitl.messages.services import Services
from sitl.messages.streams import Profile, Streams
from sitl.messages.telemetry import Telemetry
from sitl.vehicles.rotation import UNCONTROLLED, euler, quaternion
from sitl.wire.memory import MemoryPort
from sitl.wire.plant import FIXED_EPOCH_US, Plant

V1_17, V1_18 = Px4Version
BOTH: Final = pytest.mark.parametrize("version", [V1_17, V1_18])
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
SENDER: Final = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
NO_THROTTLE: Final = 0x40
KEY: Final = bytes(range(32))


def autopilot(version: Px4Version, **parameters: float) -> Autopilot:
    return Autopilot(quadrotor(), Parameters({"MPC_THR_HOVER": HOVER_THRUST, **parameters}, version))


def in_hold(version: Px4Version, **parameters: float) -> Autopilot:
    pilot = autopilot(version, **parameters)
    pilot.start_in_air(5.0)
    return pilot


def stream(pilot: Autopilot, seconds: float, *, thrust: float = HOVER_THRUST, mask: int = 0x07) -> None:
    """Level set-points at 50 Hz."""
    for _ in range(round(50 * seconds)):
        pilot.on_attitude_target(LEVEL, thrust, mask)
        pilot.advance(pilot.time_us + 20_000)


def in_offboard(version: Px4Version, **parameters: float) -> Autopilot:
    pilot = in_hold(version, **parameters)
    stream(pilot, 0.1)
    assert set_mode(pilot, 6)[-1] is Result.ACCEPTED
    assert pilot.commander.mode is FlightMode.OFFBOARD
    return pilot


def set_mode(pilot: Autopilot, main: int, sub: int = 0) -> tuple[Result, ...]:
    return execute(pilot, VehicleCommand(176, 1.0, float(main), float(sub)))


# --- parameters, modes, commands ------------------------------------------------------------------------------------


def test_each_version_has_its_parameters() -> None:
    gone = {"COM_RC_OVERRIDE", "COM_RC_STICK_OV", "COM_TAKEOFF_ACT"}
    come = {"MAN_OVERRIDE_SPD", "MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX"}
    assert set(PX4_DEFAULTS[V1_17]) - set(PX4_DEFAULTS[V1_18]) == gone
    assert set(PX4_DEFAULTS[V1_18]) - set(PX4_DEFAULTS[V1_17]) == come
    with pytest.raises(KeyError, match="MC_REF_W_N"):
        Parameters({"MC_REF_W_N": 30.0}, V1_17)


@pytest.mark.parametrize(
    ("version", "main", "sub", "results", "mode"),
    [  # disarmed; as v1.17.0 and v1.18.0-alpha1 answered
        (V1_17, 11, 0, (0, 0), FlightMode.ALTITUDE_CRUISE),
        (V1_18, 11, 0, (0,), FlightMode.ALTITUDE_CRUISE),
        (V1_17, 4, 11, (0, 0), FlightMode.EXTERNAL_1),
        (V1_18, 4, 18, (0,), FlightMode.EXTERNAL_8),
        (V1_17, 4, 19, (0, 1), FlightMode.HOLD),
        (V1_18, 4, 19, (0,), FlightMode.GUIDED_COURSE),
        (V1_18, 4, 20, (1,), FlightMode.HOLD),
        (V1_17, 9, 0, (0, 0), FlightMode.HOLD),  # a main mode that there is not: nothing is done
        (V1_18, 9, 0, (1,), FlightMode.HOLD),
    ],
)
def test_modes_and_how_often_they_are_answered(
    version: Px4Version, main: int, sub: int, results: tuple[int, ...], mode: FlightMode
) -> None:
    pilot = autopilot(version)
    assert set_mode(pilot, main, sub) == results
    assert pilot.commander.mode is mode


@pytest.mark.parametrize(("version", "course"), [(V1_17, Result.TEMPORARILY_REJECTED), (V1_18, Result.ACCEPTED)])
def test_in_the_air_without_sticks_only_what_can_run(version: Px4Version, course: Result) -> None:
    pilot = in_hold(version)
    assert set_mode(pilot, 11)[-1] is Result.TEMPORARILY_REJECTED
    assert set_mode(pilot, 4, 11)[-1] is Result.TEMPORARILY_REJECTED
    assert set_mode(pilot, 4, 19)[-1] is course


class Link:
    """One link of an autopilot, by messages."""

    def __init__(self, pilot: Autopilot) -> None:
        telemetry = Telemetry(pilot, 1, 1, FIXED_EPOCH_US)
        self._services = Services(pilot, telemetry, Streams(telemetry, Profile.ONBOARD), 1, 1)

    def ask(self, message: object) -> list[object]:
        (frame,) = FrameParser().feed(bytes(message.pack(SENDER)))  # type: ignore[attr-defined]
        self._services.handle(frame)
        answers = FrameParser().feed(b"".join(self._services.replies))
        self._services.replies.clear()
        return [decode_cold(answer) for answer in answers]


@pytest.mark.parametrize("command", [410, 519, 520])
def test_the_old_requests_are_gone(command: int) -> None:
    message = mavlink.MAVLink_command_long_message(1, 1, command, 0, 1, 0, 0, 0, 0, 0, 0)
    assert Link(autopilot(V1_18)).ask(message)[-1].result == Result.UNSUPPORTED  # type: ignore[attr-defined]
    assert Link(autopilot(V1_17)).ask(message)[-1].result != Result.UNSUPPORTED  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("version", "number", "guided", "cruise", "offboard"),
    [(V1_17, 26, None, (8, 0), 11), (V1_18, 27, (8, 1), (9, 1), 12)],
)
def test_available_modes(
    version: Px4Version,
    number: int,
    guided: tuple[int, int] | None,
    cruise: tuple[int, int],
    offboard: int,
) -> None:
    """Place in the list and MAV_MODE_PROPERTY, as v1.17.0 and v1.18.0-alpha1 answered."""
    message = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 435, 0, 0, 0, 0, 0, 0)
    *modes, acknowledged = Link(autopilot(version)).ask(message)
    assert acknowledged.result == Result.ACCEPTED  # type: ignore[attr-defined]
    found = {m.mode_name: (m.mode_index, m.properties) for m in modes}  # type: ignore[attr-defined]
    assert len(modes) == number
    assert found.get("Guided Course") == guided
    assert found["Altitude Cruise"] == cruise
    assert found["Offboard"] == (offboard, 1)


@pytest.mark.parametrize(("version", "minor"), [(V1_17, 17), (V1_18, 18)])
def test_it_tells_its_version(version: Px4Version, minor: int) -> None:
    message = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    told = Link(autopilot(version)).ask(message)[0]
    assert told.flight_sw_version >> 16 == 1 << 8 | minor  # type: ignore[attr-defined]


# --- set-points -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("version", "kept"), [(V1_17, True), (V1_18, False)])
def test_an_attitude_without_thrust_as_a_signal(version: Px4Version, kept: bool) -> None:
    pilot = in_hold(version)
    stream(pilot, 0.5, mask=0x07 | NO_THROTTLE)
    assert (set_mode(pilot, 6)[-1] is Result.ACCEPTED) is kept
    pilot = in_offboard(version)
    stream(pilot, 0.8, mask=0x07 | NO_THROTTLE)
    fell = pilot.truth().velocity_ned_m_s[2] > 3.0
    assert fell is kept, "zero thrust in v1.17, the last thrust in v1.18"
    stream(pilot, 0.4, mask=0x07 | NO_THROTTLE)
    assert (pilot.commander.mode is FlightMode.OFFBOARD) is kept


@BOTH
def test_thrust_that_is_no_number_stops_the_motors(version: Px4Version) -> None:
    pilot = in_offboard(version)
    stream(pilot, 0.5, thrust=math.nan)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    assert pilot.truth().velocity_ned_m_s[2] > 3.0  # 5.1 m/s after a second on both


# --- sticks, and their loss -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("version", "parameters", "percent", "speed_1_s", "taken"),
    [
        (V1_17, {}, 100.0, 9.0, False),  # the default leaves OFFBOARD out
        (V1_17, {"COM_RC_OVERRIDE": 3}, 31.0, 0.1, True),
        (V1_17, {"COM_RC_OVERRIDE": 3}, 29.0, 9.0, False),
        (V1_18, {}, 10.0, 1.1, True),  # the default takes it
        (V1_18, {}, 100.0, 0.9, False),
        (V1_18, {"MAN_OVERRIDE_SPD": -1.0}, 100.0, 9.0, False),
    ],
)
def test_sticks_take_offboard(
    version: Px4Version, parameters: dict[str, float], percent: float, speed_1_s: float, taken: bool
) -> None:
    pilot = in_offboard(version, **parameters)
    assert pilot.commander.sticks_moved(pilot.time_us, percent, speed_1_s) is taken
    assert pilot.commander.user_mode is (FlightMode.POSCTL if taken else FlightMode.OFFBOARD)


@pytest.mark.parametrize("version", [V1_17, V1_18])
def test_sticks_take_hold_by_default(version: Px4Version) -> None:
    pilot = in_hold(version)
    assert pilot.commander.sticks_moved(pilot.time_us, 50.0, 5.0)
    assert pilot.commander.mode is FlightMode.POSCTL
    assert not autopilot(version).commander.sticks_moved(0, 50.0, 5.0), "disarmed"


@pytest.mark.parametrize(("version", "mode"), [(V1_17, FlightMode.POSCTL), (V1_18, FlightMode.HOLD)])
def test_sticks_lost_under_hold_without_failsafe(version: Px4Version, mode: FlightMode) -> None:
    pilot = in_hold(version, NAV_RCL_ACT=ManualLossAction.HOLD_NO_FAILSAFE)
    pilot.commander.manual_control = True
    pilot.commander.request(FlightMode.POSCTL, pilot.time_us)
    pilot.commander.manual_control = False
    pilot.commander.update(pilot.time_us)
    assert (pilot.commander.mode, pilot.commander.failsafe) == (mode, False)
    pilot.commander.manual_control = True
    pilot.commander.update(pilot.time_us)
    assert pilot.commander.mode is mode, "an ordinary change of mode is not taken back"


@BOTH
@pytest.mark.parametrize("action", [ManualLossAction.HOLD_NO_FAILSAFE, ManualLossAction.DISABLED])
def test_a_stream_that_ends_without_sticks_and_without_a_failsafe(version: Px4Version, action: int) -> None:
    """With COM_OBL_RC_ACT at its default: both fly on in OFFBOARD, for as long as one cared to look (8 s)."""
    pilot = in_offboard(version, NAV_RCL_ACT=action)
    pilot.advance(pilot.time_us + 8_000_000)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    for_sure = in_offboard(version, NAV_RCL_ACT=action, COM_OBL_RC_ACT=OffboardLossAction.HOLD)
    for_sure.advance(for_sure.time_us + 2_000_000)
    assert for_sure.commander.mode is FlightMode.HOLD


# --- disarmed after landing -----------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("before", [FlightMode.OFFBOARD, FlightMode.HOLD])
def test_after_a_commanded_land_it_returns_to_the_earlier_mode(version: Px4Version, before: FlightMode) -> None:
    pilot = in_offboard(version) if before is FlightMode.OFFBOARD else in_hold(version)
    assert set_mode(pilot, 4, 6)[-1] is Result.ACCEPTED
    assert pilot.commander.mode is FlightMode.LAND
    pilot.advance(pilot.time_us + 20_000_000)
    assert not pilot.commander.armed
    assert pilot.commander.mode is before


# --- signing --------------------------------------------------------------------------------------------------------


class SignedWire:
    """A plant in memory with one wire, and whether what it sends is signed."""

    def __init__(self, pilot: Autopilot) -> None:
        self.plant = Plant(pilot, FIXED_EPOCH_US)
        self.port = MemoryPort()
        self.port.connected = True
        self.plant.add(self.port, Profile.ONBOARD)

    def setup(self, key: bytes, stamp: int) -> None:
        self.send(mavlink.MAVLink_setup_signing_message(1, 1, list(key), stamp))

    def send(self, message: object) -> None:
        self.port.incoming.append(bytes(message.pack(SENDER)))  # type: ignore[attr-defined]
        self.plant.receive_all()

    def answers(self) -> bool:
        self.port.outgoing.clear()
        self.send(mavlink.MAVLink_ping_message(1, 2, 0, 0))
        return bool(self.port.outgoing)

    def signs(self) -> bool:
        self.port.outgoing.clear()
        pilot = self.plant.autopilot
        self.plant.advance(pilot.time_us + 1_100_000)
        return bool(self.port.outgoing[0][2] & 1)


def test_signing_is_set_up_while_disarmed_in_v1_18() -> None:
    wire = SignedWire(autopilot(V1_18))
    assert wire.answers()
    assert not wire.signs()
    wire.setup(KEY, 12345)
    assert wire.signs()
    assert not wire.answers(), "what is not signed is not heard"
    wire.setup(bytes(32), 0)
    assert wire.signs(), "a blank key must be signed itself"


@pytest.mark.parametrize("pilot", [in_hold(V1_18), in_hold(V1_17), autopilot(V1_17)])
def test_signing_is_not_set_up_while_armed_nor_in_v1_17(pilot: Autopilot) -> None:
    wire = SignedWire(pilot)
    wire.setup(KEY, 12345)
    assert wire.answers()
    assert not wire.signs()


def test_that_it_was_refused_is_told_to_a_ground_station() -> None:
    pilot = in_hold(V1_18)
    wire = SignedWire(pilot)
    wire.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    wire.port.outgoing.clear()
    wire.setup(KEY, 12345)
    assert b"rejected while armed" in b"".join(wire.port.outgoing)


# --- the reference model of attitude --------------------------------------------------------------------------------


def roll_step(pilot: Autopilot, seconds: float, *, step_rad: float = 0.1, period_us: int = 4_000) -> list[float]:
    """Roll at each set-point after a step, in OFFBOARD."""
    wanted = quaternion(step_rad, 0.0, 0.0)
    rolls = []
    pilot.on_attitude_target(LEVEL, HOVER_THRUST)
    pilot.advance(pilot.time_us + period_us)
    for _ in range(round(seconds * 1e6 / period_us)):
        pilot.on_attitude_target(wanted, HOVER_THRUST)
        pilot.advance(pilot.time_us + period_us)
        rolls.append(euler(*pilot.truth().q_wxyz)[0])
    return rolls


def lag_s(rolls: list[float], period_s: float = 4e-3) -> float:
    """Area between a step and its answer over the step: the sum of all delays and lags."""
    return period_s * sum(1.0 - roll / rolls[-1] for roll in rolls)


@pytest.mark.parametrize(("frequency_rad_s", "later_s"), [(50.0, 0.04), (200.0, 0.01), (20.0, 0.1)])
def test_v1_18_is_later_by_two_over_its_frequency(frequency_rad_s: float, later_s: float) -> None:
    before = lag_s(roll_step(in_offboard(V1_17), 3.0))
    after = lag_s(roll_step(in_offboard(V1_18, MC_REF_W_N=frequency_rad_s), 3.0))
    assert after - before == pytest.approx(later_s, abs=0.003)


def test_feed_forward_takes_the_lag_of_the_loop_off() -> None:
    """A rate fed forward is worth rate / gain in angle: 1 / 4 s less lag, where the cap does not cut it."""
    plain = lag_s(roll_step(in_offboard(V1_18), 3.0, step_rad=0.01))
    fed = lag_s(roll_step(in_offboard(V1_18, MC_REF_FF=1.0), 3.0, step_rad=0.01))
    assert plain - fed == pytest.approx(0.25, abs=0.005)
    capped = lag_s(roll_step(in_offboard(V1_18, MC_REF_FF=1.0, MC_REF_FF_MAX=5.0), 3.0, step_rad=0.1))
    assert fed + 0.1 < capped < plain
    uncapped = lag_s(roll_step(in_offboard(V1_18, MC_REF_FF=1.0, MC_REF_FF_MAX=0.0), 3.0, step_rad=0.1))
    assert uncapped == pytest.approx(fed, abs=0.01)


def test_the_model_stands_without_set_points() -> None:
    """It moves when a set-point arrives, for the time since the last: a single step at 50 Hz leaves it short."""
    model = AttitudeReference(Parameters(version=V1_18))
    model.follow(LEVEL, 0)
    wanted = quaternion(0.1, 0.0, 0.0)
    first = model.follow(wanted, 20_000)
    share = 1.0 - (1.0 + 1.0) * math.exp(-1.0)  # of a double pole after 1 / W_N
    assert euler(*first)[0] == pytest.approx(0.1 * share, rel=1e-3)
    assert model.follow(wanted, 900_000) == first
    arrived = model.follow(quaternion(0.1, 0.0, 0.0), 1_900_000)
    assert euler(*arrived)[0] == pytest.approx(0.1, abs=1e-4)
    assert attitude.yaw(*arrived) == pytest.approx(0.0, abs=1e-9)


def test_an_attitude_that_is_no_number_does_not_stay_in_the_model() -> None:
    model = AttitudeReference(Parameters(version=V1_18))
    model.follow(LEVEL, 0)
    assert model.follow(UNCONTROLLED, 20_000) is UNCONTROLLED
    wanted = quaternion(0.1, 0.0, 0.0)
    assert model.follow(wanted, 40_000) == wanted
