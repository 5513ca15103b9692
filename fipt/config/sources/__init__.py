"""Where the data of a scene come from: one module a source, with what a person writes and what follows from it."""
