"""The bench teaches the model while it runs: reading a serial line, sequential update, alarms, driving."""
