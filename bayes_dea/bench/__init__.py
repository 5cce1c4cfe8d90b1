"""The virtual bench: a reference actuator with equations, integrator and nuisance of its own.

Nothing in here that makes recordings imports the models, the likelihood or the fit: a bench that shares
their code could not contradict them.
"""
