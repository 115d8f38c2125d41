"""What the tests of the flight process share."""

from pathlib import Path

import pytest
from harness.link_bench import KEY


@pytest.fixture
def key_file(tmp_path: Path) -> str:
    """The setting that names a file of `KEY`."""
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    return f"link.signing_key_file={path}"
