"""Many fields, many widths: one table, begun again where it was left.

    from planner.many import Question, answers, fields_of

wanted    names with a star as the fields they stand for
digest    what the answer to a question depends on
batch     questions answered one after the other on any executor; one that cannot be answered does not end the rest
kept      answers in a file, so that a table that was interrupted goes on
cluster   an executor on the machines of a Dask cluster
"""

from planner.many.batch import Answer, Question, answers
from planner.many.wanted import fields_of

__all__ = ["Answer", "Question", "answers", "fields_of"]
