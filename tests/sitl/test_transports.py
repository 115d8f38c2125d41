"""A flight leaves the same bytes, whether plant and companion meet over sockets or in memory.

Where the companion goes by its own clock, that is virtual in memory: then a flight leaves the same bytes twice.
"""

import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from companion.config import load_config
from companion.flight.authority.states import Reason
from companion.flight.process import FlightProcess
from companion.mavlink.link import LinkError
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import build_world
from sitl.experiment import experiment
from sitl.scenarios.flight import Bases, fly
from sitl.scenarios.index import by_name
from sitl.scenarios.scenario import QUADROTOR, RIG
from sitl.wire.memory import LockstepLink

CONFIGS = Path(__file__).resolve().parents[2] / "config"
BASES = Bases({name: CONFIGS / name for name in (QUADROTOR, RIG)})
TEN = (
    "rig_pushed", "steered_by_velocity", "reset_of_yaw", "pilot_kills", "link_bad", "heartbeat_lost", "forged",
    "pilot_position", "px4_refuses_hold", "unplugged",
)  # fmt: skip


def record(folder: Path) -> list[tuple[int, bytes]]:
    """Every message of `flight.mcap`, and all of `traffic.tlog`."""
    with (folder / "flight.mcap").open("rb") as stream:
        messages = [(m.log_time, m.data) for _, _, m in make_reader(stream).iter_messages(log_time_order=False)]
    return [*messages, (0, (folder / "traffic.tlog").read_bytes())]


@pytest.mark.parametrize("name", TEN)
def test_a_scenario(name: str, tmp_path: Path) -> None:
    flown = [fly(by_name(name), BASES, tmp_path / kind, sockets=kind == "udp") for kind in ("udp", "memory")]
    assert [one.problems for one in flown] == [(), ()]
    over_udp, in_memory = record(tmp_path / "udp"), record(tmp_path / "memory")
    assert len(over_udp) > 200
    assert over_udp == in_memory


@pytest.mark.parametrize("name", ["outage", "frozen", "tick_overrun", "gain_changed_later"])
def test_a_scenario_by_the_companions_own_clock(name: str, tmp_path: Path) -> None:
    assert by_name(name).own_clock
    flown = [fly(by_name(name), BASES, tmp_path / turn) for turn in ("first", "second")]
    assert [one.problems for one in flown] == [(), ()]
    assert record(tmp_path / "first") == record(tmp_path / "second")


@pytest.mark.realtime
def test_a_scenario_by_a_clock_on_the_wall(tmp_path: Path) -> None:
    """Over sockets and in real time: what is virtual in memory is nothing else."""
    began_s = time.monotonic()
    flown = fly(by_name("pose_stale"), BASES, tmp_path, sockets=True)
    assert flown.problems == ()
    ticks = read_flight(tmp_path).ticks
    assert time.monotonic() - began_s > ticks["time_s"][-1] - ticks["time_s"][0] > 1.0


@pytest.mark.parametrize("base", [RIG, QUADROTOR])
def test_a_mission_on_a_clean_link(base: str, tmp_path: Path) -> None:
    """Over sockets the plant is a process of its own here, as `companion sitl` has it."""
    overrides = ("mission.duration_s=4", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.2, 0, 0]}]")
    path, folder = CONFIGS / base, tmp_path / "memory"
    config = load_config(path, overrides)
    job = experiment.Job(config, path, tmp_path / "udp", "hedged", overrides, True, 0, None)
    over_udp, _ = experiment.fly(job)

    recorder = open_folder(folder, path, config, blocking=True)
    link = LockstepLink(build_world(config).autopilot)
    in_memory = FlightProcess(config, link, recorder, hedging=True, engage=True, lockstep=True, wall=link.wall).run()
    assert recorder.close() is None
    assert (over_udp.reason, over_udp) == (Reason.MISSION_COMPLETE, in_memory)
    assert record(tmp_path / "udp") == record(folder)


def test_a_plant_that_has_ended_is_a_link_that_has_gone() -> None:
    link = LockstepLink(build_world(load_config(CONFIGS / RIG)).autopilot, stop=lambda: True)
    with pytest.raises(LinkError, match="has ended"):
        link.receive()
