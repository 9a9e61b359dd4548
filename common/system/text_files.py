"""Text that people wrote: UTF-8 as it should be, and what editors on Windows make of it."""

from __future__ import annotations

import codecs

# The mark of UTF-32 begins with that of UTF-16, so it comes first.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def decode_text(data: bytes) -> str:
    """Return the text in the bytes of a file: UTF-8, or what its byte order mark says (UTF-8, UTF-16 or UTF-32).

    Raises:
        ValueError: it is another encoding.
    """
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), "utf-8")
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"expected text in UTF-8, got byte 0x{data[error.start]:02x} at {error.start} ({error.reason}): save it as "
            "UTF-8"
        ) from None
    if "\0" in text:
        raise ValueError("expected text in UTF-8, got zeros as in UTF-16 without its byte order mark: save it as UTF-8")
    return text
