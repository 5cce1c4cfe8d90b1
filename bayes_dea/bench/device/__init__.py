"""The virtual bench as a device on a serial line (CONTRACT 6)."""
