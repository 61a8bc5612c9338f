"""Readers of measurement files, and the real measurements that ship with the package."""
