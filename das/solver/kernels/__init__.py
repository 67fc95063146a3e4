"""Numba kernels of the solver. They fill the arrays passed to them or return plain tuples, and do not check arguments.

Symbols: s position (m), v speed (m/s), h length of a step (m), w = v² (m²/s²), f wheel force (N), g constant resisting
force of an interval (gradient and curves, N), q tunnel coefficient (N/(m/s)²), u supply (receptivity, or
`NO_REGENERATION`, or `NEUTRAL`), p the train (`TrainParams`), c its losses (`LossParams`), lam the multiplier λ (W):
the price of a second. Within a step of integration the acceleration is constant.

Preconditions of every kernel: float64 C-contiguous arrays of matching lengths, steps > 0, and the named tuples of
`das.solver.kernels.tuples`.
"""
