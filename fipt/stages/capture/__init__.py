"""Bracketed photographs to calibrated linear HDR views: the first stage of a photographed room."""
