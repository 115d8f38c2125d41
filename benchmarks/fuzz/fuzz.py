"""Coverage-guided fuzzing of what reads bytes of others. Not in CI: an hour in all.

    pip install -e '.[fuzz]'
    python benchmarks/fuzz/fuzz.py codec link config --seconds 300 [--corpus FOLDER]

Each target runs in a process of its own for so long, from the seeds and what FOLDER/TARGET holds, and adds to it. A
finding ends it with code 1 and the input's path; an input that takes more than ten seconds is one too. `--minimise`
runs nothing: it writes what reaches the same lines, and what once broke them, to `tests/data/fuzz/TARGET.json`.
"""

from __future__ import annotations

import argparse
import base64
import json
import lzma
import subprocess
import sys
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_SEED_BYTES = 4096  # of a recording
_PACKED_BYTES = 12_000
_OURS = str(ROOT / "companion")
_LIMITS = ("-timeout=10", "-rss_limit_mb=2048", "-max_len=8192", "-print_final_stats=1")


def seeds(target: str, folder: Path) -> None:
    """Files to begin with."""
    folder.mkdir(parents=True, exist_ok=True)
    data, found = ROOT / "tests" / "data", []
    if target in ("codec", "link", "tlog", "traffic", "door"):
        found = [path.read_bytes()[:_SEED_BYTES] for path in sorted(data.glob("*.tlog"))]
        found += [blob[8:40] for blob in found]
    elif target == "config":
        found = [path.read_bytes() for path in sorted((ROOT / "config").glob("*.yaml"))]
    elif target == "certificate":
        whole = [json.loads(path.read_text()) for path in sorted((ROOT / "config").glob("*.json"))]
        found = [json.dumps(shortened(one, length)).encode() for one in whole for length in (1, 3)]
    elif target == "ulog":
        found = [lzma.decompress(path.read_bytes())[:_SEED_BYTES] for path in sorted(data.glob("*.ulg.xz"))]
    elif target == "stamps":
        found = [b'{"1/1/1": 37579236086277, "1/191/0": 37579236086277}', b"{}"]
    elif target == "mcap":
        from companion.record.recorder import EVENT, TICK  # noqa: PLC0415
        from companion.record.schema import PACKER, pack_event  # noqa: PLC0415
        from companion.record.writer import write_records  # noqa: PLC0415

        write_records(folder, [(EVENT, 1, pack_event("a", "b")), (TICK, 2, bytes(PACKER.size))])
        (folder / "traffic.tlog").unlink()
    for number, content in enumerate(found):
        (folder / f"seed{number}").write_bytes(content)


def shortened(value: object, length: int) -> object:
    """JSON with its lists cut: exact arithmetic on a whole certificate takes a minute where every step is followed."""
    if isinstance(value, dict):
        return {key: shortened(inner, length) for key, inner in value.items()}
    return [shortened(inner, length) for inner in value[:length]] if isinstance(value, list) else value


def lines_of(target: str, data: bytes) -> set[tuple[str, int]]:
    """The lines of ours that an input reaches."""
    from targets import TARGETS  # noqa: PLC0415

    reached: set[tuple[str, int]] = set()

    def trace(frame: FrameType, event: str, _: object) -> Any:
        name = frame.f_code.co_filename
        if not name.startswith(_OURS):
            return None
        if event == "line":
            reached.add((name, frame.f_lineno))
        return trace

    sys.settrace(trace)
    try:
        TARGETS[target](data)
    finally:
        sys.settrace(None)
    return reached


def pack(target: str, folder: Path) -> int:
    """The corpus as one file of the tests: inputs that reach a line no smaller one does, and what once broke it."""
    reached: set[tuple[str, int]] = set()
    kept = []
    for data in sorted((path.read_bytes() for path in (folder / target).iterdir()), key=len):
        if lines_of(target, data) - reached and sum(map(len, kept)) < _PACKED_BYTES:
            reached |= lines_of(target, data)
            kept.append(data)
    broke = [path.read_bytes() for path in sorted(folder.glob(f"{target}-crash-*"))]
    text = json.dumps([base64.b64encode(one).decode() for one in [*kept, *broke]], indent=0)
    (ROOT / "tests" / "data" / "fuzz" / f"{target}.json").write_text(text + "\n")
    return len(kept) + len(broke)


def run(target: str) -> None:
    """The fuzzer's own process; what is left of the command line is libFuzzer's."""
    import atheris  # noqa: PLC0415

    with atheris.instrument_imports(include=["companion"]):
        from targets import TARGETS  # noqa: PLC0415

    atheris.Setup(sys.argv, TARGETS[target])
    atheris.Fuzz()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("targets", nargs="+")
    parser.add_argument("--seconds", type=int, default=300, help="for each (default: 300)")
    parser.add_argument("--corpus", type=Path, default=Path("corpus"))
    parser.add_argument("--minimise", action="store_true")
    arguments = parser.parse_args()
    failed = 0
    for target in arguments.targets:
        folder = arguments.corpus / target
        seeds(target, folder)
        if arguments.minimise:
            print(f"{target}: {pack(target, arguments.corpus)} inputs", flush=True)
            continue
        command = [sys.executable, __file__, "--target", target, f"-max_total_time={arguments.seconds}", *_LIMITS]
        command += [f"-artifact_prefix={arguments.corpus}/{target}-", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [line for line in done.stderr.splitlines() if line.startswith(("stat::number_of", "INFO: seed corpus"))]
        print(f"{target}: code {done.returncode}; {' '.join(lines)}", flush=True)
        if done.returncode:
            failed += 1
            print(f"{done.stdout[-1500:]}\n{done.stderr[-1500:]}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--target"]:
        name = sys.argv.pop(2)
        del sys.argv[1]
        run(name)
    else:
        sys.exit(main())
