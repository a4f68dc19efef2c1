"""What `distill.py` trains a DALE of one step with: views of its states, its training step, its network of scalars."""
