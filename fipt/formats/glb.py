"""The container of binary glTF files."""

import json
import struct
from collections.abc import Mapping
from typing import Any

_MAGIC, _VERSION = 0x46546C67, 2
_JSON, _BINARY = 0x4E4F534A, 0x004E4942


def packed(document: Mapping[str, Any], binary: bytes | bytearray) -> bytes:
    """Return a .glb file of a JSON document, which has no NaN, and binary data."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    binary = bytes(binary) + b"\0" * (-len(binary) % 4)
    head = struct.pack("<III", _MAGIC, _VERSION, 12 + 8 + len(text) + 8 + len(binary))
    return b"".join(
        [head, struct.pack("<II", len(text), _JSON), text, struct.pack("<II", len(binary), _BINARY), binary]
    )


def chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON document and binary data of a .glb file.

    Raises
    ------
    ValueError, struct.error
        If the file is damaged or has another version.
    """
    magic, version, total = struct.unpack_from("<III", content)
    if (magic, version, total) != (_MAGIC, _VERSION, len(content)):
        raise ValueError("no complete binary glTF 2.0")
    length, kind = struct.unpack_from("<II", content, 12)
    if kind != _JSON:
        raise ValueError("its first chunk is not JSON")
    document = json.loads(content[20 : 20 + length])
    size, kind = struct.unpack_from("<II", content, 20 + length)
    if kind != _BINARY:
        raise ValueError("its second chunk is not binary")
    start = 28 + length
    return document, content[start : start + size]
