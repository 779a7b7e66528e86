"""The arm: what the model is and how it moves; pure, differentiable functions that know no data and no file.

Arrays hold components first, then joints, then any batch dimensions: `(3, N, *batch)`. Functions broadcast over
the batch, so postures, load cases and posterior draws are further axes at the end, of any number and size.
"""
