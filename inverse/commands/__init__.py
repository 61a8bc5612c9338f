"""The `arfjax` command."""
