"""Whether the vehicle flies, by evidence: control begins nowhere else, and ends where it has landed.

Of a vehicle on the ground PX4 says "in the air" within 0.1 s of the first thrust in OFFBOARD, and goes on saying so
when OFFBOARD has ended. So what it says in OFFBOARD is not believed, nor what it began to say just before, nor what its
height or the thrust that it flies speak against. A position controller that takes over on the ground cannot move the
vehicle, integrates, and tips it over.
"""

from __future__ import annotations

import math
from typing import Final

_LONG_S: Final = 0.5
_HEIGHT_M: Final = 0.3  # above where it stood, or below: a vehicle that rests drifts by less
_LIFT_SHARE: Final = 0.6  # of the believed hover thrust: less carries nothing
_THRUST_S: Final = 0.3  # time constant of the average of the thrust
_LANDED_S: Final = 0.3  # disarmed in the air it reads landed too: whether it is armed comes by then


class Ground:
    """Args: `flies`, False for a rig, which has no ground, and for a vehicle without propellers; `takes_off`, whether
    the companion has it take off: then nobody is to switch to OFFBOARD on the ground; `hover_thrust` of the config.

    Attributes: `standing`, whether it says that it stands on the ground; `told`, whether it says so or otherwise.
    """

    def __init__(self, *, flies: bool, hover_thrust: float, takes_off: bool = False) -> None:
        self._flies, self._takes_off = flies, takes_off
        self._least_thrust = _LIFT_SHARE * hover_thrust
        self._air_since_s = -math.inf  # so that who comes to a vehicle in the air need not wait
        self._offboard_since_s: float | None = None
        self._landed_since_s: float | None = None
        self._doubt: str | None = None  # when OFFBOARD began
        self._thrust: float | None = None  # flown outside OFFBOARD: the last one told, and their average
        self._thrust_average = self._thrust_at_s = 0.0
        self._z_m: float | None = None
        self._stood_z_m: float | None = None
        self.standing = False
        self.told = not flies

    @property
    def idle(self) -> bool:
        """Whether to stream no thrust, by which PX4 stays landed when it is switched to OFFBOARD.

        Not while PX4 itself pushes off: a pilot may lift off and switch before the vehicle says that it is in the air.
        """
        pushes_off = self._thrust is not None and self._thrust >= self._least_thrust
        return self.standing and not self._takes_off and not pushes_off

    def restart(self) -> None:
        """From here on the clock is another one."""
        self._air_since_s = self._thrust_at_s = -math.inf
        self._offboard_since_s = self._landed_since_s = None

    def on_height(self, z_m: float) -> None:
        """Where the estimate has it, down."""
        self._z_m = z_m
        if self.standing:
            self._stood_z_m = z_m

    def on_reset(self, z_m: float) -> None:
        """The estimate's height was reset by so much, down."""
        if self._stood_z_m is not None:
            self._stood_z_m += z_m

    def on_thrust(self, now_s: float, thrust: float, *, offboard: bool) -> None:
        """What it flies, normalised. In OFFBOARD that is what it is told, and no evidence."""
        if offboard or not math.isfinite(thrust):
            return
        passed_s = now_s - self._thrust_at_s
        share = 1.0 if self._thrust is None else 1.0 - math.exp(-max(passed_s, 0.0) / _THRUST_S)
        self._thrust, self._thrust_at_s = thrust, now_s
        self._thrust_average += share * (thrust - self._thrust_average)

    def on_report(self, now_s: float, *, landed: bool, offboard: bool, taking_off: bool = False) -> None:
        """What it says of itself. `offboard`: the mode that it is in; `taking_off`: no evidence but where we asked."""
        if not self._flies:
            return
        self.told = True
        if not landed:
            self._landed_since_s = None
        elif self._landed_since_s is None:
            self._landed_since_s = now_s
        if landed:
            self.standing = True
        elif self.standing and not offboard and (self._takes_off or not taking_off):
            self.standing, self._air_since_s = False, now_s

    def landed(self, now_s: float) -> bool:
        """Whether it has said for a while that it has landed."""
        return self._landed_since_s is not None and now_s - self._landed_since_s >= _LANDED_S

    def doubt(self, now_s: float, *, offboard: bool) -> str | None:
        """Why control must not begin, as a line; None where everything told agrees that OFFBOARD began in the air."""
        if not self._flies:
            return None
        if not offboard:
            self._offboard_since_s = None
            return self._standing() or self._against(now_s)
        if self._offboard_since_s is None:
            self._offboard_since_s, self._doubt = now_s, self._against(now_s)
        return self._standing() or self._doubt

    def _standing(self) -> str | None:
        return "it stands on the ground: take off first, and switch in the air" if self.standing else None

    def _against(self, now_s: float) -> str | None:
        """What speaks against that it flies now."""
        if not self.told:
            return "it does not tell whether it is in the air (EXTENDED_SYS_STATE)"
        air_s = now_s - self._air_since_s
        if air_s < _LONG_S:
            return f"it has been in the air for {air_s:.1f} s: switch later than after {_LONG_S:g} s"
        climbed_m = None if self._stood_z_m is None or self._z_m is None else self._stood_z_m - self._z_m
        if climbed_m is not None and abs(climbed_m) < _HEIGHT_M:
            return f"it says that it flies, {climbed_m:.2f} m above where it stood: climb first"
        if self._thrust is not None and self._thrust_average < self._least_thrust:
            return f"it says that it flies, at a thrust of {self._thrust_average:.2f}: that carries nothing"
        if climbed_m is None and self._thrust is None:
            return "it says that it flies, and tells neither its thrust (ATTITUDE_TARGET) nor where the ground is"
        return None
