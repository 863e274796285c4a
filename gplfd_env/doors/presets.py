"""Presets of doors, randomizations and disturbances, read from an asset."""

import tomllib

from gplfd_env.conventions.assets import asset_path
from gplfd_env.validation.named import Record, with_fields


def preset_table(section: str, plain: Record) -> dict[str, Record]:
    """Return a section of ``assets/presets.toml`` as records by name."""
    text = asset_path("presets.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)[section]
    return {name: with_fields(plain, fields, name) for name, fields in table.items()}
