"""Changing bytes at random, as damage and strangers do."""

from __future__ import annotations

import random

_TELLING = bytes([0x00, 0x01, 0x7F, 0x80, 0xC0, 0xC1, 0xDD, 0xDF, 0xFF])


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a copy of ``data`` with one to four changes: bits, bytes, cuts, repetitions, numbers at their limits."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if not changed:
            break
        at = rng.randrange(len(changed))
        match rng.randrange(7):
            case 0:
                changed[at] ^= 1 << rng.randrange(8)
            case 1:
                changed[at] = rng.choice(_TELLING)
            case 2:
                changed[at : at + 4] = rng.choice((b"\xff" * 4, bytes(4), b"\x00\x00\xc0\x7f", b"\xff\xff\xff\x7f"))
            case 3:
                del changed[at : at + rng.choice((1, 2, 8, 64))]
            case 4:
                changed[at:at] = rng.randbytes(rng.choice((1, 2, 8, 64)))
            case 5:
                del changed[at:]
            case 6:
                piece = changed[at : at + rng.choice((1, 16, 256))]
                where = rng.randrange(len(changed) + 1)
                changed[where:where] = piece
    return bytes(changed)
