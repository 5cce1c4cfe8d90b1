"""A campaign reduced to block means, and models fitted to it by Gauss-Newton with their noise."""
