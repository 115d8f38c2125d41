"""Who decides: armed or not, which mode was asked for, which mode flies.

The rules are those of PX4 v1.17 and v1.18 (`commander/Commander.cpp`, `UserModeIntention.cpp`, `failsafe/`), for a
multicopter with a valid estimate. The requested mode and the flying mode differ while a failsafe acts; the requested
mode is kept, so that a stream that resumes puts PX4 back in OFFBOARD by itself, unless somebody asked for another mode
in between.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from sitl.autopilot.modes import AUTO_MODES, EXTERNAL_MODES, PREVENT_ARMING, STICK_MODES, FlightMode, Severity
from sitl.autopilot.parameters import ManualLossAction, OffboardLossAction, Parameters, Px4Version

Notify = Callable[[Severity, str], None]

KILL_DISARM_US: Final = 5_000_000
STREAM_SLACK_US: Final = 40_000  # over COM_OF_LOSS_T: 1.0 Hz keeps OFFBOARD, 0.95 Hz does not

_OFFBOARD_LOSS_MODE: dict[int, FlightMode] = {
    OffboardLossAction.POSITION: FlightMode.POSCTL,
    OffboardLossAction.ALTITUDE: FlightMode.ALTCTL,
    OffboardLossAction.STABILIZED: FlightMode.STABILIZED,
    OffboardLossAction.RETURN: FlightMode.RTL,
    OffboardLossAction.LAND: FlightMode.LAND,
    OffboardLossAction.HOLD: FlightMode.HOLD,
    OffboardLossAction.TERMINATE: FlightMode.TERMINATION,
}
_MANUAL_LOSS_MODE: dict[int, FlightMode] = {
    ManualLossAction.HOLD: FlightMode.HOLD,
    ManualLossAction.RETURN: FlightMode.RTL,
    ManualLossAction.LAND: FlightMode.LAND,
    ManualLossAction.TERMINATE: FlightMode.TERMINATION,
}


class Commander:
    """Arming and modes of one vehicle.

    Attributes:
        armed: whether the motors may turn.
        user_mode: the mode last asked for and granted.
        mode: the mode that flies.
        failsafe: whether `mode` is a failsafe's choice instead of the user's.
        manual_control: whether a pilot's sticks are heard; there is none unless somebody sets this.
        position_valid: whether the estimator has a position.
        killed: whether the kill switch stopped the motors; PX4 disarms 5 s later.
        forced_failsafe: a failsafe that acts whatever the user's mode is, until the user asks for another mode.
    """

    def __init__(self, parameters: Parameters, can_fly: bool, notify: Notify) -> None:
        self._parameters = parameters
        self._can_fly = can_fly
        self._notify = notify
        self.armed = False
        self.user_mode = FlightMode.HOLD
        self.mode = FlightMode.HOLD
        self.failsafe = False
        self.landed = True
        self.manual_control = False
        self.position_valid = True
        self.killed = False
        self.forced_failsafe: FlightMode | None = None
        self._killed_at_us = 0
        self.armed_at_us = 0
        self.has_taken_off = False
        self._mode_after_disarming = FlightMode.HOLD
        self._setpoint_at_us: int | None = None
        self._landed_at_us: int | None = None

    # --- what is possible -------------------------------------------------------------------------------------------

    def offboard_signal(self, now_us: int) -> bool:
        """Whether the last set-point is younger than COM_OF_LOSS_T, as PX4 counts it."""
        if self._setpoint_at_us is None:
            return False
        return now_us < self._setpoint_at_us + int(1e6 * self._parameters.number("COM_OF_LOSS_T")) + STREAM_SLACK_US

    def can_run(self, mode: FlightMode, now_us: int) -> bool:
        """Whether a mode has what it needs."""
        if mode is FlightMode.OFFBOARD:
            return self.offboard_signal(now_us)
        if mode in STICK_MODES:
            return self.manual_control
        if mode is FlightMode.MISSION or mode in EXTERNAL_MODES:
            return False  # the plant holds no mission, and nobody has registered a mode
        if mode in (FlightMode.TAKEOFF, FlightMode.RTL, FlightMode.GUIDED_COURSE):
            return self._can_fly and self.position_valid
        return mode is not FlightMode.HOLD or self.position_valid

    def can_arm(self, now_us: int) -> bool:
        """Whether arming in the present mode would pass the checks."""
        return self.mode not in PREVENT_ARMING and self.can_run(self.mode, now_us)

    # --- what is asked for ------------------------------------------------------------------------------------------

    def setpoint_arrived(self, now_us: int) -> None:
        """An OFFBOARD set-point has come. It is the arrival that counts, not the time stamp in it."""
        self._setpoint_at_us = now_us

    def request(self, mode: FlightMode, now_us: int, *, force: bool = False) -> bool:
        """Ask for a mode; whether it was granted. A disarmed vehicle grants all but what it can never do."""
        impossible = not self._can_fly and mode in (FlightMode.TAKEOFF, FlightMode.RTL)
        denied = impossible or not (force or not self.armed or self.can_run(mode, now_us))
        if denied or self.mode is FlightMode.TERMINATION:
            self._notify(Severity.CRITICAL, f"Mode {mode.name} not available")
            return False
        self.user_mode = mode
        self.forced_failsafe = None
        if (mode not in PREVENT_ARMING and mode is not FlightMode.TAKEOFF) or mode is FlightMode.TERMINATION:
            self._mode_after_disarming = mode
        self.update(now_us)
        return True

    def arm(self, now_us: int) -> bool:
        """Arm if the checks pass; whether the vehicle is armed now."""
        if self.armed:
            return True
        if not self.can_arm(now_us):
            self._notify(Severity.CRITICAL, f"Arming denied: not possible in {self.mode.name}")
            return False
        self.armed = True
        self.armed_at_us = now_us
        self.has_taken_off = False
        self._landed_at_us = None
        self._notify(Severity.INFO, "Armed")
        self.update(now_us)
        return True

    def disarm(self, now_us: int, reason: str, *, force: bool = False) -> bool:
        """Disarm, in the air only by force; whether the vehicle is disarmed now."""
        if not self.armed:
            return True
        if not (force or self.landed):
            self._notify(Severity.CRITICAL, "Disarming denied: not landed")
            return False
        self.armed = False
        self.user_mode = self._mode_after_disarming  # so a flight in OFFBOARD reads OFFBOARD after landing
        self._notify(Severity.INFO, f"Disarmed by {reason}")
        self.update(now_us)
        return True

    def sticks_moved(self, now_us: int, travel_percent: float, speed_1_s: float) -> bool:
        """Sticks that a pilot moves so far from where they were, so fast; whether that takes control: Position then.

        v1.17 goes by the distance (COM_RC_STICK_OV), in OFFBOARD only where COM_RC_OVERRIDE has its second bit; v1.18
        by the speed (MAN_OVERRIDE_SPD), in OFFBOARD as in Hold.
        """
        self.manual_control = True
        offboard = self.mode is FlightMode.OFFBOARD
        if not self.armed or not (offboard or self.mode in AUTO_MODES):
            return False
        if self._parameters.version is Px4Version.V1_17:
            allowed = self._parameters.integer("COM_RC_OVERRIDE") & (2 if offboard else 1)
            taken = bool(allowed) and travel_percent > self._parameters.number("COM_RC_STICK_OV")
        else:
            taken = 0.0 <= self._parameters.number("MAN_OVERRIDE_SPD") < speed_1_s
        return taken and self.request(FlightMode.POSCTL, now_us)

    def kill(self, now_us: int) -> None:
        """The pilot's kill switch: the motors stop, the vehicle stays armed for a while (`COM_KILL_DISARM`)."""
        self.killed = True
        self._killed_at_us = now_us
        self._notify(Severity.CRITICAL, "Kill engaged")

    def start_in_air(self, now_us: int) -> None:
        """Armed and flying in Hold, as if a take-off had gone before."""
        self.armed = self.has_taken_off = True
        self.landed = False
        self.armed_at_us = now_us
        self.user_mode = self.mode = FlightMode.HOLD

    # --- what follows -----------------------------------------------------------------------------------------------

    def update(self, now_us: int) -> None:
        """Choose the mode that flies, and disarm where it is due."""
        previous, was_failsafe = self.mode, self.failsafe
        self.mode, self.failsafe = self._decide(now_us)
        if self.failsafe and (self.mode is not previous or not was_failsafe):
            self._notify(Severity.CRITICAL, f"Failsafe activated: {self.mode.name}")
        if self.armed:
            if self.killed and now_us - self._killed_at_us >= KILL_DISARM_US:
                self.disarm(now_us, "kill switch", force=True)
                return
            self._auto_disarm(now_us)

    def _decide(self, now_us: int) -> tuple[FlightMode, bool]:
        if self.mode is FlightMode.TERMINATION or self.user_mode is FlightMode.TERMINATION:
            return FlightMode.TERMINATION, False
        user = self.user_mode
        if self.armed and self.forced_failsafe is not None:
            return self._achievable(self.forced_failsafe), True
        if not self.armed or self.can_run(user, now_us):
            return user, False
        if user is FlightMode.OFFBOARD:
            return self._offboard_loss()
        if user in STICK_MODES:
            return self._manual_loss()
        return self._achievable(FlightMode.RTL if user is not FlightMode.LAND else FlightMode.LAND), True

    def _offboard_loss(self) -> tuple[FlightMode, bool]:
        action = self._parameters.integer("COM_OBL_RC_ACT")
        if action == OffboardLossAction.DISARM:
            self._failsafe_disarm()
            return self.user_mode, False
        mode = _OFFBOARD_LOSS_MODE.get(action, FlightMode.POSCTL)
        if mode in STICK_MODES and not self.manual_control:
            return self._manual_loss()
        return self._achievable(mode), True

    def _manual_loss(self) -> tuple[FlightMode, bool]:
        action = self._parameters.integer("NAV_RCL_ACT")
        if action == ManualLossAction.DISARM:
            self._failsafe_disarm()
            return self.user_mode, False
        v1_17 = self._parameters.version is Px4Version.V1_17
        if action == ManualLossAction.HOLD_NO_FAILSAFE and self.user_mode in STICK_MODES and not v1_17:
            self.user_mode = FlightMode.HOLD  # an ordinary change of mode
            return self._achievable(FlightMode.HOLD), False
        mode = _MANUAL_LOSS_MODE.get(action)
        if mode is None:
            return self.user_mode, False  # fly on with what there is: OFFBOARD too, with its last set-point
        return self._achievable(mode), True

    def _achievable(self, mode: FlightMode) -> FlightMode:
        if mode is FlightMode.RTL and not self._can_fly:
            return FlightMode.HOLD  # a rig has nowhere to return to
        if mode in (FlightMode.RTL, FlightMode.HOLD) and not self.position_valid:
            return FlightMode.LAND
        return mode

    def _failsafe_disarm(self) -> None:
        self.armed = False
        self.user_mode = self._mode_after_disarming
        self._notify(Severity.CRITICAL, "Disarmed by failsafe")

    def _auto_disarm(self, now_us: int) -> None:
        if not self.landed:
            self.has_taken_off = True
            self._landed_at_us = None
            return
        if self._landed_at_us is None:
            self._landed_at_us = now_us
        after_landing = self._parameters.number("COM_DISARM_LAND")
        before_takeoff = self._parameters.number("COM_DISARM_PRFLT")
        if self.has_taken_off:
            if 0.0 < 1e6 * after_landing <= now_us - self._landed_at_us:
                self.disarm(now_us, "landing")
        elif before_takeoff > 0.0:
            limit = before_takeoff + self._parameters.number("COM_SPOOLUP_TIME")
            if now_us - self.armed_at_us >= 1e6 * limit:
                self.disarm(now_us, "preflight timeout")
