"""``fipt fit``: samples, shading, images and segments -> the model of a round."""

from typing import TYPE_CHECKING, Any

from fipt.stages.fit.inputs import FitInputs

if TYPE_CHECKING:
    from fipt.stages.fit.settings import FitSettings


def run(inputs: FitInputs, settings: "FitSettings") -> dict[str, Any]:
    """Fit the material network, and the emission network if there is one, to the images.

    A fit that was interrupted goes on from its last checkpoint.
    """
    from fipt.scene.settled import read_state
    from fipt.stages.fit.settling import copy_round

    state = read_state(inputs.settled)
    if state is not None and state.settled is not None:
        return copy_round(inputs, state)
    from fipt.stages.fit.run import fit_model  # brings torch, for which a copy need not wait

    return fit_model(inputs, settings)
