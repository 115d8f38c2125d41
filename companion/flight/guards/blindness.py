"""What a guard looks at may stop coming, and a last value that stays would look healthy for ever.

Each source has an age at which what it told is forgotten. A guard that could see and cannot any more says so once;
where it is the estimator that no longer answers for itself, control ends.
"""

from __future__ import annotations

import math
from typing import Final

from companion.flight.authority.states import Reason, State
from companion.flight.guards.estimator import missing_flags
from companion.flight.session import Session, To
from companion.flight.vehicle_link.messages import EstimatorStatus

ESTIMATOR_S: Final = 2.0  # without ESTIMATOR_STATUS, asked for at 5 Hz; or without a variance in the odometry
TIMESYNC_S: Final = 3.0  # without an answer, asked for at 5 Hz

_CAN_GO_BLIND: Final = (Reason.ESTIMATOR_FLAGS, Reason.POSITION_VARIANCE, Reason.LINK_DELAY)
_ENDS_CONTROL: Final = {
    Reason.ESTIMATOR_FLAGS: f"the estimator no longer answers: no ESTIMATOR_STATUS for {ESTIMATOR_S:g} s",
    Reason.POSITION_VARIANCE: f"the estimator no longer answers: no variance in its odometry for {ESTIMATOR_S:g} s",
}


class Sight:
    """Looks after the guards' sources, ten times a second."""

    def __init__(self, flight: Session) -> None:
        self._flight = flight
        self._status_at_s = self._variance_at_s = -math.inf
        self._told: set[Reason] = set()

    def on_estimator_status(self, status: EstimatorStatus) -> None:
        """What the estimator says of itself."""
        self._flight.watch.missing_flags = missing_flags(status.flags)
        self._status_at_s = self._flight.clock.elapsed_s()

    def look(self) -> None:
        """Forget what is too old, and tell or refuse where a guard has gone blind with it."""
        flight, now_s = self._flight, self._flight.clock.elapsed_s()
        if now_s - self._status_at_s > ESTIMATOR_S:
            flight.watch.missing_flags = math.nan
        flight.delay.forget(now_s - TIMESYNC_S)
        if flight.state not in (State.STANDBY, State.ENGAGED):
            self._variance_at_s = now_s
            return
        blind, known = flight.watch.blind(), flight.watch.known_blind
        if Reason.POSITION_VARIANCE not in blind:
            self._variance_at_s = now_s
        for reason in _CAN_GO_BLIND:
            if reason not in blind:
                known.discard(reason)
            elif reason is Reason.POSITION_VARIANCE and now_s - self._variance_at_s <= ESTIMATOR_S:
                continue  # one odometry without it is nothing
            elif reason not in known and reason not in self._told:
                self._gone_blind(reason, blind[reason])

    def _gone_blind(self, reason: Reason, what: str) -> None:
        flight = self._flight
        self._told.add(reason)
        flight.announce("blind", f"guard cannot see: {what}", To.EVERYBODY)
        if reason in _ENDS_CONTROL:
            flight.refuse(reason, _ENDS_CONTROL[reason])
