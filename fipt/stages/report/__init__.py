"""The HTML page that shows a scene's results."""
