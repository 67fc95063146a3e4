"""The study of the paper, redone: Nold & Corman (2024), sections 4.2 to 4.7, and what they only argue."""
