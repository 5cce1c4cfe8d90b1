"""The parts of the redone paper: a module each, with `run(task) -> Section`."""
