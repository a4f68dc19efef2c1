"""The data card: a description of recordings and of what preparation keeps of them, in words, numbers and pictures."""

from .data_card import check_card_folder, describe, write_card
from .page import summary

__all__ = ["check_card_folder", "describe", "summary", "write_card"]
