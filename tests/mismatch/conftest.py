"""Diagnoses that several tests look at, each made once."""

import pytest
from concealed_campaigns import concealed


@pytest.fixture(scope="session")
def diagnosed():
    """Diagnoses by effect, each made once."""
    from bayes_dea.mismatch.diagnosis import diagnose

    done = {}

    def get(name, parameters, **keys):
        if name not in done:
            effects = {} if name == "none" else {name: parameters}
            done[name] = diagnose(concealed(effects, **keys), "hooke+gm3", seed=1)
        return done[name]

    return get
