"""The container of binary glTF files."""

import json
import struct
from typing import Any

MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


def chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON document and binary data of a .glb file."""
    magic, version, total = struct.unpack_from("<III", content)
    if (magic, version, total) != (MAGIC, 2, len(content)):
        raise ValueError("no complete binary glTF 2.0")
    length, kind = struct.unpack_from("<II", content, 12)
    if kind != JSON_CHUNK:
        raise ValueError("its first chunk is not JSON")
    document = json.loads(content[20 : 20 + length])
    size, kind = struct.unpack_from("<II", content, 20 + length)
    if kind != BINARY_CHUNK:
        raise ValueError("its second chunk is not binary")
    start = 28 + length
    return document, content[start : start + size]
