"""A second simulator of actuator campaigns, written from the contract alone: it shares no code with the package."""
