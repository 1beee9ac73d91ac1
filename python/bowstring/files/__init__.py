"""Files: written whole or not at all, JSON read back, folders of results."""
