"""Rooms from Mitsuba scene files: geometry, materials and lights of an XML scene; nothing in it is executed."""
