"""Files: written under a temporary name and renamed, locked while they are written, refused by name when damaged."""
