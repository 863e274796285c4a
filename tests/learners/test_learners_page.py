"""Snippets of docs/your-policy.md that need extras run; run by .ci/learners."""

import os
import re
from pathlib import Path

import pytest

if os.environ.get("GPLFD_REQUIRE_ALL") != "1":
    pytest.importorskip("stable_baselines3", reason="needs pip install '.[sb3]'")
    pytest.importorskip("torchrl", reason="needs pip install torchrl")
    pytest.importorskip("mujoco_warp", reason="needs pip install '.[warp]'")

PAGE = (Path(__file__).parents[2] / "docs" / "your-policy.md").read_text()
SNIPPETS = re.findall(r"<!-- python: learners -->\n```python\n(.*?)```", PAGE, re.S)


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_snippet_runs(snippet, run_python):
    run_python("-c", snippet)
