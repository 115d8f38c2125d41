"""Lies of the estimator: each kind on each quantity, in three winds, under two estimators. How far does the vehicle go?

python benchmarks/lies.py [--flights N] [--select PATTERN] [-j WORKERS]

`config/px4_quadrotor.yaml` flies a step of half a metre within a fence of 2 m; after 3 s the lie begins, and the
flight goes on for 25 s or until a guard ends it. Plant and companion are one program, in lockstep. Printed is a line a
flight: why control ended, how long the lie was flown, and how far the vehicle truly went in control. Exit code 1 where
one went farther than 3 m beyond the fence and is not on the list of what cannot be seen (`docs/safety.md`).
`--flights`: that many, spread over the catalogue; `--select`: those whose name matches, as stuck.x.* or *.calm.gps.
"""

from __future__ import annotations

import argparse
import fnmatch
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final, NamedTuple

import harness_path  # noqa: F401

from companion.config.guards.rows import Reason
from sitl.scenarios.faults import Blow
from sitl.scenarios.flight import Bases, fly
from sitl.scenarios.lies import TellLie
from sitl.scenarios.scenario import Flown, Scenario
from sitl.world.environment import Turbulence, Wind
from sitl.world.lies import QUANTITIES, Kind
from sitl.world.wind import Gust

ROOT: Final = Path(__file__).resolve().parents[1]
BASE: Final = "px4_quadrotor.yaml"
FENCE_M: Final = 2.0
BEYOND_M: Final = 3.0
BEGINS_S: Final = 3.0
LASTS_S: Final = 25.0
WINDS: Final = {
    "calm": Wind(),
    "wind": Wind((3.0, 2.0, 0.0), None, Turbulence(7.7, 6.0)),
    "gusts": Wind((4.0, 3.0, 0.0), Gust((2.0, 1.5, 0.3), 0.0, 1.0, 1.0, 8.0), Turbulence(15.0, 6.0)),
}
PRESETS: Final = ("gps", "motion_capture")
SIZES: Final = {  # of position, velocity, attitude: m, m/s, rad
    Kind.DRIFT: (0.3, 0.1, 0.01),
    Kind.SLIDE: (0.3, 0.1, 0.01),
    Kind.STEP: (0.45, 0.45, 0.035),
    Kind.SCALE: (0.5, 0.5, 0.5),
    Kind.DELAY: (0.5, 0.5, 0.5),
}
POSITION: Final = ("x", "y", "z")
VELOCITY: Final = ("vx", "vy", "vz")
TOGETHER: Final = {  # more than one quantity, or another size
    "stuck.x+vx": (TellLie(Kind.STUCK, ("x", "vx")),),
    "stuck.y+vy": (TellLie(Kind.STUCK, ("y", "vy")),),
    "stuck.z+vz": (TellLie(Kind.STUCK, ("z", "vz")),),
    "stuck.position": (TellLie(Kind.STUCK, POSITION), TellLie(Kind.NOISE, VELOCITY, 0.01)),
    "still.x+vx": (TellLie(Kind.STILL, ("x", "vx"), 0.02),),
    "still.z+vz": (TellLie(Kind.STILL, ("z", "vz"), 0.02),),
    "slide_fast.x": (TellLie(Kind.SLIDE, ("x",), 1.5),),
    "slide_fast.z": (TellLie(Kind.SLIDE, ("z",), -1.0),),
    "scale_up.x": (TellLie(Kind.SCALE, ("x",), 2.0),),
    "scale_up.z": (TellLie(Kind.SCALE, ("z",), 2.0),),
    "mirror.x": (TellLie(Kind.SCALE, ("x",), -1.0),),
    "mirror.x+vx": (TellLie(Kind.SCALE, ("x", "vx"), -1.0),),
    "mix.x+vx": (TellLie(Kind.MIX, ("x", "vx")),),
}


def unseen(name: str) -> str | None:
    """Why no guard can see this one, or None."""
    kind, of, _, preset = name.split(".")
    if kind == "drift" and of != "attitude":
        return "position and velocity agree, and it begins as slowly as wind"
    if kind == "still":
        if of.startswith("z"):
            return "position and velocity agree that it stands still under a payload that it carries"
        return "position and velocity agree that it stands still in a wind that it leans against"
    if kind == "slide" and of in POSITION[:2] and preset == "gps":
        return "slower than what GPS itself is wrong by"
    return None


class Lied(NamedTuple):
    """One flight of the catalogue."""

    name: str  # kind.quantity.wind.preset
    flown: Flown

    @property
    def went_m(self) -> float:
        """The farthest in control, from where control began."""
        return self.flown.in_control_m or 0.0

    @property
    def verdict(self) -> str:
        """How it stands."""
        if self.flown.in_control_m is None:
            return "NOT FLOWN: " + "; ".join(self.flown.problems)
        if self.went_m <= FENCE_M + BEYOND_M:
            return "held"
        return f"cannot be seen: {why}" if (why := unseen(self.name)) else "LEFT THE FENCE"


def catalogue() -> Iterator[tuple[str, tuple[TellLie, ...]]]:
    """Every lie by its name: kind and quantity."""
    for kind in (Kind.STUCK, Kind.DRIFT, Kind.SLIDE, Kind.STEP, Kind.SCALE, Kind.DELAY, Kind.MIX):
        for of in QUANTITIES:
            sizes = SIZES.get(kind, (0.0, 0.0, 0.0))
            yield f"{kind}.{of}", (TellLie(kind, (of,), sizes[min(QUANTITIES.index(of) // 3, 2)]),)
    yield from TOGETHER.items()


def scenario(name: str, lies: tuple[TellLie, ...]) -> Scenario:
    """The flight of a lie, in the wind and under the estimator that its name ends with."""
    _, _, wind, preset = name.split(".")
    return Scenario(
        name,
        "an estimate that lies",
        Reason.MISSION_COMPLETE,
        ((0.5, Blow(WINDS[wind])), *((BEGINS_S, lie) for lie in lies)),
        base=BASE,
        overrides=(
            f"mission.duration_s={BEGINS_S + LASTS_S:g}",
            "mission.waypoints=[{at_s: 8, offset_ned_m: [0.5, 0.5, -0.5]}, {at_s: 16, offset_ned_m: [0, 0, 0]}]",
            f"guards.fence={{enabled: true, radius_m: {FENCE_M:g}, lower_ned_m: [-9, -9, -{FENCE_M:g}], "
            f"upper_ned_m: [9, 9, {FENCE_M:g}]}}",
            f"plant.sensors={{preset: {preset}}}",
            f"estimator={{preset: {preset}}}",
        ),
        limit_s=BEGINS_S + LASTS_S + 5.0,
        coast_s=0.1,
    )


def flights() -> list[tuple[str, tuple[TellLie, ...]]]:
    """The whole catalogue."""
    return [(f"{name}.{wind}.{preset}", lies) for name, lies in catalogue() for wind in WINDS for preset in PRESETS]


def flown(named: tuple[str, tuple[TellLie, ...]]) -> Lied:
    """One flight, in this process."""
    name, lies = named
    with tempfile.TemporaryDirectory() as scratch:
        bases = Bases({BASE: ROOT / "config" / BASE})
        return Lied(name, fly(scenario(name, lies), bases, Path(scratch, "flight")))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, help="so many of them")
    parser.add_argument("--select", action="append", help="names to fly, * and ? allowed")
    parser.add_argument("-j", type=int, default=1, help="worker processes")
    arguments = parser.parse_args()
    chosen = flights()
    if arguments.select:
        chosen = [one for one in chosen if any(fnmatch.fnmatchcase(one[0], pattern) for pattern in arguments.select)]
    if arguments.flights:
        chosen = chosen[:: max(len(chosen) // arguments.flights, 1)][: arguments.flights]
    began_s = time.monotonic()
    print(f"{'lie':36} {'ended for':22} {'flown, s':>9} {'truth, m':>9}  verdict")
    counts: dict[str, int] = {}
    with ProcessPoolExecutor(arguments.j) as pool:
        for lied in pool.map(flown, chosen):
            lasted_s = (lied.flown.in_control_s or 0.0) - BEGINS_S
            print(
                f"{lied.name:36} {lied.flown.reason:22} {lasted_s:9.2f} {lied.went_m:9.2f}  {lied.verdict}", flush=True
            )
            verdict = lied.verdict.split(":")[0]
            counts[verdict] = counts.get(verdict, 0) + 1
    wall_s = time.monotonic() - began_s
    print(
        ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())),
        f"of {len(chosen)}; {wall_s:.0f} s",
    )
    return 0 if set(counts) <= {"held", "cannot be seen"} else 1


if __name__ == "__main__":
    sys.exit(main())
