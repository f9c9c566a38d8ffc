"""A stamp inside a picture file that identifies what made it, so that it cannot be separated from the picture."""

from __future__ import annotations

import re
import struct
import zlib

import pinholify

REACH = 512
"""A stamp lies within this many bytes of the beginning of the file."""

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_HEADER = 33  # bytes of the signature and of the chunk IHDR, which is always the first
_JPEG = b"\xff\xd8\xff\xe0"


def stamped(picture: bytes, identity: str) -> bytes:
    """The PNG or JFIF file ``picture`` with ``identity`` (32 hexadecimal digits) added as a comment.

    Raises ValueError for a file of another format (PNG specification 11.3.4.3, tEXt; ITU-T T.81 B.2.4.5, COM).
    """
    text = f"pinholify {pinholify.__version__} {identity}".encode()
    if picture.startswith(_PNG):
        body = b"tEXtSoftware\0" + text
        chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
        return picture[:_PNG_HEADER] + chunk + picture[_PNG_HEADER:]
    if picture.startswith(_JPEG):
        end = 4 + int.from_bytes(picture[4:6], "big")  # of the segment APP0, which JFIF requires to be first
        return picture[:end] + b"\xff\xfe" + struct.pack(">H", len(text) + 2) + text + picture[end:]
    raise ValueError("only PNG and JPEG files hold a stamp")


def stamp_of(beginning: bytes) -> str | None:
    """The identity in the first ``REACH`` bytes of a file, None if there is none."""
    match = re.search(rb"pinholify \S+ ([0-9a-f]{32})", beginning[:REACH])
    return match[1].decode() if match else None
