"""Pushes of a solid that moves in a few shapes only."""
