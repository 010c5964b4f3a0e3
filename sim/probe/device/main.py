"""The emulated probe's program: `firmware_py` on the emulated board. Both interpreters run it."""

from firmware_py import probe

try:
    import emulated_board
except ImportError:
    from palpate.sim.probe.device import emulated_board


def main():
    """Serve forever."""
    board = emulated_board.EmulatedBoard()
    probe.run(board, emulated_board.estimator_of(board))
