"""The files of `das-sim example`, and the train and the driver that the bundled recording was made with."""
