"""What `distill.py` trains a DALE of one step with besides the package: its network of scalars."""
