"""Settings of the bound by true constants: none."""

from fipt.settings import Settings


class TrueConstantsSettings(Settings):
    """The true mean material of every part and the true emitters: a bound for comparisons."""
