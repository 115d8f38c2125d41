"""`companion vehicle`: the vehicle's firmware, health and settings beside what was certified. It changes nothing."""

from __future__ import annotations

import argparse
import json
import time
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink
from rich.console import Console
from rich.table import Table

from companion.config import Config
from companion.flight.readiness.px4_settings import (
    INSTANCES,
    KINDS,
    ONBOARD,
    Setting,
    Verdict,
    judge_firmware,
    judge_health,
    judge_odometry,
    judge_parameters,
    unstated,
    worst,
)
from companion.mavlink.client import Client
from companion.mavlink.services import Services

_COLOUR: Final = {Verdict.FINE: "green", Verdict.DIFFERS: "yellow", Verdict.DANGEROUS: "bold red"}
_SUMMARY: Final = {
    Verdict.FINE: "[bold green]Fine[/bold green]: nothing here speaks against a flight in OFFBOARD.",
    Verdict.DIFFERS: "[bold yellow]Differs[/bold yellow] from what was certified or counted on: see above.",
    Verdict.DANGEROUS: "[bold red]Dangerous[/bold red]: do not fly before that is mended.",
}


def vehicle(config: Config, arguments: argparse.Namespace) -> int:
    """Ask, judge, show. 0 all fine, 1 something differs or is dangerous. Raises `LinkError` without a vehicle."""
    console = Console(stderr=arguments.json)
    client = Client(config, arguments.link)
    try:
        with console.status("waiting for the vehicle"):
            client.connect()
            client.give_way()
        began_s, odometry = time.monotonic(), client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY]
        with Services(client) as services, console.status("asking"):
            firmware = services.firmware()
            health = services.health()
            found = services.parameters({**dict.fromkeys(config.vehicle.parameters), **KINDS})
            found |= _rates(services)
        seconds = time.monotonic() - began_s
        rate_hz = (client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY] - odometry) / seconds
    finally:
        client.close()
    rows = [judge_firmware(firmware.version, str(firmware)), judge_health(health)]
    if not client.shared:  # behind a door what is hot does not come through
        rows.append(judge_odometry(config, rate_hz))
    rows += judge_parameters(config, found)
    verdict = worst(rows)
    if arguments.json:
        print(json.dumps(_report(firmware.version, health, found, rows, verdict)))
    else:
        console.print(_table(client, rows))
        console.print(_SUMMARY[verdict])
        if gains := unstated(config, found):
            # As the vehicle rounds them to 32 bits, so seven digits are all there are.
            stated = ", ".join(f"{name}: {value:.7g}" for name, value in gains.items())
            console.print(
                "These gains are not compared. Were they so at identification? Then say so, and `run` will compare "
                f"them:\n  vehicle: {{parameters: {{{stated}}}}}",
                highlight=False,
            )
    return 0 if verdict is Verdict.FINE else 1


def _rates(services: Services) -> dict[str, int | float]:
    """The byte rates of the onboard instances, where the vehicle has any."""
    onboard = []
    for instance in INSTANCES:
        mode = services.parameters({f"MAV_{instance}_MODE": int})
        if not mode:  # a simulated PX4 has none of them: the first one's silence is enough to wait for
            break
        if ONBOARD in mode.values():
            onboard.append(f"MAV_{instance}_RATE")
    return services.parameters(dict.fromkeys(onboard, int))


def _table(client: Client, rows: list[Setting]) -> Table:
    system, component = client.vehicle
    way = "through `companion run`" if client.shared else client.name
    table = Table(title=f"vehicle {system}/{component}, {way}", title_justify="left")
    table.add_column("setting", no_wrap=True)
    table.add_column("value", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("what to do, or why", overflow="fold")
    for row in rows:
        table.add_row(row.name, row.value, f"[{_COLOUR[row.verdict]}]{row.verdict}", row.advice)
    return table


def _report(
    version: tuple[int, int, int],
    health: dict[str, bool],
    found: dict[str, int | float],
    rows: list[Setting],
    verdict: Verdict,
) -> dict[str, Any]:
    return {
        "firmware": list(version),
        "health": health,
        "parameters": found,
        "settings": [row._asdict() for row in rows],
        "verdict": verdict,
    }
