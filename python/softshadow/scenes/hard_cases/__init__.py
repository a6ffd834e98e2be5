"""Scenes in which methods go wrong: what is hard, the answer, and what each may be off.

`hard` is the collection. How tolerances are measured is said in `case`.
"""

from softshadow.scenes.hard_cases.case import Answer, Excuse, HardCase
from softshadow.scenes.hard_cases.cases import CASES
from softshadow.scenes.hard_cases.collection import HardCases

__all__ = ["Answer", "Excuse", "HardCase", "HardCases", "hard"]

hard = HardCases(CASES)
"""All hard cases by their names."""
