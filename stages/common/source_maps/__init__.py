"""What a source map shows: use of the exemplar, joints, places to look at."""
