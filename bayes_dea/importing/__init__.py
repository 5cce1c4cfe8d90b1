"""Looks at recordings of another make and proposes their campaign (`bayes-dea import`).

From left to right: a file is sniffed (sniff_text, sniff_arrays) into tables of raw columns; names and ranges say what
each column is (words, ranges, roles); signals say where recordings begin and which kind each is (shapes, split);
propose puts it together, asking where nothing decides (ask); write leaves campaign.toml.
"""

from bayes_dea.importing.ask import Question, answered, nobody
from bayes_dea.importing.propose import Proposal, ProposedRecording, propose
from bayes_dea.importing.run import Imported, import_files
from bayes_dea.importing.sniff import sniff

__all__ = [
    "Imported",
    "Proposal",
    "ProposedRecording",
    "Question",
    "answered",
    "import_files",
    "nobody",
    "propose",
    "sniff",
]
