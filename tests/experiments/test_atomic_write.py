import math
from pathlib import Path

import pytest

from experiments.atomic_write import write_json


def test_json_refuses_nan_and_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "m.json", {"x": math.nan})
    assert list(tmp_path.iterdir()) == []
