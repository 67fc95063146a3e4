"""The kernels of bounds and refinement."""
