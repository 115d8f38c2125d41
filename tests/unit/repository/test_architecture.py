"""What import-linter's walls do not say: no circle anywhere, and no folder too full to look through."""

from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("companion", "sitl")
MOST_FILES = 16


def test_no_module_imports_itself_by_way_of_others() -> None:
    """Imports for type checkers only count, and those inside functions too: a circle there is a circle of thought."""
    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=False, cache_dir=None)
    below = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert len(below) > 100
    TopologicalSorter(below).prepare()  # raises CycleError, which names the circle


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_holds_too_many_files(package: str) -> None:
    folders = Counter(path.parent for path in (ROOT / package).rglob("*.py"))
    assert folders
    assert {str(folder) for folder, files in folders.items() if files > MOST_FILES} == set()
