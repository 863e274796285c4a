"""Compressing a data set's file; what is read from it stays the same."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Final

_COMPACT: Final = ("v110", "v110")
"""Format of HDF5 1.10 (2016), whose indices are far smaller than the oldest's."""
_LARGEST_CHUNK: Final = 1500
"""Rows that are compressed together."""


def pack(file: Path) -> None:
    """Compress in place: most of a physics state repeats from step to step."""
    import h5py

    plain = file.with_suffix(".plain")
    shutil.move(file, plain)
    with (
        h5py.File(plain) as source,
        h5py.File(file, "w", libver=_COMPACT, track_order=True) as target,
    ):

        def copy(name: str, item: Any) -> None:
            if isinstance(item, h5py.Group):
                copied: Any = target.create_group(name)
            elif item.chunks is None:
                copied = target.create_dataset(name, data=item[()])
            else:
                copied = target.create_dataset(
                    name,
                    data=item[()],
                    dtype=item.dtype,
                    chunks=(min(len(item), _LARGEST_CHUNK), *item.shape[1:]),
                    maxshape=item.maxshape,
                    compression="gzip",
                    shuffle=True,
                )
            copied.attrs.update(item.attrs)

        source.visititems(copy)
    plain.unlink()
