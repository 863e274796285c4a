"""How many numbers a parquet file decodes to, by the headers of its pages.

The footer of a file says how many values a column has, but a reader believes the header
of every page, and a run of one value takes a few bytes however long it is. The headers
are structures of Thrift's compact protocol, see *Parquet: Page Header* in
https://github.com/apache/parquet-format and *Thrift Compact Protocol*.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any, BinaryIO, Final

from gplfd_policies.arrays.storage import DecodingBudget

_NUMBERS: Final = frozenset({"BOOLEAN", "INT32", "INT64", "FLOAT", "DOUBLE"})
_LONGEST_HEADER: Final = 2**16  # Of a page [bytes]; its statistics may hold two values.
# Fields of a page header: two sizes, and one structure for each kind of page.
_UNCOMPRESSED, _COMPRESSED = 2, 3
_DATA, _DICTIONARY, _DATA_V2 = 5, 7, 8
_VALUES: Final = 1  # Field of each of these structures.


def claim_columns(
    file: BinaryIO, metadata: Any, wanted: Sequence[str], budget: DecodingBudget
) -> None:
    """Claim what the wanted columns take when they are decoded to float64.

    Args:
        file: The parquet file.
        metadata: Its `pyarrow.parquet.FileMetaData`.
        wanted: Names of columns, of numbers or lists of numbers.
        budget: From which they are claimed.

    Raises:
        ValueError: A column holds something else, a page is damaged, or the columns
            take more than the budget allows.
    """
    groups = map(metadata.row_group, range(metadata.num_row_groups))
    for column in (one.column(n) for one in groups for n in range(one.num_columns)):
        name = f"column {column.path_in_schema:.80}"
        # The numbers of a list x stand in a column x.list.element.
        if not f"{column.path_in_schema}.".startswith(tuple(f"{w}." for w in wanted)):
            continue
        if column.physical_type not in _NUMBERS:
            raise ValueError(f"{name} holds {column.physical_type}, not numbers")
        place = column.data_page_offset
        if column.has_dictionary_page and 0 < column.dictionary_page_offset < place:
            place = column.dictionary_page_offset
        end = place + column.total_compressed_size
        while place < end:
            file.seek(place)
            stream = BytesIO(file.read(_LONGEST_HEADER))
            header = _structure(stream)
            kinds = (header.get(kind, {}) for kind in (_DATA, _DICTIONARY, _DATA_V2))
            values = sum(kind.get(_VALUES, 0) for kind in kinds)
            budget.claim(header.get(_UNCOMPRESSED, 0) + 8 * values, name)
            place += stream.tell() + max(0, header.get(_COMPRESSED, 0))


def _structure(stream: BytesIO) -> dict[int, Any]:
    """Return the integers and structures of a Thrift structure by field."""
    fields: dict[int, Any] = {}
    field = 0
    while head := _byte(stream):
        field = field + (head >> 4) if head >> 4 else _integer(stream)
        match head & 0xF:
            case 1 | 2:  # true or false
                pass
            case 3:
                _byte(stream)
            case 4 | 5 | 6:
                fields[field] = _integer(stream)
            case 7:
                stream.seek(8, 1)
            case 8:
                stream.seek(_unsigned(stream), 1)
            case 12:
                fields[field] = _structure(stream)
            case kind:
                raise ValueError(f"the header of a page has a field of type {kind}")
    return fields


def _byte(stream: BytesIO) -> int:
    read = stream.read(1)
    if not read:
        raise ValueError("the header of a page is cut off")
    return read[0]


def _unsigned(stream: BytesIO) -> int:
    """Return a number of seven bits per byte, the lowest first."""
    number, shift = 0, 0
    while (byte := _byte(stream)) & 0x80:
        number |= (byte & 0x7F) << shift
        shift += 7
    return number | byte << shift


def _integer(stream: BytesIO) -> int:
    """Return a signed number, in whose lowest bit the sign stands."""
    number = _unsigned(stream)
    return number >> 1 ^ -(number & 1)
