"""Results computed from a recorded drive: replay, reproduction, what-if."""
