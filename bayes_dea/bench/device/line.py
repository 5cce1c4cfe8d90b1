"""Lines that the device sends (CONTRACT 6): header, samples with a checksum, answers."""

from __future__ import annotations

HEADER = "# bayes-dea-bench 1 time_s,voltage_V,displacement_m\n"


def checksum(text: bytes) -> int:
    """XOR of all bytes."""
    total = 0
    for byte in text:
        total ^= byte
    return total


def sample_line(time_s: float, voltage_V: float, displacement_m: float) -> bytes:
    """One sample: microseconds, 10 mV and 10 nm, which is finer than clock, supply and sensor."""
    body = f"{time_s:.6f},{voltage_V:.2f},{displacement_m:.8f}".encode("ascii")
    return b"%s*%02X\n" % (body, checksum(body))
