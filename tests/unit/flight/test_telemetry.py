"""What a ground station is told: the values of the log, a few at a time, and a truthful status."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.flight.authority.states import Reason, State
from companion.flight.vehicle_link.ground_station import GroundStation, system_status
from companion.record import schema

VALUES = {
    "time_s": [12.3456], "position_m": [1.0, 2.0], "reference_position_m": [1.3, 2.4], "ideal_position_m": [1.0, 1.0],
    "position_weight": [-0.5, -0.6], "velocity_weight": [-0.3, -0.4], "hedge_deficit": [0.002, -0.003],
    "latency_s": [0.0005],
}  # fmt: skip


def tick(**changed: list[float]) -> bytes:
    values = {**VALUES, **changed}
    floats = [number for field in schema.FLOATS for number in values.get(field.name, [0.0] * field.size)]
    return schema.pack_tick(schema.CDR_HEADER, *floats, *[State.ENGAGED] * len(schema.FLAGS))


def told(ground: GroundStation, calls: int) -> list[tuple[str, float]]:
    return [(message.name, message.value) for _ in range(calls) for message in ground.messages(tick())]


def test_every_value_is_told_twice_a_second_two_at_a_call() -> None:
    ground = GroundStation(one_axis=False)
    assert all(len(ground.messages(tick())) == 2 for _ in range(9))
    once = dict(told(ground, 5))
    assert once == pytest.approx(
        {
            "err_track": 0.5, "err_ideal": 1.0, "w_pos_x": -0.5, "w_pos_y": -0.6, "w_vel_x": -0.3, "w_vel_y": -0.4,
            "hedge_x": 2.0, "hedge_y": -3.0, "latency_ms": 0.5,
        }
    )  # fmt: skip
    second = [name for name, _ in told(ground, 10)]
    assert {second.count(name) for name in once} <= {2, 3}


def test_a_rig_has_no_y() -> None:
    ground = GroundStation(one_axis=True)
    once = dict(told(ground, 3))
    assert set(once) == {"err_track", "err_ideal", "w_pos_x", "w_vel_x", "hedge_x", "latency_ms"}
    assert once["err_track"] == pytest.approx(0.3)
    assert once["err_ideal"] == 0.0


def test_a_message_holds_what_was_packed_and_its_name_fits() -> None:
    ground = GroundStation(one_axis=False)
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    for _ in range(5):
        for message in ground.messages(tick()):
            decoded = mavlink.MAVLink(None).decode(bytearray(message.pack(packer)))
            assert 0 < len(decoded.name) <= 10
            assert decoded.time_boot_ms == 12346
            assert decoded.value == pytest.approx(message.value, rel=1e-6)


def test_out_of_control_there_is_nothing_to_tell() -> None:
    assert GroundStation(one_axis=False).messages(tick(ideal_position_m=[math.nan, math.nan])) == []


@pytest.mark.parametrize(
    ("state", "reason", "status"),
    [
        (State.CONNECTING, None, mavlink.MAV_STATE_BOOT),
        (State.CHECKING, None, mavlink.MAV_STATE_CALIBRATING),
        (State.STANDBY, None, mavlink.MAV_STATE_STANDBY),
        (State.ENGAGED, None, mavlink.MAV_STATE_ACTIVE),
        (State.RELEASED, Reason.MISSION_COMPLETE, mavlink.MAV_STATE_POWEROFF),
        (State.RELEASED, Reason.MODE_CHANGED, mavlink.MAV_STATE_POWEROFF),
        (State.RELEASED, Reason.POSE_STALE, mavlink.MAV_STATE_CRITICAL),
        (State.RELEASED, Reason.INTERNAL_ERROR, mavlink.MAV_STATE_CRITICAL),
    ],
)
def test_the_heartbeat_s_status_is_the_truth(state: State, reason: Reason | None, status: int) -> None:
    assert system_status(state, reason) == status


def test_every_state_has_a_status() -> None:
    assert len({system_status(state, Reason.POSE_STALE) for state in State}) == len(State)
