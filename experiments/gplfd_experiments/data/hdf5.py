"""Safe access to members of an HDF5 file: inside the file, and of bounded size.

HDF5 follows links to other files and named pipes, fills a dataset without data with
zeros, and unpacks a chunk to whatever its compressed stream holds. Therefore links,
shapes and chunks are checked before HDF5 reads.
"""

import math
import zlib
from typing import Any, Final

import h5py
import numpy as np

from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.storage import DecodingBudget

_DEFLATE: Final = h5py.h5z.FILTER_DEFLATE
_CHECKSUM: Final = h5py.h5z.FILTER_FLETCHER32
_CHECKSUM_SIZE: Final = 4  # Bytes that it adds to a chunk.
_FILTERS: Final = frozenset({h5py.h5z.FILTER_SHUFFLE, _CHECKSUM, _DEFLATE})
_REFERENCE: Final = 16
"""Bytes per variable-length text in a dataset: only its length and address."""


def member(group: Any, name: str) -> Any:
    """Return a member of a group, or raise ValueError if it is not in the file."""
    link = group.get(name, getlink=True)
    if link is None:
        raise ValueError(f"{group.name} has no member {name!r:.80}")
    _check_link(group, name, link)
    return group[name]


def check_links(group: Any) -> None:
    """Raise ValueError if a link in a group, or below it, leads elsewhere."""
    links: list[tuple[str, Any]] = []
    group.visititems_links(lambda name, link: links.append((name, link)))
    for name, link in links:
        _check_link(group, name, link)


def _check_link(group: Any, name: str, link: Any) -> None:
    if not isinstance(link, h5py.HardLink):
        raise ValueError(
            f"{group.name.rstrip('/')}/{name} is a {type(link).__name__}, and links "
            "are not followed; copy what it names into the file: h5copy, or h5repack"
        )


def numbers(dataset: Any, budget: DecodingBudget) -> FloatArray:
    """Return a dataset of numbers as float64; raises ValueError for anything else."""
    check_readable(dataset, budget)
    if dataset.dtype.kind not in "iuf":
        raise ValueError(f"{dataset.name} holds {dataset.dtype!s:.40}, not numbers")
    return np.asarray(dataset[()], dtype=np.float64)


def check_readable(dataset: Any, budget: DecodingBudget) -> None:
    """Claim the memory of a dataset, and check its storage.

    Raises:
        ValueError: Its values lie in other files, it is compressed in an unusual way,
            or it takes more than the budget allows.
    """
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"{dataset.name} is no dataset")
    if dataset.external or dataset.is_virtual:
        raise ValueError(
            f"the values of {dataset.name} lie in other files, which are not opened; "
            "copy them into this file: h5repack"
        )
    # HDF5 unpacks whole chunks, which may be larger than the dataset.
    largest = max(map(math.prod, (dataset.shape or (), dataset.chunks or ())))
    budget.claim(max(8, dataset.dtype.itemsize) * largest, dataset.name)
    if dataset.chunks is None:
        return
    # Checksums may follow the deflate filter, and nothing else.
    stored = dataset.id.get_create_plist()
    filters = [stored.get_filter(place)[0] for place in range(stored.get_nfilters())]
    deflate = filters.index(_DEFLATE) if _DEFLATE in filters else None
    after = [] if deflate is None else filters[deflate + 1 :]
    if not set(filters) <= _FILTERS or set(after) - {_CHECKSUM}:
        raise ValueError(
            f"{dataset.name} is compressed in an unusual way; write it again with "
            "h5repack -f GZIP=4"
        )
    if deflate is None:
        return
    # A chunk may not contain more numbers than its shape allows.
    item = _REFERENCE if dataset.dtype.hasobject else dataset.dtype.itemsize
    size = math.prod(dataset.chunks) * item + _CHECKSUM_SIZE
    for number in range(dataset.id.get_num_chunks()):
        place = dataset.id.get_chunk_info(number).chunk_offset
        skipped, chunk = dataset.id.read_direct_chunk(place)
        if skipped >> deflate & 1:
            continue
        if len(zlib.decompressobj().decompress(chunk, size + 1)) > size:
            raise ValueError(f"a chunk of {dataset.name} unpacks to more than a chunk")
