"""What may befall a flight, as a vocabulary for scenarios: each a record that happens to a run."""

from __future__ import annotations

import math
from functools import partial
from typing import Final, NamedTuple

from sitl.autopilot.position_hold import AttitudeThrust
from sitl.scenarios.run import ScenarioRun
from sitl.vehicles.rotation import turned
from sitl.vehicles.vehicle import Rig, Vector
from sitl.wire.impairments import Channel, Impairments
from sitl.world.environment import Wind
from sitl.world.estimator import Lag, Noise
from sitl.world.estimator_status import NOMINAL, after_gps_loss, drift_after_gps_loss_m

EVERYTHING: Final = Channel.ALL
_STILL: Final = (0.0, 0.0, 0.0)


class Blow(NamedTuple):
    """Another wind."""

    wind: Wind

    def happen(self, run: ScenarioRun) -> None:
        run.environment.blow(self.wind)


class LoseMotor(NamedTuple):
    """Motors give less in all, and unevenly, which holds the attitude off its set-point."""

    thrust_share: float
    roll_deg: float = 0.0
    pitch_deg: float = 0.0

    def happen(self, run: ScenarioRun) -> None:
        environment = run.environment
        environment.motors = self.thrust_share
        environment.roll_bias_rad = math.radians(self.roll_deg)
        environment.pitch_bias_rad = math.radians(self.pitch_deg)


class Sag(NamedTuple):
    """The battery gives out: so much of the thrust a second."""

    share_1_s: float

    def happen(self, run: ScenarioRun) -> None:
        run.environment.sag_1_s = self.share_1_s


class Push(NamedTuple):
    """A force on a rig, over its mass."""

    acceleration_m_s2: float

    def happen(self, run: ScenarioRun) -> None:
        assert isinstance(run.autopilot.vehicle, Rig)
        run.autopilot.vehicle.push_m_s2 = self.acceleration_m_s2


# --- the estimator ------------------------------------------------------------------------------------------------


class GetNoisy(NamedTuple):
    """More noise."""

    noise: Noise

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.noise = self.noise


class LagBehind(NamedTuple):
    """Older estimates, with stamps that say they are fresh."""

    lag: Lag

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.lag = self.lag


class Drift(NamedTuple):
    """Position slides, velocity does not know."""

    rate_ned_m_s: Vector
    for_s: float = math.inf

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.drift_ned_m_s = self.rate_ned_m_s
        if math.isfinite(self.for_s):
            run.later(self.for_s, lambda: setattr(run.estimator, "drift_ned_m_s", _STILL))


class Jump(NamedTuple):
    """The estimate jumps; `counted`: the reset counter tells.

    The attitude loop lives in the estimate's heading, and PX4 turns the set-point that stands with it.
    """

    position_ned_m: Vector = _STILL
    velocity_ned_m_s: Vector = _STILL
    yaw_deg: float = 0.0
    counted: bool = True

    def happen(self, run: ScenarioRun) -> None:
        autopilot, yaw = run.autopilot, math.radians(self.yaw_deg)
        run.estimator.jump(self.position_ned_m, self.velocity_ned_m_s, yaw)
        if yaw:
            autopilot.heading_error_rad += yaw
            autopilot.setpoint = AttitudeThrust(turned(autopilot.setpoint.q_wxyz, yaw), autopilot.setpoint.thrust)
        autopilot.reset_counter = autopilot.reset_counter + self.counted & 255
        if self.counted:
            run.observer.mark()


class Freeze(NamedTuple):
    """The estimate repeats itself with fresh stamps."""

    for_s: float = math.inf

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.frozen = True
        if math.isfinite(self.for_s):
            run.later(self.for_s, lambda: setattr(run.estimator, "frozen", False))


class BecomeNaN(NamedTuple):
    """The position is no number."""

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.not_a_number = True


class LoseGps(NamedTuple):
    """As recorded from PX4: variances grow, position drifts, the flags drop at last."""

    towards: tuple[float, float] = (0.7, -0.7)  # north, east
    for_s: float = math.inf

    def happen(self, run: ScenarioRun) -> None:
        north, east = self.towards
        gone_m = 0.0

        def lose(elapsed_s: float) -> None:
            nonlocal gone_m
            if elapsed_s > self.for_s:
                return
            run.autopilot.health = after_gps_loss(elapsed_s)
            step = drift_after_gps_loss_m(elapsed_s) - gone_m
            gone_m += step
            run.estimator.jump((step * north, step * east, 0.0))

        run.each_step(lose)


class RegainGps(NamedTuple):
    """As recorded from PX4: the estimate jumps, `counted` so many times in one sample, and then slides uncounted."""

    counted: int = 4
    jump_ned_m: Vector = (0.0, 0.0, 1.4)
    slide_ned_m: Vector = _STILL
    slide_s: float = 0.9

    def happen(self, run: ScenarioRun) -> None:
        autopilot = run.autopilot
        autopilot.health = NOMINAL
        autopilot.reset_counter = autopilot.reset_counter + self.counted & 255
        run.estimator.jump(self.jump_ned_m)
        if self.slide_ned_m == _STILL:
            run.observer.mark()
        else:
            north, east, down = (part / self.slide_s for part in self.slide_ned_m)
            Drift((north, east, down), self.slide_s).happen(run)


class Doubt(NamedTuple):
    """The estimator says less of itself: fewer flags, a larger variance."""

    flags: int = 895
    position_m2: float = 0.02

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.health = run.autopilot.health._replace(flags=self.flags, horizontal_m2=self.position_m2)


class JumpClock(NamedTuple):
    """The time stamps of ODOMETRY are off by so much from now on."""

    by_s: float

    def happen(self, run: ScenarioRun) -> None:
        off_us = round(1e6 * self.by_s)
        run.autopilot.stamp_us = lambda now_us: max(now_us + off_us, 0)


class SlowClock(NamedTuple):
    """PX4's clock runs at this rate from now on, as in a simulation that the machine is too slow for."""

    rate: float

    def happen(self, run: ScenarioRun) -> None:
        began_us, rate = run.autopilot.time_us, self.rate
        run.autopilot.stamp_us = lambda now_us: began_us + round(rate * (now_us - began_us))


# --- the link -----------------------------------------------------------------------------------------------------


class Impair(NamedTuple):
    """The link gets worse; `None` leaves a direction as it is."""

    down: Impairments | None = None
    up: Impairments | None = None
    for_s: float = math.inf

    def happen(self, run: ScenarioRun) -> None:
        for channel, impairments in ((run.channels.down, self.down), (run.channels.up, self.up)):
            if impairments is not None:
                channel.impairments = impairments
                if math.isfinite(self.for_s):
                    run.later(self.for_s, partial(setattr, channel, "impairments", Impairments()))


class Mute(NamedTuple):
    """Messages get lost, or all of them, on the way down or up."""

    message_id: int = EVERYTHING
    for_s: float = math.inf
    upwards: bool = False

    def happen(self, run: ScenarioRun) -> None:
        channel = run.channels.up if self.upwards else run.channels.down
        channel.muted.add(self.message_id)
        if math.isfinite(self.for_s):
            run.later(self.for_s, lambda: channel.muted.discard(self.message_id))


class Thin(NamedTuple):
    """Only one in so many frames of a message passes on the way down."""

    message_id: int
    one_in: int

    def happen(self, run: ScenarioRun) -> None:
        run.channels.down.keep_one_in[self.message_id] = self.one_in
