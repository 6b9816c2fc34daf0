"""Cassandra's .POMDP files, read and written.

::

    text -> tokens -> preamble -> statements -> tables -> reader -> TabularPOMDP
            words     names,      T, O and R:   all of    splits states that pay for what is observed
            and       discount,   one line      them      (split), takes what #dpsearch: comments add
            lines     start       each          summed    (comments), merges equal distributions (pool)

    TabularPOMDP -> writer -> text

A new statement begins in ``STATEMENTS`` (``tokens.py``); ``preamble.py`` reads headers and ``start``, ``statements.py``
reads T, O and R, of which ``tables.py`` makes probabilities and rewards.
"""
