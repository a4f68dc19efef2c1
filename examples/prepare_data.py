"""Make or convert recordings and prepare a data set: see --help."""

from tactile_diffusers.cli.prepare_data import main

if __name__ == "__main__":
    main()
