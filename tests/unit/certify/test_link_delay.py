"""A config without a delay is certified for a link that has one, and flight watches what that one may be."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.certify.certificate import certify, certify_for_a_link, without_delay
from companion.certify.from_config import problem
from companion.certify.proof import verify
from companion.certify.statement import covers, decimal_text, statement
from companion.config.load import load_config
from companion.flight.authority.states import Reason
from companion.flight.guards.table import limits
from companion.flight.readiness.certificate import cover, unwatched

CONFIGS = Path(__file__).resolve().parents[3] / "config"
RIG = CONFIGS / "antx_rig.yaml"
SHIPPED = CONFIGS / "antx_rig.certificate.json"


def stated(*overrides: str) -> dict:
    return json.loads(json.dumps(statement(problem(load_config(RIG, overrides)))))


@pytest.fixture(scope="module")
def write(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The certificate of the rig with these overrides, as written."""

    def written(*overrides: str) -> Path:
        path = tmp_path_factory.mktemp("certificate") / "certificate.json"
        path.write_text(json.dumps(certify(problem(load_config(RIG, overrides)))))
        return path

    return written


@pytest.mark.parametrize("name", ["antx_rig", "paper_quadrotor"])
def test_shipped_certificates_cover_a_link_and_its_delay_is_watched(name: str) -> None:
    path = CONFIGS / f"{name}.yaml"
    config = load_config(path)
    assert limits(config)[Reason.LINK_DELAY] == math.inf  # by the config alone
    flown, uncovered = cover(config, path.with_name(f"{name}.certificate.json"), hedging=True)
    assert uncovered is None
    assert 0.005 < limits(flown)[Reason.LINK_DELAY] < 0.06
    assert limits(flown)[Reason.LINK_JITTER] <= limits(flown)[Reason.LINK_DELAY]


def test_what_a_link_may_have_is_nearly_what_is_certified_at_most() -> None:
    rig = problem(load_config(RIG))
    axis = rig.axes["x"]
    found = certify_for_a_link(rig, {"x": type(axis.damping_ratio)("0.02968")}, 16)
    assert found is not None
    certificate, upper_s = found
    assert 0.028 <= float(upper_s) <= 0.02968
    assert verify(certificate, statement(rig)).ok
    assert certificate["problem"]["axes"]["x"]["response"]["delay_s"] == ["0.00001", decimal_text(upper_s)]


def test_there_is_none_where_no_delay_is_certified() -> None:
    rig = problem(load_config(RIG))
    assert certify_for_a_link(rig, {}, 16) is None
    assert certify_for_a_link(rig, {"x": type(rig.axes["x"].damping_ratio)("0.0001")}, 16) is None
    assert without_delay(problem(load_config(RIG, ("attitude.x.delay_s=0.01",)))) == []


def test_a_longer_delay_covers_none_and_nothing_else() -> None:
    proven = stated("attitude.x.delay_s=[0.00001, 0.02]")
    assert covers(proven, proven)
    assert covers(proven, stated())
    assert not covers(stated(), proven)
    assert not covers(stated("attitude.x.delay_s=[0.005, 0.02]"), stated())  # it says nothing of less than 5 ms
    assert not covers(stated("attitude.x.delay_s=0.02"), stated())
    assert not covers(proven, stated("attitude.x.delay_s=0.01"))  # a vehicle with a delay of its own
    assert not covers(proven, stated("attitude.x.bandwidth_rad_s=3.1"))
    assert not covers(proven, stated("tick.floor_hz=800"))


def test_a_certificate_of_no_delay_flies_no_link(write: Callable[..., Path]) -> None:
    config, uncovered = cover(load_config(RIG), write(), hedging=True)
    assert uncovered is not None
    assert uncovered.endswith("it covers no delay, and every link has one")
    assert config == load_config(RIG)


def test_the_limit_follows_from_the_certificate(write: Callable[..., Path]) -> None:
    certificate = write("attitude.x.delay_s=[0.00001, 0.02]")
    flown, uncovered = cover(load_config(RIG), certificate, hedging=True)
    assert uncovered is None
    assert limits(flown)[Reason.LINK_DELAY] == pytest.approx(0.02, abs=2e-5)
    less, _ = cover(load_config(RIG, ("guards.link_delay_s.limit=0.01",)), certificate, hedging=True)
    assert limits(less)[Reason.LINK_DELAY] == 0.01
    _, why = cover(load_config(RIG, ("guards.link_delay_s.limit=0.03",)), certificate, hedging=True)
    assert why is not None
    assert "guards.link_delay_s.limit (0.03) is above" in why


def test_guards_of_delay_and_jitter_that_are_off_are_told() -> None:
    off = ("guards.link_delay_s.enabled=false", "guards.link_jitter_s.enabled=false")
    assert unwatched(load_config(RIG)) == []
    assert unwatched(load_config(RIG, off)) == ["link_delay_s", "link_jitter_s"]
