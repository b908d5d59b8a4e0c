"""Small bugs planted in copies of the sources, to measure how many of them the tests see."""
