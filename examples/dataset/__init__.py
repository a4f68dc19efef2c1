"""What `generate_dataset.py` reads and writes: ratings of many textures, shards of them, their card."""
