"""Our own flight folders: their traffic, or the flight record where that is all there is."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
from harness.identify_logs import Flown, Known, flown_tlog, fly

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import SecondOrder
from companion.cli import main
from companion.identify.identification import identify_log
from companion.record import schema
from companion.record.recorder import RECORD_HEADER, TICK
from companion.record.writer import write

ROOT = Path(__file__).resolve().parents[3]
KNOWN = Known(LinearResponse(SecondOrder, (9.0, 0.9)), up_s=0.02, down_s=0.0)


def flight_record(flown: Flown, latency_s: float) -> bytes:
    """The writer's input for a flight in which every attitude was answered by a set-point."""
    records = bytearray()
    at = np.searchsorted(flown.sent_s, flown.stamp_s + latency_s, side="right") - 1
    for i, stamp in enumerate(flown.stamp_s):
        pitch, wanted = flown.attitude_rad[i] / 2, flown.setpoint_rad[max(at[i], 0)] / 2
        known = {
            "time_s": [stamp],
            "attitude_q_wxyz": [math.cos(pitch), 0.0, math.sin(pitch), 0.0],
            "setpoint_q_wxyz": [math.cos(wanted), 0.0, math.sin(wanted), 0.0],
            "latency_s": [latency_s],
        }
        floats = [v for field in schema.FLOATS for v in known.get(field.name, [0.0] * field.size)]
        data = schema.pack_tick(schema.CDR_HEADER, *floats, *[0] * len(schema.FLAGS))
        records += RECORD_HEADER.pack(TICK, len(data), round(1e6 * stamp)) + data
    return bytes(records)


@pytest.fixture(scope="module")
def flown() -> Flown:
    return fly(KNOWN, 11, setpoint_rate_hz=250.0)


def test_a_folder_is_read_by_its_traffic_and_its_config_names_the_vehicle(
    flown: Flown, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "traffic.tlog").write_bytes(flown_tlog(flown))
    (tmp_path / "config.yaml").write_bytes((ROOT / "config" / "antx_rig.yaml").read_bytes())
    with pytest.raises(SystemExit) as ended:  # a rig: nothing is wanted of roll
        main(["identify", str(tmp_path)])
    out, err = capsys.readouterr()
    assert (ended.value.code, err) == (0, "")
    assert "pitch, 4 manoeuvres" in out
    found = identify_log([tmp_path])
    assert found.clock == "ours"
    assert found.axes["pitch"].chosen.values == pytest.approx((9.0, 0.9, 0.02), rel=0.1)


def test_without_traffic_the_flight_record_serves(flown: Flown, tmp_path: Path) -> None:
    assert write(tmp_path, io.BytesIO(b"")) is True  # an empty flight first: nothing in it
    (tmp_path / "traffic.tlog").unlink()
    with pytest.raises(Exception, match=r"flight\.mcap: empty: no tick was recorded"):
        identify_log([tmp_path])
    assert write(tmp_path, io.BytesIO(flight_record(flown, 0.001))) is True
    (tmp_path / "traffic.tlog").unlink()
    found = identify_log([tmp_path])
    assert found.clock == "vehicle"
    assert found.axes["pitch"].chosen.values[:2] == pytest.approx((9.0, 0.9), rel=0.1)
    # this flight's set-points fell between its ticks: the record has each half a tick, 5 ms, late
    assert found.axes["pitch"].chosen.values[2] == pytest.approx(0.015, abs=0.003)


def test_a_broken_flight_record(tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").write_bytes(b"no mcap at all")
    with pytest.raises(Exception, match="not a readable flight log"):
        identify_log([tmp_path])
