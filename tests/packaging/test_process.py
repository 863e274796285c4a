"""The process around the command, with the installed script."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

GPLFD = Path(sys.executable).with_name("gplfd")


def test_workers_import_no_module_of_the_working_folder(tmp_path):
    for name in ("re", "json", "random", "numpy", "joblib"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported')\n")
    study = (
        *("benchmark", "--policies", "oracle", "--doors", "small", "--seeds", "1"),
        *("--no-skill", "--workers", "1", "--out", "study", "--quiet"),
    )
    finished = subprocess.run(
        [GPLFD, *study], cwd=tmp_path, stderr=subprocess.PIPE, check=False
    )
    assert (finished.returncode, finished.stderr) == (0, b"")


def test_a_reader_that_has_gone_is_no_traceback():
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as pipe:
        finished = subprocess.run(
            [GPLFD, "list"], stdout=pipe, stderr=subprocess.PIPE, check=False
        )
    assert (finished.returncode, finished.stderr) == (141, b"")
