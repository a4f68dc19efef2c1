"""What the two training scripts share: arguments, losses, the loop with its checkpoints."""
