"""The workflow of fipt, for plain ``snakemake`` in a clone: all of it stands in fipt/workflow/, which the wheel holds."""


include: "fipt/workflow/Snakefile"


# An include leaves the default target to the file that includes it.
rule everything:
    """The report of every scene."""
    default_target: True
    input:
        rules.all.input,
