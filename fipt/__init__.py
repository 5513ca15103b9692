"""Inverse path tracing of rooms: from posed HDR pictures to materials, lamps and relit views.

Importing this package loads nothing heavy: the ray tracer, torch and the numerics are loaded by
the modules that need them, when they are called.
"""

__version__ = "0.1.0"
