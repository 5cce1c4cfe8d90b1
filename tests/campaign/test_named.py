"""A command that is proposed names the campaign that was read."""

import shutil
from pathlib import Path

from bayes_dea.bench.run import run_bench
from bayes_dea.campaign import load_campaign
from bayes_dea.campaign.named import campaign_words
from bayes_dea.campaign.schema import Campaign
from bayes_dea.commands.options import named, prior_words


def test_folders_files_and_what_lies_nowhere(small_campaign, tmp_path):
    here = shutil.copytree(small_campaign, tmp_path / "my campaign")
    assert campaign_words(load_campaign(here)) == [str(here.resolve())]
    other = here / "other.toml"
    shutil.copyfile(here / "campaign.toml", other)
    assert campaign_words(load_campaign(other)) == [str(other.resolve())]
    another = tmp_path / "B"
    run_bench(another, "small", seed=2)
    both = load_campaign([here, another])
    assert campaign_words(both) == [str(here.resolve()), str(another.resolve())]
    files = {entry["file"] for entry in both.inputs}
    assert {"my campaign/campaign.toml", "B/campaign.toml"} <= files
    assert all(f.startswith(("my campaign/", "B/")) for f in files)
    assert campaign_words(Campaign("x", (), None, {}, ())) == ["CAMPAIGN"]


def test_words_of_the_command_line_as_they_were_given():
    assert named([Path("a b"), Path("c")], Path("raw")) == ["a b", "c", "--data-root", "raw"]
    assert named([Path("a")], None) == ["a"]
    assert prior_words(["Y_Pa=1e6", "tau_1_s=3"], Path("p.toml")) == [
        "--priors", "p.toml", "--prior", "Y_Pa=1e6", "--prior", "tau_1_s=3"]
    assert prior_words(None, None) == []
