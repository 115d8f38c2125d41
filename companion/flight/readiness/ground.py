"""Whether the vehicle stands on the ground, by its own word: nothing begins there.

Of a vehicle on the ground PX4 says "in the air" within 0.1 s of the first thrust in OFFBOARD. So what it says in
OFFBOARD is not believed, nor what it began to say just before. A position controller that takes over on the ground
cannot move the vehicle, integrates, and tips it over.
"""

from __future__ import annotations

import math
from typing import Final

_LONG_S: Final = 0.5


class Ground:
    """Args: `flies`, False for a rig, which has no ground, and for a vehicle without propellers; `takes_off`, whether
    the companion has it take off: then nobody is to switch to OFFBOARD on the ground.

    Attributes: `standing`, whether it says that it stands on the ground; `told`, whether it says so or otherwise.
    """

    def __init__(self, *, flies: bool, takes_off: bool = False) -> None:
        self._flies, self._takes_off = flies, takes_off
        self._air_since_s = -math.inf  # so that who comes to a vehicle in the air need not wait
        self._offboard_since_s: float | None = None
        self.standing = False
        self.told = not flies

    @property
    def idle(self) -> bool:
        """Whether to stream no thrust: switched to OFFBOARD, PX4 would fly it until the switch is heard of."""
        return self.standing and not self._takes_off

    def restart(self) -> None:
        """From here on the clock is another one."""
        self._air_since_s = -math.inf
        self._offboard_since_s = None

    def on_report(self, now_s: float, *, landed: bool, offboard: bool) -> None:
        """What it says of itself. `offboard`: the mode that it is in."""
        if not self._flies:
            return
        self.told = True
        if landed:
            self.standing = True
        elif self.standing and not offboard:
            self.standing, self._air_since_s = False, now_s

    def began_on(self, now_s: float, *, offboard: bool) -> bool:
        """Whether it stood there when OFFBOARD began, or would if it began now."""
        if not offboard:
            self._offboard_since_s = None
        elif self._offboard_since_s is None:
            self._offboard_since_s = now_s
        since_s = now_s if self._offboard_since_s is None else self._offboard_since_s
        return self.standing or since_s - self._air_since_s < _LONG_S
