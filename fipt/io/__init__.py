"""Readers and writers of every file that two stages share."""
