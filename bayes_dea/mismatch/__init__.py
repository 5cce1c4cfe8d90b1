"""Where model and recordings differ, which physics was left out, and the proof that it was."""
