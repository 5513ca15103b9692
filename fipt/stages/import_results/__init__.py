"""What others estimated on a room, brought to the form in which a run of a method is judged."""
