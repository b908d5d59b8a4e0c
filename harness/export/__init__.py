"""What is designed here and runs elsewhere: the controller as C and as FMU, the loop as SSP."""
