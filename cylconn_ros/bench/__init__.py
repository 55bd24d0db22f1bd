"""Speed and accuracy measured: problem, set, run, result, report.

``problems`` says what is solved and where its answer comes from, ``methods`` how each method of
ours is set up, ``*_peer`` how others are; ``timing`` runs contestants in turns; ``results`` holds
what was found, ``report`` prints it.
"""
