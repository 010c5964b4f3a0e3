"""The client of docs/howto/client.md that depends on nothing of ours: through a disconnect it goes on."""

import re
import subprocess
import sys
import time

from palpate.link import emulator_model as emulator
from tests.docs.blocks import DOCS
from tests.host.probes import connect
from tests.waiting import PATIENCE_S, wait_until


def test_it_goes_on_after_a_disconnect_and_acknowledges(emulated, tmp_path):
    """It spun for ever at the first empty read."""
    text = (DOCS / "howto" / "client.md").read_text()
    (program,) = [b for b in re.findall(r"```python\n(.*?)```", text, re.S) if "def unstuffed" in b]
    device = emulated(listen="tcp:127.0.0.1:0", public_key=emulator.public_key(), model=emulator.image())
    with connect(device) as probe:
        probe.set_setting("frame_rate", 20_000)
    port = device.port.rpartition(":")[2]
    path = tmp_path / "client.py"
    path.write_text(program.replace("17624", port))
    sent = device.relay.bytes_to_host
    client = subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: device.relay.bytes_to_host > sent + 5000, "frames")
        device.unplug()
        time.sleep(0.2)
        out = client.communicate(timeout=PATIENCE_S)[0]
    finally:
        client.kill()
    assert client.returncode == 0
    assert "stroke 1: status 0" in out
    with connect(device) as probe:
        told = probe.statistics()
        assert told["strokes"] == 1, "the stroke that was under way went on"
        assert told["estimates_acknowledged"] == 1
