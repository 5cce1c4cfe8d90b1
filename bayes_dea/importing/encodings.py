"""Which encoding the bytes of a text file are in."""

from __future__ import annotations

import codecs
import re

_CHINESE = ("时间", "位移", "力", "电压", "试验", "通道", "温度", "序号", "编号", "应力", "应变", "采样")
_SIGNS = set("äöüÄÖÜßéèêàçñøåæµ°²³·ºΩ±–“”„’")


def find_encoding(head: bytes, whole: bool) -> tuple[str, str]:
    """(encoding as the format map writes it, why). `whole` says that `head` is all of the file.

    ASCII and UTF-8 are certain; GBK and latin-1 are told apart by what the bytes spell.
    """
    if head.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig", "begins with the mark of UTF-8"
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16", "begins with the mark of UTF-16"
    if head[1:200:2].count(0) > 40 and head[0:200:2].count(0) == 0:
        return "utf-16-le", "every second byte is zero"
    if head.isascii():
        return "utf-8", "plain ASCII"
    try:
        codecs.getincrementaldecoder("utf-8")("strict").decode(head, final=whole)
        return "utf-8", "valid UTF-8"
    except UnicodeDecodeError:
        pass
    high = re.findall(rb"[\x80-\xff]+", head)
    chinese = _decoded(head, "gbk", whole)
    if chinese is not None and (
        any(word in chinese for word in _CHINESE) or all(len(run) % 2 == 0 and min(run) >= 0xA1 for run in high)
    ):
        words = [word for word in _CHINESE if word in chinese]
        return "gbk", f"spells {words[0]} in GBK" if words else "its bytes come in pairs, as in GBK"
    western = head.decode("cp1252", errors="replace")
    shown = "".join(dict.fromkeys(ch for ch in western if ord(ch) > 127))[:12]
    known = "" if set(shown) <= _SIGNS else "; look whether its names read well"
    if any(0x80 <= b <= 0x9F for b in head):
        return "cp1252", f"spells {shown} in Windows' western code page{known}"
    return "latin-1", f"spells {shown} in latin-1{known}"


def _decoded(head: bytes, encoding: str, whole: bool) -> str | None:
    try:
        return codecs.getincrementaldecoder(encoding)("strict").decode(head, final=whole)
    except UnicodeDecodeError:
        return None
