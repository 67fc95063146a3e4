"""One page about a recorded drive: figures in words, pictures, where the energy went, and what happened."""
