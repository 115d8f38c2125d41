"""`companion check`, and `companion run` refusing what no certificate covers: one line each."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from harness.command import companion

from companion.certify.certificate import assemble, prove
from companion.certify.closed_loop import axis_vertices
from companion.certify.from_config import problem
from companion.config.load import load_config

ROOT = Path(__file__).resolve().parents[2]
RIG, QUADROTOR = ROOT / "config" / "antx_rig.yaml", ROOT / "config" / "paper_quadrotor.yaml"
PX4 = ROOT / "config" / "px4_quadrotor.yaml"
PX4_1_18 = ROOT / "config" / "px4_quadrotor_1_18.yaml"
NOBODY = ("--link", "udpout://127.0.0.1:9", "--set", "link.connect_timeout_s=0.3")


def refused(*arguments: object, cwd: Path = ROOT) -> str:
    """The one line of a command that ends with exit code 2."""
    ended = companion(*arguments, cwd=cwd)
    assert ended.returncode == 2, ended.stderr + ended.stdout
    assert len(ended.stderr.splitlines()) == 1, ended.stderr
    assert "Traceback" not in ended.stderr
    return ended.stderr


@pytest.mark.parametrize("config", [RIG, QUADROTOR, PX4, PX4_1_18])
def test_shipped_certificates_are_those_of_the_shipped_configs(config: Path) -> None:
    ended = companion("check", config, "--verify", config.with_name(f"{config.stem}.certificate.json"))
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("verified exactly: x by ")


@pytest.mark.slow
def test_check_prints_the_columns_of_the_rig_and_writes_its_certificate(tmp_path: Path) -> None:
    out = tmp_path / "certificate.json"
    ended = companion("check", RIG, "--all-degrees", "--degree", "6", "--json", "--out", out)
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)
    assert (report["certified"], report["degree"]) == (True, 2)
    x = report["axes"]["x"]
    assert x["tuned_bandwidth_rad_s"] == 3.0
    assert {d: v for d, v in x["minimum_bandwidth_rad_s"].items() if v} == {
        "2": pytest.approx(2.904, rel=0.01), "4": pytest.approx(2.743, rel=0.01), "6": pytest.approx(2.667, rel=0.01),
        "quadratic": pytest.approx(2.904, rel=0.001), "sectors_8": pytest.approx(2.60, rel=0.01),
        "sectors_16": pytest.approx(2.563, rel=0.005), "sectors_32": pytest.approx(2.545, rel=0.002),
    }  # fmt: skip
    assert x["unstable_below_rad_s"] == pytest.approx(2.525, rel=0.01)
    assert 0.029 <= x["maximum_delay_s"] < 0.03
    assert 2.6 < x["fastest_natural_frequency_rad_s"] < 2.75
    assert report["proof"]["delay"] is None
    assert report["delay_interval_s"] == {"x": [0.0, 0.0]}
    assert report["adaptation_rate_limit"] > 100
    assert companion("check", RIG, "--verify", out).returncode == 0


@pytest.mark.slow
def test_a_second_opinion_stands_beside_ours() -> None:
    ended = companion("check", RIG, "--second-opinion", "--json")
    assert ended.returncode == 0, ended.stderr
    told = json.loads(ended.stdout)["second_opinion"]["x"]
    assert told["ours_rad_s"] == pytest.approx(2.904, rel=1e-3)
    assert told["theirs_rad_s"] == pytest.approx(2.904, rel=1e-3)
    assert (told["solver"], told["delay_left_out"]) == ("SCS", False)
    assert "quadratic without delay, ours / SCS" in ended.stderr
    both = companion("check", RIG, "--quick", "--second-opinion")
    assert (both.returncode, "not allowed with" in both.stderr) == (2, True)


def test_not_certified_is_exit_code_1_and_leaves_no_stale_certificate(tmp_path: Path) -> None:
    stale = tmp_path / "certificate.json"
    stale.write_text("{}")
    slow = ("--set", "attitude.x.bandwidth_rad_s=2.4", "--degree", "2")
    ended = companion("check", RIG, *slow, "--out", stale)
    assert ended.returncode == 1, ended.stderr
    assert "Not certified, and it cannot be" in " ".join(ended.stdout.split())
    assert not stale.exists()


def test_an_adaptation_rate_above_the_limit_of_sampling_is_not_certified() -> None:
    ended = companion("check", RIG, "--quick", "--set", "controller.axes.x.adaptation_rate.hedged=1000")
    assert ended.returncode == 1, ended.stderr
    assert "adaptation rate 1000 is not below" in " ".join(ended.stdout.split())


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        ("controller.axes.x.position_weight_bound=0.5", "do not contain the nominal position weight"),
        ("controller.axes.x.velocity_weight_bound=[-0.35, 0.3]", "do not contain the nominal velocity weight"),
        ("attitude.x.bandwidth_rad_s=0", "greater than 0"),
        ("attitude.x.bandwidth_rad_s=-3", "greater than 0"),
        ("attitude.x.bandwidth_rad_s=[3.2, 2.8]", "upside down"),
        ("attitude.x.delay_s=3", "not below the reference period"),
        ("attitude.x={numerator: [4], denominator: [1, -1, 4]}", "unstable"),
        ("attitude.x={numerator: [3], denominator: [1, 2, 4]}", "dc gain"),
        ("attitude.x={numerator: [4]}", "give bandwidth_rad_s, or"),
        ("attitude.yaw_free=true", "give both"),
    ],
)
def test_degenerate_input_is_one_line(override: str, reason: str) -> None:
    assert reason in refused("check", RIG, "--set", override)


def test_bad_arguments_are_one_line(tmp_path: Path) -> None:
    assert "must be even" in refused("check", RIG, "--degree", "3")
    assert "cannot read certificate" in refused("check", RIG, "--verify", tmp_path / "none.json")
    assert "leave out --out and --plot" in refused("check", RIG, "--verify", "a", "--out", "b", "--plot", "c.png")
    assert "leave out --all-degrees" in refused("check", RIG, "--quick", "--all-degrees")
    assert "call it FILE.png, FILE.svg" in refused("check", RIG, "--plot", tmp_path / "plot.foo")
    assert "no such folder" in refused("check", RIG, "--plot", tmp_path / "none" / "plot.png")
    other = companion("check", RIG, "--verify", QUADROTOR.with_name("paper_quadrotor.certificate.json"))
    assert other.returncode == 1
    assert other.stderr == "certificate is of another config\n"


def test_run_refuses_what_no_certificate_covers(tmp_path: Path) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text(RIG.read_text())
    own = tmp_path / "mine.certificate.json"
    shipped = json.loads(RIG.with_name("antx_rig.certificate.json").read_text())
    assert "cannot read certificate" in refused("run", config, *NOBODY, cwd=tmp_path)

    own.write_text(QUADROTOR.with_name("paper_quadrotor.certificate.json").read_text())
    assert "of another config" in refused("run", config, *NOBODY, cwd=tmp_path)

    entry = shipped["proofs"]["x"]["lyapunov"][0]
    own.write_text(json.dumps(shipped).replace(f'"{entry}"', '"1/3"', 1))
    assert "was changed" in refused("run", config, *NOBODY, cwd=tmp_path)

    own.write_text("not a certificate")
    assert "is not JSON" in refused("run", config, *NOBODY, cwd=tmp_path)

    own.write_text(json.dumps(shipped))
    changed = ("--set", "controller.axes.x.damping_ratio=0.71")
    assert "of another config" in refused("run", config, *NOBODY, *changed, cwd=tmp_path)
    assert "this flight is not hedged" in refused("run", config, *NOBODY, "--no-hedging", cwd=tmp_path)
    assert "no heartbeat of vehicle" in refused("run", config, *NOBODY, cwd=tmp_path)  # covered: it got as far as that


def test_a_certificate_written_in_haste_covers_no_link(tmp_path: Path) -> None:
    config, own = tmp_path / "mine.yaml", tmp_path / "mine.certificate.json"
    config.write_text(RIG.read_text())
    ended = companion("check", config, "--quick", "--out", own)
    assert "`companion run` wants the certificate written without --quick" in " ".join(ended.stdout.split())
    assert "it covers no delay, and every link has one: run `companion check" in refused("run", config, *NOBODY)
    ended = companion("check", config, "--sectors", "8", "--out", own)
    assert "It covers every constant delay of the link up to 2" in " ".join(ended.stdout.split())
    assert "no heartbeat of vehicle" in refused("run", config, *NOBODY, cwd=tmp_path)


def test_run_imports_no_solver(tmp_path: Path) -> None:
    code = (
        "import sys; from companion.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'cvxpy', 'clarabel', 'scipy', 'numpy', 'matplotlib'}))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, "run", str(RIG), *NOBODY, "--out", str(tmp_path)],
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert ended.stdout.splitlines()[-1] == "[]", ended.stdout + ended.stderr


HELD = {
    "controller.axes.x.natural_frequency_rad_s": 4,
    "controller.axes.x.position_weight_bound": "[1.6, 1.8]",
    "controller.axes.x.velocity_weight_bound": "[0.55, 0.65]",
    "controller.axes.x.adaptation_rate.hedged": 1,
    "controller.anchor": "setpoint",
    "controller.initial_weights": "nominal",
    "attitude.x.bandwidth_rad_s": 5.5,
    "tick.rate_hz": 50,
    "tick.floor_hz": 6,
}
DELAYED = {
    "controller.axes.x.position_weight_bound": "[0.53, 0.55]",
    "controller.axes.x.velocity_weight_bound": "[0.32, 0.336]",
    "controller.axes.x.adaptation_rate.hedged": 1,
    "attitude.x.bandwidth_rad_s": 60,
    "attitude.x.delay_s": 0.32,
}


def as_once_certified(config: Path, overrides: tuple[str, ...]) -> dict[str, object]:
    """A certificate by degree 2 that takes a delay as the approximant of the config, as earlier versions wrote it."""
    stated = problem(load_config(config, overrides))
    proof = prove(axis_vertices(stated.axes["x"]), 2)
    assert proof is not None
    return dict(assemble(stated, {"x": proof}))


@pytest.mark.parametrize(
    ("changes", "why", "reason"),
    [
        (HELD, "grows when its command is held", "grows when it is held"),
        (DELAYED, "Not certified", "grows when it is held"),
    ],
)
def test_what_was_falsely_certified_is_refused_everywhere(
    changes: dict[str, object], why: str, reason: str, tmp_path: Path
) -> None:
    overrides = tuple(f"{key}={value}" for key, value in changes.items())
    options = [option for override in overrides for option in ("--set", override)]
    ended = companion("check", RIG, "--quick", *options)
    assert ended.returncode == 1, ended.stderr
    assert why in " ".join(ended.stdout.split())

    config, certificate = tmp_path / "mine.yaml", tmp_path / "mine.certificate.json"
    config.write_text(RIG.read_text())
    certificate.write_text(json.dumps(as_once_certified(config, overrides)))
    ended = companion("check", config, "--verify", certificate, *options)
    assert ended.returncode == 1, ended.stdout
    assert reason in ended.stderr
    assert reason in refused("run", config, *NOBODY, *options, cwd=tmp_path)


def test_a_trajectory_has_a_tube_that_says_what_is_not_proven() -> None:
    config = RIG.with_name("trajectories.yaml")
    grows = [  # with its weights in a corner: nothing is to be proven, and quickly so
        part
        for override in (
            "controller.axes.x.lyapunov_q=[1, 0.03]", "controller.axes.y.lyapunov_q=[1, 0.03]",
            "controller.bias.adaptation_rate.hedged=14",
        )
        for part in ("--set", override)
    ]  # fmt: skip
    ended = companion("check", config, "--quick", "--trajectory", "lemniscate", "--speed", "2", "--json", *grows)
    assert ended.returncode == 0, ended.stderr
    told = json.loads(ended.stdout)
    for axis in ("x", "y"):
        of_axis = told["tube"][axis]
        whole = of_axis["disturbance_m_s2"] + of_axis["feed_forward_m_s2"]
        assert told["tube_m"][axis] == pytest.approx(of_axis["m_per_m_s2"] * whole)
        assert of_axis["proof"]["weights"].startswith("not proven: with weights that stand in a corner")
    assert "within" in ended.stderr
    assert "name one" in refused("check", config, "--disturbance", "1")
    assert "not below zero" in refused("check", config, "--quick", "--trajectory", "circle", "--disturbance", "-1")
    assert "none of hold" in refused("check", config, "--trajectory", "spiral")
