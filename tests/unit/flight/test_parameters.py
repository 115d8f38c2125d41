"""Parameters asked for, collected and compared, without a link: the plant's store answers."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config
from companion.flight.readiness.parameters import Difference, ParameterReader, differences, stale
from companion.flight.vehicle_link.messages import Parameter, parameter
from companion.flight.vehicle_link.odometry import PoseSource
from companion.flight.vehicle_link.requests import encode
from companion.mavlink.codec import FrameParser

QUADROTOR = Path(__file__).resolve().parents[3] / "config" / "paper_quadrotor.yaml"
GAINS = {"MC_ROLL_P": 4.0, "MC_PITCH_P": 4.0, "COM_OBL_RC_ACT": 5.0}


def value(name: str, raw: bytes, kind: int) -> bytes:
    """Payload of a PARAM_VALUE with these four bytes in its value, where pymavlink would pack a float."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    packed = bytes(mavlink.MAVLink_param_value_message(name.encode(), 1.0, kind, 1, 0).pack(sender))
    (frame,) = FrameParser().feed(packed)
    return raw + frame.payload[4:]


def real(name: str, number: float) -> Parameter:
    told = parameter(value(name, struct.pack("<f", number), mavlink.MAV_PARAM_TYPE_REAL32))
    assert told is not None
    return told


def asked(reader: ParameterReader, now_s: float) -> list[str]:
    return [request.name for request in reader.requests(now_s)]


@given(st.integers(-(2**31), 2**31 - 1))
def test_an_int32_travels_bytewise_whatever_its_float_would_be(number: int) -> None:
    frame = value("COM_OBL_RC_ACT", struct.pack("<i", number), mavlink.MAV_PARAM_TYPE_INT32)
    assert parameter(frame) == ("COM_OBL_RC_ACT", number)


def test_a_float_is_a_float() -> None:
    assert real("MC_ROLL_P", 6.5) == ("MC_ROLL_P", 6.5)


def test_a_type_that_px4_does_not_have_is_not_guessed() -> None:
    assert parameter(value("X", b"\0\0\0\0", mavlink.MAV_PARAM_TYPE_REAL64)) is None


def test_what_is_lost_is_asked_for_again_a_few_at_a_time() -> None:
    names = [f"P{number}" for number in range(6)]
    reader = ParameterReader(names)
    assert asked(reader, 0.0) == names[:4], "a slow line takes no more at once"
    assert asked(reader, 0.1) == names[4:]
    for name in names[1:]:
        assert reader.on_parameter(real(name, 1.0))
    assert asked(reader, 0.4) == [], "its answer may be on the way"
    assert asked(reader, 0.6) == ["P0"]
    assert not reader.done
    reader.on_parameter(real("P0", 2.0))
    assert reader.done
    assert reader.over(0.6)
    assert asked(reader, 9.0) == []
    assert reader.values == {**dict.fromkeys(names, 1.0), "P0": 2.0}


def test_silence_comes_to_an_end() -> None:
    reader = ParameterReader(["NO_SUCH"])
    assert not reader.over(100.0), "patience begins with the first request"
    reader.requests(100.0)
    assert not reader.over(104.0)
    assert reader.over(106.0)
    assert not reader.done
    assert reader.missing == ["NO_SUCH"]


def test_answers_to_others_are_not_ours() -> None:
    reader = ParameterReader(["MC_ROLL_P"])
    assert not reader.on_parameter(real("MC_PITCH_P", 4.0))
    assert reader.values == {}


def test_nothing_to_read_is_done_at_once() -> None:
    reader = ParameterReader([])
    assert reader.over(0.0)
    assert reader.requests(0.0) == []


def test_equal_as_the_vehicle_stores_it() -> None:
    told = {"MC_ROLL_P": 4, "A": struct.unpack("<f", struct.pack("<f", 0.15))[0]}
    assert differences({"MC_ROLL_P": 4.0, "A": 0.15}, told) == []
    assert differences({"MC_ROLL_P": 4.0}, {"MC_ROLL_P": 4.0001}) == [Difference("MC_ROLL_P", 4.0, 4.0001)]


def test_stale_names_each_change() -> None:
    assert stale(GAINS, GAINS) is None
    line = stale(GAINS, {"MC_ROLL_P": 3.0, "COM_OBL_RC_ACT": 5})
    assert line is not None
    assert "MC_ROLL_P is 3, was 4" in line
    assert "does not tell MC_PITCH_P" in line
    assert "COM_OBL" not in line
    assert len(line.splitlines()) == 1


def test_the_config_states_them() -> None:
    config = load_config(QUADROTOR, ("vehicle.parameters={MC_ROLL_P: 4.0, COM_OBL_RC_ACT: 5}",))
    assert config.vehicle.parameters == {"MC_ROLL_P": 4.0, "COM_OBL_RC_ACT": 5.0}
    assert load_config(QUADROTOR).vehicle.parameters == {}


@pytest.mark.parametrize(
    "text", ["{mc_roll_p: 4}", "{MC_ROLL_P_LONG_NAME: 4}", "{MC_ROLL_P: true}", "{MC_ROLL_P: .inf}"]
)
def test_a_name_or_value_that_is_none_is_one_line(text: str) -> None:
    with pytest.raises(ConfigError, match=r"vehicle\.parameters"):
        load_config(QUADROTOR, (f"vehicle.parameters={text}",))


def test_a_request_is_what_px4_reads() -> None:
    (request,) = ParameterReader(["MC_ROLL_P"]).requests(0.0)
    (message,) = encode(request, (1, 1), PoseSource())
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    (frame,) = FrameParser().feed(bytes(message.pack(sender)))
    assert frame.message_id == mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ
    assert frame.payload.startswith(b"\xff\xff\x01\x01MC_ROLL_P")
