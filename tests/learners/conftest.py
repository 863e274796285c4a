"""Programs that are run in a scratch folder."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def run_python(tmp_path: Path) -> Callable[..., str]:
    """Return a function: what Python prints, given these arguments."""

    def run(*arguments: Any) -> str:
        result = subprocess.run(
            [sys.executable, *map(str, arguments)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stderr
        return result.stdout

    return run
