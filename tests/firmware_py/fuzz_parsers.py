"""Guided fuzzing of both ends' parsers: python -m tests.firmware_py.fuzz_parsers [libFuzzer's words].

Each input is a stream of bytes. It goes, in pieces, to the packet layer in both builds (which must
agree), to the message layer, to a whole probe that is streaming, and to the host's parser. Whatever
comes must neither raise nor hang, and an intact packet behind it must arrive.
"""

import sys

import atheris

with atheris.instrument_imports(include=["firmware_py", "palpate.link"]):
    from firmware_py import commands, counters, messages, outbox, probe, wire
    from palpate.sim.probe.virtual import VirtualProbe
    from palpate.wire.parser import LiveParser

from tests.firmware_py.talk import ByteReceiver, Ears, command, packet, receive

STILL = packet(b"\x7f still here")


def one_input(data: bytes) -> None:
    blocks, plain = wire.Receiver(messages.FRAME_BODY), ByteReceiver(messages.FRAME_BODY)
    got = receive(blocks, data + STILL)
    assert got == receive(plain, data + STILL)
    assert got[-1] == b"\x7f still here"
    for body in got:
        messages.unpack(bytearray(body), len(body))
    # the same bytes as bodies of valid packets, so that the fuzzer gets behind the checksum
    bodies = [body for body in data.split(b"\xfe") if 0 < len(body) <= messages.COMMAND_BODY]
    for body in bodies:
        messages.unpack(bytearray(body), len(body))
    device = VirtualProbe()
    device.send(command("stream_start", 1, (messages.CONTENT_FRAMES, 1, 0, 0)))
    device.send(data)
    for body in bodies[:20]:
        device.send(packet(body))
    device.send(b"\0" + command("identify", 0xABCD, (77,)))
    said = []
    ears = Ears()
    for _ in range(40):
        device.run(20_000)
        said += ears.hear(device.take())
        if said and any(m.name == "identify" and m.number == 0xABCD for m in said):
            break
    else:
        raise AssertionError("the probe does not answer any more")
    host = LiveParser()
    for _ in host.feed(data + b"\0", 0):
        pass
    for body in bodies:
        for _ in host.feed(packet(body), 0):
            pass


def main() -> None:
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    assert commands and counters and outbox and probe
    main()
