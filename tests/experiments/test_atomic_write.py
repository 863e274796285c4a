import math
import stat
from pathlib import Path

import pytest

from experiments.atomic_write import write_json
from policies.storage import complete_or_absent


def test_content_appears_under_the_name_only_when_complete(tmp_path: Path) -> None:
    target = tmp_path / "new" / "file.txt"
    with complete_or_absent(target) as temporary:
        temporary.write_text("half")
        assert not target.exists()
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_interruption_keeps_the_old_file_and_leaves_no_temporary(
    tmp_path: Path,
) -> None:
    target = tmp_path / "file.txt"
    target.write_text("old")

    def write_half_and_stop() -> None:
        with complete_or_absent(target) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_half_and_stop()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_result_is_readable_by_others_as_the_umask_allows(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with complete_or_absent(tmp_path / "file") as temporary:
        temporary.touch()
    mode = stat.S_IMODE((tmp_path / "file").stat().st_mode)
    assert mode == stat.S_IMODE(plain.stat().st_mode)


def test_json_refuses_nan_and_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "m.json", {"x": math.nan})
    assert list(tmp_path.iterdir()) == []
