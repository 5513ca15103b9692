"""A cluster on one machine, and what may go wrong on it: ``make cluster``. No part of the test suite."""
