"""The diagnosis: one grammar of hypotheses, one likelihood of the logs, one decision by the prediction of data."""
