"""Blocks of the plant and of the nominal model that the controller uses."""
