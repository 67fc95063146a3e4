"""Compiling kernels with numba, and keeping what was compiled by the hash of the source text it depends on."""
