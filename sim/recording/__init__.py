"""The files a recorded run was made from."""
