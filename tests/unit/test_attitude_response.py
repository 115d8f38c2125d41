"""Every kind of attitude response: realisation, step and lag are one response, and the config knows its keys."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from scipy import signal

from companion.attitude_response.discrete import at_rest, step
from companion.attitude_response.exact import interval
from companion.attitude_response.kind import Kind, LinearResponse, ParametricKind
from companion.attitude_response.kinds import KINDS, MODELS
from companion.attitude_response.simulation import respond
from companion.config.attitude import ResponseSection
from companion.config.vehicles import Angle

PARAMETRIC = [kind for kind in KINDS if issubclass(kind, ParametricKind)]
of_each_kind = pytest.mark.parametrize("kind", PARAMETRIC, ids=lambda kind: kind.name)


def values(kind: type[ParametricKind], damping: float = 0.7) -> tuple[float, ...]:
    """Frequencies apart from one another, and a damping."""
    frequencies = itertools.count(9.0, 13.0)
    return tuple(next(frequencies) if parameter.unit == "rad/s" else damping for parameter in kind.parameters)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_its_keys_are_in_the_config_and_make_it(kind: type[Kind]) -> None:
    given = {
        key: ((1.0, 30.0, 200.0) if "den" in key else (200.0,)) if kind.of_lists else 0.7 for key in kind.key_names()
    }
    section = ResponseSection(**given)
    assert section.kind is kind
    assert section.values == tuple(given.values())
    with pytest.raises(ValueError, match="give bandwidth_rad_s, or"):
        ResponseSection(**given | {"bandwidth_rad_s": 3.0, "numerator": (1.0,)})
    if kind in PARAMETRIC:
        assert kind.key_names() == tuple(parameter.key for parameter in kind.parameters)
        assert Angle(**given).response == LinearResponse(kind, section.values)
    else:
        assert not set(given) & set(Angle.model_fields)


def test_kinds_and_fitted_models_have_names_of_their_own() -> None:
    for rows in (KINDS, MODELS):
        assert len({row.name for row in rows}) == len(rows)
    for model in MODELS:
        assert len(model.parameters) == len(model.start) == len(model.lower) == len(model.upper)
        assert all(low < at < high for low, at, high in zip(model.lower, model.start, model.upper, strict=True))


@of_each_kind
@pytest.mark.parametrize("damping", [0.3, 0.7, 1.6])
@pytest.mark.parametrize("dt_s", [0.001, 0.02, 0.2])
def test_the_step_is_that_of_the_realisation(kind: type[ParametricKind], damping: float, dt_s: float) -> None:
    given = values(kind, damping)
    a, b, c, d = kind.realise(*map(Fraction, given))
    matrices = [np.array(m, dtype=float) for m in (a, np.array(b)[:, None], np.array(c)[None], [[d]])]
    wanted = np.random.default_rng(3).normal(0.0, 0.2, 60)
    phi, gamma, c_d, *_ = signal.cont2discrete(matrices, dt_s)
    x, expected = np.zeros(len(b)), []
    for u in wanted:
        x = phi @ x + gamma[:, 0] * u
        expected.append(float((c_d @ x)[0]))
    move, state, stepped = step(LinearResponse(kind, given), dt_s), at_rest(LinearResponse(kind, given), 0.0), []
    for u in wanted:
        state = move(state, float(u))
        stepped.append(state[0])
    assert len(state) == 2 + kind.further
    assert stepped == pytest.approx(expected, abs=1e-12)


@of_each_kind
def test_its_second_state_is_the_rate(kind: type[ParametricKind]) -> None:
    """At the end of the step. That of the first order jumps with the set-point."""
    response, dt_s = LinearResponse(kind, values(kind)), 1e-6
    state = at_rest(response, 0.0)
    for _ in range(20):
        state = step(response, 0.005)(state, 0.3)
    after = step(response, dt_s)(state, 0.3)
    assert after[1] == pytest.approx((after[0] - state[0]) / dt_s, rel=1e-3)
    later = step(response, dt_s)(step(response, 0.1)(state, 0.0), 0.0)
    before = step(response, 0.1)(state, 0.0)
    assert before[1] == pytest.approx((later[0] - before[0]) / dt_s, rel=1e-3), "a long step's rate is that at its end"


@of_each_kind
def test_at_rest_it_stays_at_its_set_point(kind: type[ParametricKind]) -> None:
    response = LinearResponse(kind, values(kind))
    assert step(response, 0.02)(at_rest(response, 0.3), 0.3) == pytest.approx(at_rest(response, 0.3), abs=1e-15)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("damping", [0.3, 1.6])
def test_the_simulation_of_a_log_is_the_step(model, damping: float) -> None:  # type: ignore[no-untyped-def]
    response = LinearResponse(model.kind, values(model.kind, damping))
    wanted = np.random.default_rng(5).normal(0.0, 0.2, 50)
    wanted[0] = 0.0
    state, stepped = at_rest(response, 0.0), []
    for u in wanted:
        state = step(response, 0.02)(state, float(u))
        stepped.append(state[0])
    delay = (0.0137,) if model.delayed else ()
    time_s = 0.02 * np.arange(50.0)
    simulated = respond(model, (*response.values, *delay), time_s, wanted, time_s + 0.02 + sum(delay) - 1e-12)
    assert simulated == pytest.approx(np.array(stepped), abs=1e-8)


@of_each_kind
def test_every_entry_of_the_realisation_is_affine_in_each_parameter(kind: type[ParametricKind]) -> None:
    middle = [Fraction(v) for v in values(kind)]
    for place, value in enumerate(middle):
        low, centre, high = (
            kind.realise(*middle[:place], value * factor, *middle[place + 1 :])
            for factor in (Fraction(1, 2), Fraction(1), Fraction(3, 2))
        )
        for part in ("a", "b", "c"):
            ends = (np.array(getattr(low, part)) + np.array(getattr(high, part))) / 2
            assert (ends == np.array(getattr(centre, part))).all()


@of_each_kind
def test_another_bandwidth_is_the_same_response_in_another_time(kind: type[ParametricKind]) -> None:
    slow = kind.of(interval(v, 1.1 * v) for v in values(kind))
    fast = slow.with_bandwidth(2 * slow.bandwidth())
    fast.check()
    assert fast.bandwidth() == 2 * slow.bandwidth()
    for parameter, before, after in zip(kind.parameters, slow.intervals(), fast.intervals(), strict=True):
        factor = 2.0 if parameter.unit == "rad/s" else 1.0
        assert [float(end) for end in after] == pytest.approx([factor * float(end) for end in before], rel=1e-4)


@of_each_kind
def test_corners_are_the_ends_of_the_intervals(kind: type[ParametricKind]) -> None:
    response = kind.of(interval(v, 1.1 * v) for v in values(kind))
    assert len(response.corners()) == 2 ** len(kind.parameters)
    for corner in response.corners():
        gain = -np.array(corner.c, dtype=float) @ np.linalg.solve(
            np.array(corner.a, dtype=float), np.array(corner.b, dtype=float)
        )
        assert math.isclose(gain, 1.0, abs_tol=1e-12)
