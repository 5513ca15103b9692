"""The checks: one module each, with a function `check(room, notes)`."""
