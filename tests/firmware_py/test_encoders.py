"""The encoder's two drivers: by PIO, whose program runs cycle by cycle, and by the pins' interrupts."""

import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.sim.probe import pico, pio

KINDS = ("pio", "interrupts")


def made(kind: str, circuit: pico.Circuit, **words):
    """An encoder of 25 um a step on the circuit's pins; within `pico.installed`."""
    from machine import Pin

    a, b = Pin(10, Pin.IN, Pin.PULL_UP), Pin(11, Pin.IN, Pin.PULL_UP)
    if kind == "pio":
        from firmware_py.boards import pio_encoder

        return pio_encoder.PioEncoder(a, b, 25, **words)
    from firmware_py.boards import encoder

    return encoder.Encoder(a, b, 25, **words)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 3), st.lists(st.integers(-300, 300), max_size=10))
def test_it_follows_every_turn_wherever_it_began(kind, began, turns):
    circuit = pico.Circuit()
    pico.turn(circuit, began)
    with pico.installed(circuit):
        one = made(kind, circuit)
        at = 0
        for steps in turns:
            pico.turn(circuit, steps)
            circuit.wait_us(12)
            at += steps
            assert one.position_um() == 25 * at
        assert one.missed == 0
        one.zero()
        assert one.position_um() == 0
        pico.turn(circuit, -3)
        circuit.wait_us(12)
        assert one.position_um() == -75


@pytest.mark.parametrize("kind", KINDS)
def test_what_changed_twice_between_two_looks_is_counted_as_missed(kind):
    circuit = pico.Circuit()
    with pico.installed(circuit):
        one = made(kind, circuit)
        pico.turn(circuit, 1, interrupt=False, step_us=0)
        pico.turn(circuit, 1, step_us=0)
        circuit.wait_us(30)
        one.position_um()
        assert one.missed == 1


@pytest.mark.parametrize("step_us", [250, 40, 12])
def test_pio_counts_at_any_speed_while_nobody_looks(step_us):
    """100 mm/s is an edge every 250 us. Ten thousand edges in one go, and the position is asked for once."""
    circuit = pico.Circuit()
    with pico.installed(circuit):
        one = made("pio", circuit)
        pico.turn(circuit, 10_000, step_us=step_us)
        pico.turn(circuit, -3_000, step_us=step_us)
        circuit.wait_us(12)
        assert one.position_um() == 25 * 7_000
        assert one.missed == 0


def test_pio_says_so_where_edges_come_faster_than_it_looks():
    circuit = pico.Circuit()
    with pico.installed(circuit):
        one = made("pio", circuit)
        pico.turn(circuit, 2_000, step_us=4)
        circuit.wait_us(12)
        assert one.position_um() != 25 * 2_000
        assert one.missed > 100


def test_a_reading_is_new_however_long_the_queue_was_full():
    circuit = pico.Circuit()
    with pico.installed(circuit):
        one = made("pio", circuit)
        circuit.wait_us(50_000)
        assert circuit.machines[0].rx_fifo() == pio.FIFO
        pico.turn(circuit, 7)
        circuit.wait_us(12)
        before = circuit.clock.us
        assert one.position_um() == 175
        assert circuit.clock.us - before < 30, "one turn of the program, not more"


def test_the_count_goes_through_the_wrap_of_its_sixteen_bits():
    circuit = pico.Circuit()
    with pico.installed(circuit):
        one = made("pio", circuit)
        for at in range(30_000, 150_001, 30_000):
            pico.turn(circuit, 30_000, step_us=12)
            circuit.wait_us(12)
            assert one.position_um() == 25 * at


def test_the_program_is_the_machine_words_that_the_data_sheet_has_for_it():
    """Encodings by hand from section 3.4 of the RP2040's data sheet; all 32 places, so that it lies at 0."""
    circuit = pico.Circuit()
    with pico.installed(circuit):
        from firmware_py.boards import pio_encoder

        program = pio_encoder.quarter_steps
    tell, up, down, lost = 23, 18, 22, 16
    table = [tell, up, down, lost, down, tell, lost, up, up, lost, tell, down, lost, down, up, tell]
    rest = [0xC010, tell, 0xA04A, 0x0080 | 20, 0xA04A, tell, 0x0080 | tell]
    assert program == [*table, *rest, 0xA0C2, 0x8000, 0x4022, 0x4002, 0xA026, 0xA0A6, *[0xA042] * 3]
    assert len(program) == pio.MEMORY


def test_a_program_that_is_not_at_address_0_would_not_count():
    """Why the program fills the block: the emulation puts shorter ones higher, as the real one does."""
    circuit = pico.Circuit()
    with pico.installed(circuit):
        from firmware_py.boards import pio_encoder

        del pio_encoder.quarter_steps[-1]
        one = made("pio", circuit)
        pico.turn(circuit, 50)
        with pytest.raises(TimeoutError):
            one.position_um()


def test_where_the_block_has_no_room_the_pins_interrupts_count(monkeypatch):
    circuit = pico.Circuit()
    with pico.installed(circuit):
        from machine import Pin

        from firmware_py.boards import encoder, pio_encoder

        a, b = Pin(10), Pin(11)
        assert isinstance(pio_encoder.best(a, b, 25), pio_encoder.PioEncoder)

        def full(*_, **__):
            raise OSError(12, "ENOMEM")

        monkeypatch.setattr(sys.modules["rp2"], "StateMachine", full)
        one = pio_encoder.best(a, b, 25)
        assert isinstance(one, encoder.Encoder)
        pico.turn(circuit, 4)
        assert one.position_um() == 100
