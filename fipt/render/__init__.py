"""The one ray layer: nothing outside this package touches Mitsuba."""
