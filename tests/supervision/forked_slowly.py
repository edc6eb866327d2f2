"""A module for the warm parent that takes long to load."""

import time

time.sleep(600)
