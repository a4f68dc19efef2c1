"""The demo: ratings to textures in a browser (`python examples/app.py`; needs the extra `demo`)."""
