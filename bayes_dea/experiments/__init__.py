"""Experiments that a bench can do: the menu, commands, limits of the actuator, what bench time costs."""
