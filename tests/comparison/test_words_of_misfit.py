"""The command that a comparison proposes when even its best model misses the recordings."""

from bayes_dea.comparison import words


def test_the_warning_names_the_campaign(monkeypatch):
    monkeypatch.setattr(words, "_misfit", lambda _: (1e-6, 5e-6, "m"))
    monkeypatch.setattr(words, "_prior_dependent", lambda _: None)
    best = {"model": "hooke+gm1", "converged": True, "spared": False, "swarms_agree": (3, 3), "log_evidence": 1.0,
            "log_evidence_laplace": None, "log_evidence_by": "importance"}
    said = words.warnings_of({"ranking": [best], "recordings": [None] * 6}, {"hooke+gm1": None},
                             ["my campaign", "--data-root", "raw"])
    assert len(said) == 1
    assert said[0].endswith("with: bayes-dea diagnose 'my campaign' --data-root raw --model hooke+gm1")
