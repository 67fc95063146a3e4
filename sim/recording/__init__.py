"""Reading recordings, and the files a recorded run was made from."""
