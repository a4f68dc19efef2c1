"""The commands, a module each. `tactile_diffusers_cli` calls them by name; the scripts in `examples/` do, too."""
