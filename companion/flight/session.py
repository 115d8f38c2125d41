"""What the parts of the flight process share: the link, the clock, who is in control, and ways to tell."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import Config
from companion.control.types import Odometry
from companion.flight.authority.states import Reason, State
from companion.flight.guards import table as guards
from companion.flight.guards.blindness import Blindness
from companion.flight.guards.measures import Told
from companion.flight.guards.watch import Watch
from companion.flight.pilot.pilot import Pilot
from companion.flight.readiness.preflight import Preflight
from companion.flight.vehicle_link.estimator_status import EstimatorStatus
from companion.flight.vehicle_link.link_delay import LinkDelay
from companion.flight.vehicle_link.odometry import PoseSource
from companion.flight.vehicle_link.port import Port
from companion.mavlink.link import Link
from companion.record.recorder import EVENT, Recorder
from companion.record.schema import pack_event


class Session:
    """One flight's state. Every attribute has one writer, but `fault`, which anybody may raise.

    Attributes, besides the parts: `state`, `reason` and `detail` of authority; `fault`, why control is to end;
    `sample`, the newest odometry taken; `now_s` (our clock, or in lockstep the samples' own), `stamp_us` of what
    came last; `pose_at_s` and `heartbeat_at_s`, when they came; `aloof`, see `authority.hands_off`; `streamed` and
    `engaged`, whether that ever was; `ticks` recorded, `tick` the last of them.
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
        say: Callable[[str], None],
    ) -> None:
        self.config = config
        self.recorder = recorder
        self.lockstep = lockstep
        self.say = say
        self.ids = (config.vehicle.system_id, config.vehicle.component_id)
        self.limits = guards.limits(config)
        self.port = Port(config, link, recorder, lockstep=lockstep)
        self.pilot = Pilot(config, hedging=hedging)
        self.pose = PoseSource()
        # In lockstep the vehicle is the plant, whose attitude loop is not made of its parameters.
        self.preflight = Preflight(config, self.pose, compare=not lockstep, uncertified=uncertified)
        self.delay = LinkDelay()
        self.estimator = EstimatorStatus()
        self.watch = Watch(config, self.limits)
        forget = {Reason.ESTIMATOR_FLAGS: self.estimator.forget, Reason.LINK_DELAY: self.delay.forget}
        self.blindness = Blindness(config, self.limits, forget)
        self.state = State.CONNECTING
        self.reason = Reason.OPERATOR
        self.detail = ""
        self.fault: Reason | None = None
        self.aloof: bool | None = None
        self.streamed = self.engaged = False
        self.sample: Odometry | None = None
        self.ground_z_m = 0.0
        self.ticks = 0
        self.tick = b""
        self.stamp_us = 0
        self.began_wall_s = time.monotonic()
        self.now_s = 0.0 if lockstep else self.began_wall_s
        self.pose_at_s = self.heartbeat_at_s = self.now_s
        self.passed_s = 0.0

    @property
    def speed_m_s(self) -> float:
        """Of the vehicle, as it says."""
        sample = self.sample
        return 0.0 if sample is None else math.sqrt(sample.vx_m_s**2 + sample.vy_m_s**2 + sample.vz_m_s**2)

    def told(self) -> Told:
        """What the vehicle and the link last told beside the pose, for the guards."""
        pose, delay = self.pose, self.delay
        resets_counted = pose.message == "ODOMETRY"
        return Told(self.estimator.missing, pose.variance_ned_m2, resets_counted, delay.round_trip_s, delay.jitter_s)

    def clock_s(self) -> float:
        """Now, for waiting. In lockstep it is how much of the samples' time has passed, wherever their clock jumps."""
        return self.passed_s if self.lockstep else time.monotonic()

    def time_us(self) -> int:
        """Time stamp of records: wall clock, or the samples' own in lockstep."""
        return round(self.now_s * 1e6) if self.lockstep else time.time_ns() // 1000

    def refuse(self, reason: Reason, detail: str) -> None:
        """Control is to end, or never to begin; the first fault stays."""
        if self.fault is None:
            self.fault, self.detail = reason, detail

    def send(self, message: Any) -> None:
        """Send a pymavlink message, off the hot path."""
        self.port.send(message, self.time_us())

    def event(self, name: str, detail: str) -> None:
        """A line in the log."""
        self.recorder.add(EVENT, self.time_us(), pack_event(name, detail))

    def tell(self, text: str) -> None:
        """A warning to the ground station, cut to what a STATUSTEXT holds."""
        self.send(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, text.encode()[:50]))
