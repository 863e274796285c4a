"""Messages of the openpi protocol: MessagePack with NumPy arrays, and never objects.

The bytes are those of `msgpack_numpy` in the package openpi-client.
"""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

LARGEST: Final = 2**24
"""Greatest size of a message that is accepted [bytes]."""

_KINDS: Final = "biufUS"  # Kinds of arrays: truth values, numbers and text.


def check_installed() -> None:
    """Raise ModuleNotFoundError, with what to install, if a library is missing."""
    try:
        import msgpack  # noqa: F401
        import websockets  # noqa: F401
    except ImportError as error:
        text = f"WebSockets need pip install 'gplfd[remote]' ({error})"
        raise ModuleNotFoundError(text) from error


def pack(message: Mapping[str, Any]) -> bytes:
    """Return a message as bytes; raises a TypeError for what it cannot contain."""
    import msgpack

    return bytes(msgpack.packb(message, default=_packed))


def _packed(value: Any) -> dict[bytes, Any]:
    if not isinstance(value, np.ndarray | np.generic) or value.dtype.kind not in _KINDS:
        raise TypeError(f"a message cannot contain {value!r:.80}")
    if isinstance(value, np.generic):
        content = {b"__npgeneric__": True, b"data": value.item()}
        return {**content, b"dtype": value.dtype.str}
    content = {b"__ndarray__": True, b"data": value.tobytes()}
    return {**content, b"dtype": value.dtype.str, b"shape": value.shape}


def unpack(data: bytes) -> Any:
    """Return the content of a message; raises a ValueError for any other bytes."""
    import msgpack

    try:
        return msgpack.unpackb(data, object_hook=_unpacked)
    except Exception as error:  # Damaged bytes raise many types, some without a text.
        reason = str(error) or type(error).__name__
        raise ValueError(f"not MessagePack with arrays: {reason:.200}") from error


def _unpacked(entries: dict[Any, Any]) -> Any:
    if not entries.keys() & {b"__ndarray__", b"__npgeneric__"}:
        return entries
    name, data = entries[b"dtype"], entries[b"data"]
    dtype = np.dtype(name if isinstance(name, str) else "O")
    if dtype.kind not in _KINDS:
        raise ValueError(f"an array of {name!r:.40} is not accepted, only of numbers")
    if b"__npgeneric__" in entries:
        return dtype.type(data)
    shape = entries[b"shape"]
    if not all(type(length) is int and length >= 0 for length in shape):
        raise ValueError(f"{shape!r:.40} is not the shape of an array")
    if len(data) != dtype.itemsize * math.prod(shape):
        raise ValueError(f"{len(data)} bytes are not an array {shape!r:.40} of {dtype}")
    return np.ndarray(shape, dtype, data).copy()
