"""Diagnoses that several tests look at, each made once."""

import pytest
from concealed_campaigns import concealed


@pytest.fixture(scope="session")
def diagnosed():
    """Diagnoses by effect and its strength, each made once."""
    from bayes_dea.mismatch.diagnosis import diagnose

    done = {}

    def get(name, parameters, **keys):
        key = (name, *sorted(parameters.items()), *sorted(keys.items()))
        if key not in done:
            effects = {} if name == "none" else {name: parameters}
            done[key] = diagnose(concealed(effects, **keys), "hooke+gm3", seed=1)
        return done[key]

    return get
