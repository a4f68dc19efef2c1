"""The data card: a description of recordings and of what preparation keeps of them, in words, numbers and pictures."""

from .card import describe, write_card
from .folder import check_card_folder
from .markdown import summary

__all__ = ["check_card_folder", "describe", "summary", "write_card"]
