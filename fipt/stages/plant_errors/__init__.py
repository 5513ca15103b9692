"""A known room as somebody sees it whose mesh, poses or exposures are off: errors planted on purpose."""
