"""What the parts of the flight process share: the link, the clock, who is in control, and one way to tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from companion.config.schema import Config
from companion.control.types import Odometry
from companion.flight.announcements import Announcements, To
from companion.flight.authority.states import Reason, State
from companion.flight.guards import table as guards
from companion.flight.guards.backlog import Backlog
from companion.flight.guards.blindness import Blindness
from companion.flight.guards.freshness import Freshness
from companion.flight.guards.look import Told
from companion.flight.guards.settling import Settling
from companion.flight.guards.watch import Watch
from companion.flight.host.clock import Clock, Wall
from companion.flight.pilot.pilot import Pilot
from companion.flight.readiness.ground import Ground
from companion.flight.readiness.hovering import Hovering
from companion.flight.readiness.plausible import Plausible
from companion.flight.readiness.preflight import Preflight
from companion.flight.vehicle_link.estimator_health import SOLUTIONS, EstimatorHealth
from companion.flight.vehicle_link.link import Link, VehicleLink
from companion.record.recorder import Recorder

__all__ = ["Ending", "Session", "To"]


class Ending(NamedTuple):
    """Why control is to end or has ended; `detail` as one line for a person, empty where the reason says it all."""

    reason: Reason
    detail: str = ""


class Session:
    """One flight's state. Every attribute is written in one place (tests/unit/flight/test_session.py).

    Attributes, besides the parts: `state` and `ending` of authority, the second once released; `fault`, why control is
    to end; `sample`, the newest odometry taken; `hands_off`, see `authority.hands_off`; `streamed` and `engaged`,
    whether that ever was; `ground_z_m`, height at stand-by; `ticks` recorded, `tick` the last of them.
    """

    def __init__(
        self,
        config: Config,
        link: Link,
        recorder: Recorder,
        *,
        hedging: bool,
        lockstep: bool,
        uncertified: bool = False,
        anyway: bool = True,
        engage: bool = False,
        bench: bool = False,
        wall: Wall | None = None,
        print_line: Callable[[str], None],
    ) -> None:
        self.config = config
        self.recorder = recorder
        self.lockstep = lockstep
        self.ids = (config.vehicle.system_id, config.vehicle.component_id)
        self.limits = {**guards.limits(config), **({Reason.LANDED: -math.inf} if bench else {})}
        self.clock = Clock(lockstep=lockstep, wall=wall)
        self.link = VehicleLink(config, link, recorder, self.clock)
        self.pose, self.delay = self.link.pose, self.link.delay
        self.announce = Announcements(recorder, self.clock, self.link, print_line).announce
        self.pilot = Pilot(config, hedging=hedging)
        # In lockstep the vehicle is the plant, whose attitude loop is not made of its parameters; and nothing is
        # certified of a response that is being identified.
        compare = not lockstep and config.mission.identification is None
        self.preflight = Preflight(config, self.pose, compare=compare, uncertified=uncertified)
        self.plausible = Plausible(config, anyway=anyway)
        flies = config.vehicle_kind.can_fly and not bench
        self.ground = Ground(flies=flies, hover_thrust=config.vehicle.hover_thrust, takes_off=engage)
        self.hovering = Hovering()
        self.estimator = EstimatorHealth()
        self.settling = Settling(config)
        self.watch = Watch(config, self.limits)
        forget = {Reason.ESTIMATOR_FLAGS: self.estimator.forget, Reason.LINK_DELAY: self.delay.forget}
        self.blindness = Blindness(config, self.limits, forget)
        self.freshness = Freshness(self.limits, self.clock.now_s)
        self.backlog = Backlog()
        self.state = State.CONNECTING
        self.fault: Ending | None = None
        self.ending = Ending(Reason.OPERATOR)
        self.hands_off: bool | None = None
        self.streamed = self.engaged = False
        self.sample: Odometry | None = None
        self.ground_z_m = 0.0
        self.ticks = 0
        self.tick = b""

    @property
    def speed_m_s(self) -> float:
        """Of the vehicle, as it says."""
        sample = self.sample
        return 0.0 if sample is None else math.sqrt(sample.vx_m_s**2 + sample.vy_m_s**2 + sample.vz_m_s**2)

    def turn(self, wall_s: float) -> None:
        """The loop turns: was this process stopped, what comes now is old."""
        sample = self.sample
        sample_s = math.nan if sample is None else sample.time_s
        paused_s = self.backlog.turn(wall_s, self.freshness.pose_at_s, sample_s)
        if paused_s:
            self.announce("paused", f"this process did not run for {paused_s:.2f} s")

    def is_old(self, sample: Odometry) -> bool:
        """Whether the sample was queued while this process did not run."""
        backlog = self.backlog
        return backlog.waiting and backlog.is_old(sample.time_s, self.clock.wall_s(), self.delay.clock_rate)

    def told(self) -> Told:
        """What the vehicle and the link last told beside the pose, for the guards."""
        pose, delay = self.pose, self.delay
        return Told(
            self.missing_solutions,
            pose.variance_ned_m2,
            pose.message == "ODOMETRY",
            delay.round_trip_s,
            delay.jitter_s,
            delay.clock_rate,
        )

    @property
    def missing_solutions(self) -> float:
        """Of the estimator's that are needed: all where the odometry itself says that it has failed; NaN if untold."""
        return float(SOLUTIONS) if self.pose.failed else self.estimator.missing

    def refuse(self, reason: Reason, detail: str = "") -> None:
        """Control is to end, or never to begin; the first fault stays. Safe in a signal handler."""
        if self.fault is None:
            self.fault = Ending(reason, detail)
