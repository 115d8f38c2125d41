"""The exact check accepts what holds and refuses everything else."""

import copy
import json
import os
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import cvxpy as cp
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import companion.certify
from companion.certify.certificate import Scaling, assemble, certify, prove, rounded
from companion.certify.closed_loop import axis_vertices
from companion.certify.exact.elimination import positive_definite
from companion.certify.polynomial.lyapunov import Candidate, solve
from companion.certify.polynomial.polynomial_proof import check
from companion.certify.problem import Problem
from companion.certify.proof import load, verify
from companion.certify.statement import digest, problem_of, statement

PROPERTY = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


def places(content, path=()):
    """Paths of every number in a JSON object: digits in text count."""
    if isinstance(content, dict):
        return [place for key, item in content.items() for place in places(item, (*path, key))]
    if isinstance(content, list):
        return [place for index, item in enumerate(content) for place in places(item, (*path, index))]
    number = isinstance(content, int) or (isinstance(content, str) and any(c.isdigit() for c in content))
    return [path] if number and not isinstance(content, bool) else []


def mutated(content, path, draw):
    changed = copy.deepcopy(content)
    holder = changed
    for key in path[:-1]:
        holder = holder[key]
    old = holder[path[-1]]
    if isinstance(old, int):
        holder[path[-1]] = old + draw(st.sampled_from([-2, -1, 1, 2]))
        return changed
    digits = [index for index, c in enumerate(old) if c.isdigit()]
    index = draw(st.sampled_from(digits))
    digit = draw(st.sampled_from([d for d in "0123456789" if d != old[index]]))
    holder[path[-1]] = old[:index] + digit + old[index + 1 :]
    return changed


def resealed(certificate):
    """The certificate with all digests made good again, as a forger would."""
    changed = {key: value for key, value in certificate.items() if key != "sha256"}
    changed["problem_sha256"] = digest(changed["problem"])
    return changed | {"sha256": digest(changed)}


def test_certificate_of_the_paper_quadrotor(certificate, quadrotor):
    assert len(certificate["proofs"]["x"]["rays"]) == 8  # 5.5 rad/s is not certified by the inequality of the paper
    assert certificate["proofs"]["y"]["rays"] == []
    ticks = "for ticks of at most 1 ms"
    told = f"verified exactly: x by 8 sectors, {ticks}, y by a quadratic function, {ticks}"
    assert verify(certificate, statement(quadrotor)) == (True, told)


def test_a_proof_about_an_approximant_of_the_delay_is_refused(rig):
    """As certificates had it before: the polynomial is right, and the true loop may still grow."""
    axis = rig("3.4", "0.02")
    proof = prove(axis_vertices(axis), 2)
    assert proof is not None
    verdict = verify(assemble(Problem({"x": axis}), {"x": proof}))
    assert not verdict.ok
    assert "approximant" in verdict.reason
    honest = certify(Problem({"x": axis}))
    assert verify(honest) == (True, "verified exactly: x by a quadratic function for every constant delay of 20 ms")


@pytest.fixture(scope="module")
def by_sectors(rig):
    found = certify(Problem({"x": rig("2.9", "0.02")}))
    assert found is not None
    assert len(found["proofs"]["x"]["rays"]) == 8
    return found


@PROPERTY
@given(st.data())
def test_any_changed_number_of_a_proof_by_sectors_is_refused(by_sectors, data):
    path = data.draw(st.sampled_from(places(by_sectors)))
    assert not verify(mutated(by_sectors, path, data.draw)).ok


@PROPERTY
@given(st.data())
def test_malformed_parts_of_a_proof_by_sectors_are_refused_in_one_line(by_sectors, data):
    path = data.draw(st.sampled_from([p for p in places(by_sectors) if p[0] == "proofs"]))
    changed = copy.deepcopy(by_sectors)
    holder = changed
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = data.draw(st.sampled_from([None, -1, 1.5, "1/0", "nan", "", [], {}, [["1"]], "9" * 5000, True]))
    verdict = verify(resealed(changed))
    assert not verdict.ok
    assert "\n" not in verdict.reason


def test_a_resealed_proof_by_sectors_of_more_delay_is_refused(by_sectors):
    forged = copy.deepcopy(by_sectors)
    forged["problem"]["axes"]["x"]["response"]["delay_s"] = "0.06"
    for item in forged["assumptions"]:
        if item["quantity"] == "delay":
            item["minimum"] = item["maximum"] = "0.06"
    verdict = verify(resealed(forged))
    assert not verdict.ok
    assert "does not fall" in verdict.reason


def test_certificate_survives_the_file(certificate, quadrotor, tmp_path):
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps(certificate))
    content, reason = load(path)
    assert reason == ""
    assert verify(content, statement(quadrotor)).ok
    assert problem_of(content["problem"]) == quadrotor


def test_another_config_is_refused(certificate, quadrotor, rig):
    assert verify(certificate, statement(Problem({"x": rig()}))) == (False, "certificate is of another config")


@PROPERTY
@given(st.data())
def test_any_changed_number_is_refused(certificate, data):
    path = data.draw(st.sampled_from(places(certificate)))
    verdict = verify(mutated(certificate, path, data.draw))
    assert not verdict.ok
    assert "\n" not in verdict.reason


@PROPERTY
@given(st.data())
def test_any_changed_number_in_the_config_is_refused(certificate, quadrotor, data):
    stated = statement(quadrotor)
    path = data.draw(st.sampled_from(places(stated)))
    assert not verify(certificate, mutated(stated, path, data.draw)).ok


@PROPERTY
@given(st.data())
def test_a_resealed_change_of_the_problem_is_never_taken_for_the_config(certificate, quadrotor, data):
    path = data.draw(st.sampled_from([p for p in places(certificate) if p[0] == "problem"]))
    forged = resealed(mutated(certificate, path, data.draw))
    assert not verify(forged, statement(quadrotor)).ok


def test_a_resealed_proof_of_too_slow_an_attitude_is_refused(certificate):
    forged = copy.deepcopy(certificate)
    forged["problem"]["axes"]["x"]["response"]["bandwidth_rad_s"] = "5"
    for item in forged["assumptions"]:
        if item["quantity"] == "attitude_bandwidth" and item["axis"] == "x":
            item["minimum"] = item["maximum"] = "5"
    verdict = verify(resealed(forged))
    assert not verdict.ok
    assert "does not fall in sector" in verdict.reason


@pytest.mark.parametrize("wrong", [None, 3, [], {}, "x", {"schema": 1}])
def test_malformed_input_is_refused_in_one_line(wrong):
    verdict = verify(wrong)
    assert not verdict.ok
    assert "\n" not in verdict.reason


@PROPERTY
@given(st.data())
def test_malformed_parts_are_refused_in_one_line(certificate, data):
    path = data.draw(st.sampled_from(places(certificate)))
    changed = copy.deepcopy(certificate)
    holder = changed
    for key in path[:-1]:
        holder = holder[key]
    junk = [None, -1, 1.5, "1/0", "1e999999", "nan", "", [], {}, [["1"]], "9" * 5000, True]
    holder[path[-1]] = data.draw(st.sampled_from(junk))
    verdict = verify(resealed(changed)) if path[0] not in ("sha256", "problem_sha256") else verify(changed)
    assert "\n" not in verdict.reason
    assert not verdict.ok or path[0] == "tools"


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"a": 1, "a": 2}', "[" * 100000])
def test_unreadable_files_are_refused_in_one_line(text, tmp_path):
    path = tmp_path / "certificate.json"
    path.write_text(text)
    content, reason = load(path)
    assert content == {}
    assert reason
    assert "\n" not in reason
    assert load(tmp_path / "missing.json")[1].startswith("cannot read certificate")


def test_what_is_no_regular_file_or_has_no_end_is_refused_at_once(tmp_path):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        content, reason = load(path)
        assert content == {}
        assert "is not a regular file" in reason
    assert "cannot read" in load(tmp_path)[1]
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate(10**10)
    assert "larger than" in load(large)[1]


def test_the_solver_says_optimal_and_the_exact_check_refuses(rig):
    """The inequality of the paper as one would type it, for an attitude loop that a counterexample proves unstable."""
    vertices = axis_vertices(rig("2.5"))
    scaling = Scaling(vertices)
    p = cp.Variable((3, 3), symmetric=True)
    falls = [a.T @ p + p @ a << 0 for a in scaling.apply(vertices)]
    problem = cp.Problem(cp.Minimize(0), [p >> 0, *falls])
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == cp.OPTIMAL
    for size in (1.0, np.trace(p.value) / 3):
        candidate = Candidate(p.value / size, np.zeros((4, 0)), margin=1.0)
        assert check(rounded(candidate, 2, scaling, 50), vertices) != ""
    assert prove(vertices, 2) is None


@pytest.mark.parametrize("degree", [2, 4, 6, 8])
def test_no_degree_proves_what_a_counterexample_refutes(rig, degree):
    vertices = axis_vertices(rig("2.5"))
    scaling = Scaling(vertices)
    candidate = solve(scaling.apply(vertices), degree)
    assert candidate is not None  # the solver has an answer, whatever it is worth
    for bits in (16, 34, 50):
        assert check(rounded(candidate, degree, scaling, bits), vertices) != ""
    assert prove(vertices, degree) is None


def test_a_believed_margin_counts_for_nothing(rig):
    vertices = axis_vertices(rig("2.5"))
    scaling = Scaling(vertices)
    believed = Candidate(np.eye(3), np.zeros((4, 0)), margin=1.0)
    assert check(rounded(believed, 2, scaling, 10), vertices).startswith("the polynomial does not fall")
    believed = Candidate(np.diag([1.0, 1.0, 0.0]), np.zeros((4, 0)), margin=1.0)
    assert check(rounded(believed, 2, scaling, 10), vertices) == "Lyapunov matrix is not positive definite"


def test_infeasible_problems_get_no_certificate(rig):
    assert certify(Problem({"x": rig("2.4")}), 4) is None
    assert certify(Problem({"x": rig("60", "0.32")})) is None


@given(st.lists(st.lists(st.integers(-9, 9), min_size=4, max_size=4), min_size=4, max_size=4), st.integers(0, 60))
@settings(max_examples=200)
def test_positive_definite_agrees_with_eigenvalues(rows, shift):
    matrix = np.array(rows) + np.array(rows).T + shift * np.eye(4, dtype=int)
    smallest = np.linalg.eigvalsh(matrix)[0]
    if abs(smallest) > 1e-9:
        assert positive_definite(matrix.astype(int).tolist()) == (smallest > 0)


def test_a_semidefinite_matrix_is_not_positive_definite():
    assert not positive_definite([[1], [1, 1]])
    assert positive_definite([[1], [1, 2]])


def test_joint_proof_with_the_yaw_free(rig):
    problem = Problem({"x": rig("3"), "y": rig("3.3")}, yaw_free=True)
    certificate = certify(problem, 2)
    assert certificate is not None
    assert verify(certificate, statement(problem)).ok
    separate = certify(Problem(problem.axes), 2, 0)
    assert not verify(assemble(problem, {"x": prove(axis_vertices(rig("3")), 2)})).ok
    assert not verify(resealed(separate | {"problem": statement(problem)})).ok


def test_verification_needs_the_standard_library_alone_and_is_fast(certificate, quadrotor, tmp_path):
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps({"certificate": certificate, "problem": statement(quadrotor)}))
    program = f"""
import json, sys, time
from companion.certify.proof import verify
content = json.load(open({str(path)!r}))
start = time.process_time()
verdict = verify(content["certificate"], content["problem"])
print(json.dumps([verdict.ok, time.process_time() - start, sorted({{m.split(".")[0] for m in sys.modules}})]))
"""
    root = Path(companion.certify.__file__).parents[2]
    ran = subprocess.run(
        [sys.executable, "-I", "-S", "-c", f"import sys; sys.path.insert(0, {str(root)!r})\n{program}"],
        capture_output=True,
        text=True,
        check=True,
    )
    ok, seconds, modules = json.loads(ran.stdout)
    assert ok
    assert seconds < 1.0
    assert set(modules) <= set(sys.stdlib_module_names) | {"companion", "__main__"}


def test_verification_of_degree_eight_is_fast_too(simulation):
    proof = prove(axis_vertices(simulation("5.3")), 8)
    assert proof is not None
    start = time.process_time()
    assert check(proof, axis_vertices(simulation("5.3"))) == ""
    assert time.process_time() - start < 0.1
    assert all(v.denominator & (v.denominator - 1) == 0 for v in proof.lyapunov)
    assert isinstance(proof.time_scale, Fraction)


def test_a_resealed_adaptation_rate_above_the_sampling_limit_is_refused(certificate):
    forged = copy.deepcopy(certificate)
    forged["problem"]["sampling"]["x"]["adaptation_rate"] = "100000"
    verdict = verify(resealed(forged))
    assert not verdict.ok
    assert "adaptation rate 100000 of axis x is not below" in verdict.reason


def test_long_denominators_are_refused_before_they_cost_time(certificate):
    """Distinct odd denominators would make their common one explode."""
    forged = copy.deepcopy(certificate)
    entries = forged["proofs"]["x"]["lyapunov"]
    forged["proofs"]["x"]["lyapunov"] = [f"1/{10**90 + 2 * k + 1}" for k in range(len(entries))]
    begun = time.process_time()
    verdict = verify(resealed(forged))
    assert not verdict.ok
    assert "power of two" in verdict.reason
    assert time.process_time() - begun < 1.0
