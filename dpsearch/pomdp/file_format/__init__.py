"""Cassandra's .POMDP files, read and written.

::

    text -> tokens -> preamble -> statements -> tables -> reader -> TabularPOMDP
            words     names,      T, O and R:   all of    splits states that pay for what is observed
            and       discount,   one line      them      (split), takes what #dpsearch: comments add
            lines     start       each          summed    (comments), merges equal distributions (pool)

    TabularPOMDP -> writer -> text
"""
