"""The container of binary glTF files, and their numbers."""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

_MAGIC, _VERSION = 0x46546C67, 2
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_FLOAT = 5126
_INTEGERS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


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


def with_floats(content: bytes) -> bytes:
    """Return a .glb file whose normalized integers are floats: colours, texture coordinates, quantized positions.

    Raises
    ------
    ValueError, struct.error, LookupError
        If the file is damaged, or its numbers lie in other files.
    """
    document, binary = chunks(content)
    if any("uri" in buffer for buffer in document.get("buffers", [])):
        raise ValueError("its numbers are not inside the file")
    data = bytearray(binary)
    for accessor in document.get("accessors", []):
        if not accessor.get("normalized") or "bufferView" not in accessor:
            continue
        view = document["bufferViews"][accessor["bufferView"]]
        values = _floats(accessor, view, binary)
        data += b"\0" * (-len(data) % 4)
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        data += values.tobytes()
        accessor |= {"bufferView": len(document["bufferViews"]) - 1, "byteOffset": 0, "componentType": _FLOAT}
        accessor["normalized"] = False
    for buffer in document.get("buffers", []):  # a .glb file has one
        buffer["byteLength"] = len(data)
    return packed(document, data)


def _floats(accessor: Mapping[str, Any], view: Mapping[str, Any], binary: bytes) -> np.ndarray:
    """(N, C) float32 in [-1, 1] of normalized integers."""
    kind, width = np.dtype(_INTEGERS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    strides = view.get("byteStride", width * kind.itemsize), kind.itemsize
    rows = np.ndarray((accessor["count"], width), kind, binary, start, strides)
    return np.maximum(rows / np.iinfo(kind).max, -1).astype("<f4")
