"""python -m sim.probe.device CONFIG.json: the firmware under CPython."""

import sys

from sim.probe.device import hostport

hostport.configure(sys.argv[1])

from sim.probe.device import main  # noqa: E402  (the board reads the configuration when it is made)

main.main()
