"""Protocols: the files that know all three physics."""
