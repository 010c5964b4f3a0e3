"""python -m palpate.sim.probe.device CONFIG.json: the firmware under CPython."""

import sys

from palpate.sim.probe.device import hostport

hostport.configure(sys.argv[1])

from palpate.sim.probe.device import main  # noqa: E402  (the board reads the configuration when it is made)

main.main()
