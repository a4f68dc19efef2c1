"""The data card: recordings, and what preparation keeps of them, in words, numbers and pictures."""

from .measure import describe
from .writing import check_card_folder, summary, write_card

__all__ = ["check_card_folder", "describe", "summary", "write_card"]
