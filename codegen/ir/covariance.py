"""Where the covariance of each state lives in the words that a filter carries: the one owner of that fact.

The literal form carries the lower triangle of P, row by row, in the state's own order. The fast form carries
P = L D L^T in the same places, a pivot of D where the unit diagonal of L would stand, and the states may be taken in
another order (``root_order``), so that a state's place is not its index.
"""

from __future__ import annotations

from dataclasses import dataclass

from model.filters import FilterStep


@dataclass(frozen=True)
class CovarianceLayout:
    """Places in the n (n + 1) / 2 covariance words.

    Parameters
    ----------
    field : {"P", "LD"}
        The struct's field that holds the words.
    states : tuple of str
        The states' names, in order.
    order : tuple of int
        States by index: row k of the triangle is that of state ``order[k]``.

    Examples
    --------
    >>> layout = CovarianceLayout("LD", ("i", "omega", "theta"), (2, 0, 1))
    >>> layout.variance("theta"), layout.variance("omega"), layout.word("omega", "theta")
    (0, 5, 3)
    """

    field: str
    states: tuple[str, ...]
    order: tuple[int, ...]

    @classmethod
    def of(cls, step: FilterStep) -> CovarianceLayout:
        """Return the layout of a filter's step.

        Parameters
        ----------
        step : FilterStep
        """
        names = tuple(state.name for state in step.model.states)
        order = step.model.order if step.covariance == "LD" else tuple(range(len(names)))
        return cls(step.covariance, names, order)

    @property
    def size(self) -> int:
        """Number of words."""
        return place(len(self.states), 0)

    @property
    def natural(self) -> bool:
        """Whether rows follow the state's own order."""
        return self.order == tuple(range(len(self.states)))

    @property
    def variances(self) -> tuple[int, ...]:
        """The word of each state's variance or pivot, in the order of the states."""
        return tuple(self.variance(name) for name in self.states)

    @property
    def beside(self) -> tuple[int, ...]:
        """The words that are no state's variance or pivot, zero where states have nothing in common."""
        return tuple(k for k in range(self.size) if k not in self.variances)

    @property
    def rows(self) -> tuple[int, ...]:
        """The row of each state, in the order of the states."""
        return tuple(self.order.index(k) for k in range(len(self.states)))

    def row(self, state: str) -> int:
        """Return the row of the triangle that is a state's.

        Parameters
        ----------
        state : str
            Its name.
        """
        return self.order.index(self.states.index(state))

    def row_start(self, state: str) -> int:
        """Return the first word of a state's row; as many follow as its row has columns.

        Parameters
        ----------
        state : str
        """
        return place(self.row(state), 0)

    def variance(self, state: str) -> int:
        """Return the word of a state's variance (P) or pivot (LD).

        Parameters
        ----------
        state : str
        """
        return self.word(state, state)

    def word(self, one: str, other: str) -> int:
        """Return the word that two states share: of P their covariance, of L the entry in the later one's row.

        Parameters
        ----------
        one, other : str
        """
        low, high = sorted((self.row(one), self.row(other)))
        return place(high, low)

    def pairs(self) -> list[tuple[int, int]]:
        """Return row and column, as states by index, of every word in turn."""
        return [(self.order[i], self.order[j]) for i in range(len(self.order)) for j in range(i + 1)]


def place(row: int, column: int) -> int:
    """Return the place of an entry in a lower triangle that is stored row by row.

    Parameters
    ----------
    row, column : int
        ``column`` <= ``row``.
    """
    return row * (row + 1) // 2 + column


def state_place(p: str, state: str) -> str:
    """Return the name by which a header tells a state's place in x.

    Parameters
    ----------
    p : str
        The filter's C prefix.
    state : str
    """
    return f"{p}_{state}".upper()


def variance_place(p: str, layout: CovarianceLayout, state: str) -> str:
    """Return the name by which a header tells the place of a state's variance among the covariance words.

    Parameters
    ----------
    p : str
        The filter's C prefix.
    layout : CovarianceLayout
    state : str
    """
    return f"{p}_{layout.field}_{state}".upper()
