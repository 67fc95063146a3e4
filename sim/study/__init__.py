"""Studies of calm runs and of the closed loop: the figures and pictures of docs/explanation/coach.md, made again."""
