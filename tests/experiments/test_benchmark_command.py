"""`gplfd benchmark` refuses what would make its table wrong."""

import pytest

from experiments.cli import main


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policies", "gp", "gp"], "policy gp is given twice"),
        (["--policies", "gp-fixd"], "did you mean 'gp-fixed'"),
        (["--doors", "small", "small"], "door small is given twice"),
        (["--seeds", "0"], "--seeds 0 must be 1 or more"),
    ],
)
def test_wrong_arguments_end_with_status_2(arguments, message, tmp_path, capsys):
    out = tmp_path / "study"
    assert main(["benchmark", "--out", str(out), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()
