"""`companion sitl --serve`: the plant alone, for any MAVLink client."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from companion.config import Config, ConfigError
from companion.mavlink.link import LinkError
from companion.mavlink.signing import read_key
from companion.processes import end_with_input
from sitl.build import build_world
from sitl.messages.log_card import read_log
from sitl.wire.lockstep import LockstepTimeoutError
from sitl.wire.ports import GROUND_STATION, NOBODY, Endpoint, UdpEndpoint, parse_serial
from sitl.wire.server import serve

PX4_ONBOARD_PORT = 14580


class Arguments(NamedTuple):
    """Of `companion sitl --serve`."""

    config: Config  # with a plant section
    config_path: Path
    lockstep: bool
    port: int | None
    gcs_port: int | None
    link: str | None
    logs: tuple[Path, ...]
    end_with_input: bool = False


def run(arguments: Arguments) -> int:
    """The plant alone, until a signal stops it. Its first line on stdout tells where it is. Raises `CompanionError`."""
    config = arguments.config
    if arguments.end_with_input:
        end_with_input()
    try:
        world = build_world(config)
    except ConfigError as error:
        raise ConfigError(f"{arguments.config_path}: {error}") from None
    try:
        logs = [read_log(path) for path in arguments.logs]
    except OSError as error:
        raise ConfigError(f"--log {error.filename}: {error.strerror}") from None
    port = PX4_ONBOARD_PORT if arguments.port is None else arguments.port
    station_port = arguments.gcs_port
    if station_port is None:  # beside a port of one's own choice, PX4's usual one might be another plant's
        station_port = GROUND_STATION.port if arguments.port is None and arguments.link is None else 0
    try:
        first: Endpoint = parse_serial(arguments.link) if arguments.link else _udp(port)
        serve(
            world.autopilot,
            # A plant in lockstep serves one companion; any other a ground station too, as PX4 does.
            [first] if arguments.lockstep else [first, GROUND_STATION._replace(port=station_port)],
            lockstep=arguments.lockstep,
            on_ready=lambda bound: print(f"plant ready: {arguments.link or f'udp port {bound}'}", flush=True),
            logs=logs,
            channels=world.channels,
            signing_key=None if config.link.signing_key_file is None else read_key(config.link.signing_key_file),
        )
    except (OSError, ValueError) as error:
        reason = error.strerror or str(error) if isinstance(error, OSError) else str(error)
        raise LinkError(f"plant: {reason}") from None
    except LockstepTimeoutError as error:
        raise LinkError(f"plant: {error}") from None
    return 0


def _udp(port: int) -> UdpEndpoint:
    """On any free port a plant calls nobody: whoever listens where PX4 calls waits for another, and would answer."""
    return UdpEndpoint(port) if port else UdpEndpoint(port, NOBODY)
