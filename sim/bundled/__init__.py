"""The bundled recording: the train and the driver it was made with."""
