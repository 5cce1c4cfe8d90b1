"""What a calibration is for: the answer to any command with bands, and the command for a wanted stroke."""
