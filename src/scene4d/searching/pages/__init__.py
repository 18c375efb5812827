"""The page of a search: who did it, seen from above and in the footage, and why it was found."""
