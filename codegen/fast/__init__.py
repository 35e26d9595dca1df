"""The fast form: the same filters, with the structure of the model put to use.

P is carried as L D L^T (:mod:`factored`), f and h are split into even and odd parts along the columns of L
(:mod:`split`), measurements are taken one after another (:mod:`factored`), and :mod:`steps` puts the filters
together. No square root is left. What the graph still repeats is shared by :mod:`codegen.passes`.

Nothing here knows a motor: zeros, constants and linear rows are found, not assumed.
"""
