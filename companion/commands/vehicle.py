"""`companion vehicle`: the vehicle's firmware, health and settings beside what was certified. It changes nothing."""

from __future__ import annotations

import argparse
import json
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.table import Table

from companion.commands.options import ConfigFile, add_config, add_json, add_tool_link, config_file
from companion.config.edit import flow
from companion.flight.readiness.px4_settings import Setting, Verdict, judge, unstated, wanted, worst
from companion.mavlink.client import Client
from companion.mavlink.vehicle_report import VehicleReport, read_vehicle

_COLOUR: Final = {Verdict.FINE: "green", Verdict.DIFFERS: "yellow", Verdict.DANGEROUS: "bold red"}
_SUMMARY: Final = {
    Verdict.FINE: "[bold green]Fine[/bold green]: nothing here speaks against a flight in OFFBOARD.",
    Verdict.DIFFERS: "[bold yellow]Differs[/bold yellow] from what was certified or counted on: see above.",
    Verdict.DANGEROUS: "[bold red]Dangerous[/bold red]: do not fly before that is mended.",
}


class Arguments(NamedTuple):
    """Of `companion vehicle`."""

    config: ConfigFile
    link: str | None
    json: bool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion vehicle`."""
    add_config(parser)
    add_tool_link(parser)
    add_json(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(config_file(namespace), namespace.link, namespace.json)


def run(arguments: Arguments) -> int:
    """Ask, judge, show. 0 all fine, 1 something differs or is dangerous. Raises `LinkError` without a vehicle."""
    config = arguments.config.load()
    console = Console(stderr=arguments.json)
    client = Client(config, arguments.link)
    try:
        with console.status("waiting for the vehicle"):
            client.connect()
            client.give_way()
        with console.status("asking"):
            report = read_vehicle(client, lambda version: (*wanted(version), *config.vehicle.parameters))
    finally:
        client.close()
    firmware, parameters = report.firmware, report.parameters
    rows = judge(config, firmware.version, str(firmware), report.health, parameters, report.odometry_hz)
    verdict = worst(rows)
    if arguments.json:
        print(json.dumps(_report(report, rows, verdict)))
    else:
        console.print(_table(client, rows))
        console.print(_SUMMARY[verdict])
        if gains := unstated(config, firmware.version, parameters):
            version = "{}.{}".format(*firmware.version)
            console.print(
                "What the attitude response is made of is not compared, `run` pins it as it reads it. Was it so at "
                f'identification? Then say so:\n  vehicle: {{px4_version: "{version}", parameters: {flow(gains)}}}',
                highlight=False,
            )
    return 0 if verdict is Verdict.FINE else 1


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


def _report(report: VehicleReport, rows: list[Setting], verdict: Verdict) -> dict[str, Any]:
    return {
        "firmware": list(report.firmware.version),
        "health": report.health,
        "parameters": report.parameters,
        "settings": [row._asdict() for row in rows],
        "verdict": verdict,
    }
