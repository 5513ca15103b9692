"""The terms of the loss, one file each: the equation, the legend of its symbols, the code.

    L = L_data + L_emission + (L_diffuse, or L_part + L_base) + L_hidden + L_propagation

`fipt.stages.fit.objective` weighs and adds them. Tensors are float32; a batch has B pixels, which show H footprint
samples, each of which the networks are asked about at Q points of its footprint.
"""
