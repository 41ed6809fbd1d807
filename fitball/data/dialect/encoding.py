"""From bytes to text: UTF-8, UTF-16, and Windows-1252 where nothing else explains the bytes."""

from __future__ import annotations

import codecs
import re

from fitball.data.dialect.cells import refusal

# Signs and letters of Windows-1252 (and of Latin-1, its part) that stand in tables.
_WESTERN = frozenset(
    "\u00a0§°±²³µ·¹×–—‘’“”ŠšŽžŒœŸÀÁÂÃÄÅÆÇÈÉÊËÌÍÎÏÐÑÒÓÔÕÖØÙÚÛÜÝÞßàáâãäåæçèéêëìíîïðñòóôõöøùúûüýþÿ".encode("cp1252")
)
_UTF8_LETTER = re.compile(rb"[\xc3-\xf4][\x80-\xbf]|\xc2[\x80-\xbf]")
# Share of zero bytes at even or odd places above which text is UTF-16: of ASCII every second byte is zero.
_ZEROS = 0.4


def decode(source: str, data: bytes) -> tuple[str, tuple[str, ...]]:
    """The text of a file, and a note where its encoding was guessed.

    Raises TableError where bytes are left that no encoding explains.
    """
    wide = _utf_16(data)
    if wide is not None:
        try:
            text = data.decode(wide).removeprefix("\ufeff")
        except UnicodeDecodeError as error:
            raise refusal(
                source,
                f"the bytes at offset {error.start} are not UTF-16, which this file looks like; "
                "expected text: save the file as 'CSV UTF-8'",
            ) from None
        return _without_zeros(source, text), ("the file was read as UTF-16",)
    try:
        return _without_zeros(source, data.decode("utf-8-sig")), ()
    except UnicodeDecodeError as error:
        # A byte order mark is stripped before decoding, so the position counts from behind it.
        place = error.start + (3 if data.startswith(codecs.BOM_UTF8) else 0)
    odd = {byte for byte in data if byte > 0x7F}
    line = data[:place].count(b"\n") + 1
    if odd <= _WESTERN and not _UTF8_LETTER.search(data) and not data.startswith(codecs.BOM_UTF8):
        text = data.decode("cp1252")
        told = f"bytes that are not UTF-8 were read as Windows-1252, first '{text[place]}' in line {line}"
        return _without_zeros(source, text), (told,)
    raise refusal(
        source,
        f"read byte 0x{data[place]:02x} at offset {place}, which is not UTF-8; "
        "expected UTF-8 text: save the file as 'CSV UTF-8'",
        line,
    )


def _utf_16(data: bytes) -> str | None:
    """The codec of UTF-16 text, with a byte order mark or known by its zero bytes; None for other text."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    half = len(data) // 2
    if half == 0:
        return None
    if data[1::2].count(0) > _ZEROS * half and data[::2].count(0) == 0:
        return "utf-16-le"
    if data[::2].count(0) > _ZEROS * half and data[1::2].count(0) == 0:
        return "utf-16-be"
    return None


def _without_zeros(source: str, text: str) -> str:
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise refusal(source, "read a zero byte (not text at all?); expected text: save it as 'CSV UTF-8'", line)
    return text
