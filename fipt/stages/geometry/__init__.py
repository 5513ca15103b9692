"""The room's geometry from posed views."""
