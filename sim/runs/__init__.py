"""What is made from a recorded drive: replay, reproduction, what-if."""
