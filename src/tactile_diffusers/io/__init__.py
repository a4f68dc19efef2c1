"""Files: whole or absent, locked while they are written, refused by name when damaged."""
