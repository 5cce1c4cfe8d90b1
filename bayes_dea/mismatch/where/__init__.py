"""Where simulation and recordings differ, and by how much."""
