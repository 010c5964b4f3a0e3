"""Flashing over links that lose bytes, are cut, or vanish."""

from dataclasses import replace

import pytest

from firmware_py import messages, status
from palpate.errors import FlashError, ImageRefused, PortMissing
from palpate.link.flash import flash
from palpate.link.probe import Probe
from palpate.link.transport import open_transport
from palpate.model_export.exporter import export
from palpate.sim.probe.faults import Faults
from tests.host.probes import connect


def test_flashing_gets_through_a_link_that_loses_one_byte_in_a_hundred(emulated, images):
    with connect(emulated(to_host=Faults(lose=0.01), to_device=Faults(lose=0.01), seed=3)) as probe:
        done = flash(probe, images[0])
        assert probe.identity.model_id == done.model_id  # a hash over all of it
        assert probe.counts.retries > 5


def test_a_probe_without_a_public_key_is_said_to_have_none(emulated, images, monkeypatch):
    """It was said to be built without flashing, which a board with the same firmware and a key is not."""
    with connect(emulated()) as probe:
        told = replace(probe.identity, model_status=status.NO_KEY, capabilities=frozenset())
        monkeypatch.setattr(Probe, "identity", told)
        with pytest.raises(ImageRefused, match=r"^no public key: .*palpate board DIRECTORY --key KEY"):
            flash(probe, images[0])


def test_flashing_goes_on_after_an_unplug_in_the_middle(emulated, images):
    device = emulated()
    with connect(device) as probe:
        cuts = iter((400, 1500))
        at = next(cuts)

        def progress(done, size):
            nonlocal at
            if done >= at:
                at = next(cuts, size + 1)
                device.unplug()

        done = flash(probe, images[0], progress)
        assert probe.identity.model_id == done.model_id
        assert probe.counts.reconnects == 2


def test_a_port_that_vanishes_while_flashing_and_stays_away_is_an_error_and_nothing_is_lost(
    emulated, images, monkeypatch
):
    from palpate.link import line

    monkeypatch.setattr(line, "AWAY_S", 0.5)
    device = emulated()

    def away():
        raise PortMissing(device.port, "the probe is in somebody's pocket")

    with Probe(open_transport(device.port), None, away) as probe:
        live = flash(probe, images[0]).model_id

        def vanish(done, size):
            if done > size // 2:
                device.unplug()

        with pytest.raises(FlashError, match=r"gone.*the model it had stays: plug it in and flash again"):
            flash(probe, images[1], vanish)
        assert not probe.connected
    with connect(device) as probe:
        assert probe.identity.model_id == live
        done = flash(probe, images[1])
        assert 0 < done.resumed_at < len(images[1]), "it goes on where it stopped"
        assert probe.identity.model_id == done.model_id != live


def test_another_image_of_the_same_size_is_not_mixed_with_one_that_was_broken_off(
    emulated, specs, images, key_dir
):
    class Enough(Exception):
        pass

    def enough(done, size):
        if done > size // 2:
            raise Enough

    other = export(specs[0], key_dir, counter=500)[0]  # the same model once more, signed anew
    assert len(other) == len(images[0]) and other != images[0]
    with connect(emulated()) as probe:
        with pytest.raises(Enough):
            flash(probe, images[0], enough)
        done = flash(probe, other)
        assert done.resumed_at == 0
        assert probe.read_back(messages.READ_MODEL) == other


def test_flashing_goes_on_through_a_cut_at_every_message(emulated, images, monkeypatch):
    device = emulated()
    with connect(device) as probe:
        cuts, send = 0, probe.command

        def cut_and_send(name, *fields, **words):
            nonlocal cuts
            if name.startswith("flash_"):
                device.unplug()
                cuts += 1
            return send(name, *fields, **words)

        monkeypatch.setattr(probe, "command", cut_and_send)
        done = flash(probe, images[0])
        print(f"{cuts} cuts while flashing {len(images[0])} bytes")
        assert cuts >= len(images[0]) // 48 + 3  # begin, every piece, verify, confirm
        assert probe.identity.model_id == done.model_id


def test_a_changed_image_is_refused_and_the_old_model_stays(emulated, images):
    with connect(emulated()) as probe:
        live = flash(probe, images[0]).model_id
        for at in (len(images[1]) // 2, len(images[1]) - 1):
            changed = bytearray(images[1])
            changed[at] ^= 4
            with pytest.raises(ImageRefused, match="the model it had stays"):
                flash(probe, bytes(changed))
            assert probe.refresh_identity().model_id == live
        assert flash(probe, images[1]).model_id != live
