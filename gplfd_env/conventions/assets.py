"""Location of the assets: inside the installed wheel, or in the checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def asset_path(name: str) -> Path:
    """Return the path of a file in ``assets/``, or raise a FileNotFoundError."""
    for folder in (_PACKAGE / "assets", _PACKAGE.parent / "assets"):
        if (folder / name).is_file():
            return folder / name
    raise FileNotFoundError(
        f"asset {name!r} is missing; reinstall gplfd or run from a complete checkout"
    )
