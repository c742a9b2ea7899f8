"""The blocks: the plant, and the model that the controller uses."""
