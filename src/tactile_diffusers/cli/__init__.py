"""The command line. The scripts in `examples/` are thin over it."""
