"""The mathematics, symbolic: machines, discretisation, measurement and its Jacobian, filters.

Knows no language and no target. Start at :func:`model.machines.state_space.build` (drive -> f, h, F, H) and
:func:`model.filters.build_filter` (model -> a filter step whose stages carry equation numbers).
"""
