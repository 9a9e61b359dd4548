"""The checksum of TensorBoard's records: CRC-32C (Castagnoli, RFC 3720 appendix B.4), masked as in TFRecord files."""

from __future__ import annotations

import numpy as np

from common.system.jit import njit

_POLYNOMIAL = 0x82F63B78
_MASK = 0xA282EAD8


def _table() -> np.ndarray:
    values = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        values = np.where(values & 1, (values >> 1) ^ np.uint32(_POLYNOMIAL), values >> 1).astype(np.uint32)
    return values


_TABLE = _table()


@njit(cache=True)
def _crc32c(data: np.ndarray, table: np.ndarray) -> np.uint32:
    crc = np.uint32(0xFFFFFFFF)
    for byte in data:
        crc = table[(crc ^ byte) & np.uint32(0xFF)] ^ (crc >> np.uint32(8))
    return crc ^ np.uint32(0xFFFFFFFF)


def masked_crc32c(data: bytes) -> int:
    """Return the masked checksum: a file of records may then hold records itself."""
    crc = int(_crc32c(np.frombuffer(data, np.uint8), _TABLE))
    return (((crc >> 15) | (crc << 17)) + _MASK) & 0xFFFFFFFF
