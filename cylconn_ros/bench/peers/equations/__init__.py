"""SciPy on equations of motion that were reduced by hand for each scene."""
