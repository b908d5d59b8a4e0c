"""What is wrong with a log before a fit: faulty readings, the order of legs, parameters that it does not show."""
