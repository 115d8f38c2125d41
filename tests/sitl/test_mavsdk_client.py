"""A MAVSDK client against the plant, over a real socket: what an application developer would do first."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from harness.processes import PATIENCE_S, ROOT, end_of, eventually, line_with, plant
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, System
from mavsdk.plugins.action import Action
from mavsdk.plugins.info import Info
from mavsdk.plugins.offboard import Attitude, Offboard
from mavsdk.plugins.param import Param, ParamError
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry

TAKEOFF_M = 1.5


@pytest.fixture
def plant_port() -> Iterator[int]:
    """`companion sitl --serve` with the paper's quadrotor, quick to take off and to land."""
    quick = "{COM_SPOOLUP_TIME: 0.2, MPC_TKO_RAMP_T: 0.5, COM_DISARM_LAND: 0.5, NAV_MC_ALT_RAD: 0.3}"
    settings = ("--port", 0, "--set", f"plant.parameters={quick}")
    with plant(*settings, config=ROOT / "config" / "paper_quadrotor.yaml") as process:
        yield int(line_with(process, "udp port").rsplit(maxsplit=1)[-1])
        process.send_signal(signal.SIGTERM)
        end_of(process)
        assert process.returncode == 0, "SIGTERM must end the plant in good order"


@pytest.fixture
def system(plant_port: int) -> Iterator[System]:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        assert mavsdk.add_any_connection(f"udpout://127.0.0.1:{plant_port}") is ConnectionResult.SUCCESS
        found = mavsdk.first_autopilot(PATIENCE_S)
        assert found is not None
        yield found
    finally:
        mavsdk.destroy()


@pytest.mark.realtime
def test_fly_with_mavsdk(system: System) -> None:
    telemetry, action, param, offboard = Telemetry(system), Action(system), Param(system), Offboard(system)

    assert system.is_connected()
    assert eventually(telemetry.health_all_ok)
    assert eventually(lambda: telemetry.health().is_armable)
    assert eventually(lambda: telemetry.landed_state() is LandedState.ON_GROUND)
    version = Info(system).get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 17)

    assert param.get_param_float("COM_OF_LOSS_T") == 1.0
    param.set_param_float("MPC_LAND_SPEED", 1.25)
    assert param.get_param_float("MPC_LAND_SPEED") == 1.25
    assert param.get_param_int("NAV_RCL_ACT") == 2
    param.set_param_int("COM_OBL_RC_ACT", 5)
    assert param.get_param_int("COM_OBL_RC_ACT") == 5
    with pytest.raises(ParamError):
        param.get_param_int("MC_ROLL_P")
    everything = param.get_all_params()
    assert {p.name: p.value for p in everything.float_params}["MC_ROLL_P"] == 4.0
    assert {p.name: p.value for p in everything.int_params}["COM_OBL_RC_ACT"] == 5

    action.set_takeoff_altitude(TAKEOFF_M)
    action.arm()
    assert eventually(telemetry.armed)
    action.takeoff()
    assert eventually(lambda: telemetry.flight_mode() is FlightMode.HOLD and telemetry.in_air())
    assert eventually(lambda: telemetry.position_velocity_ned().position.down_m < 0.2 - TAKEOFF_M)

    offboard.set_attitude(Attitude(0.0, -3.0, 0.0, 0.5))
    offboard.start()
    assert eventually(lambda: telemetry.flight_mode() is FlightMode.OFFBOARD)
    assert eventually(lambda: telemetry.position_velocity_ned().velocity.north_m_s > 0.2), "nose down flies north"
    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.5))
    assert eventually(lambda: abs(telemetry.attitude_euler().pitch_deg) < 0.5)

    action.land()
    assert eventually(lambda: telemetry.landed_state() is LandedState.LANDING)
    assert eventually(lambda: telemetry.landed_state() is LandedState.ON_GROUND)
    assert eventually(lambda: not telemetry.armed())
