"""What the probe needs of a board; each module here is one.

A board has
    serial               8 bytes that no other board has
    boots                how often it has started (an int)
    ticks_us()           device time, modulo 2**30
    idle(us)             wait that long, or until a byte arrives
    read(buffer)         bytes from the host into buffer; how many (0: none). Never waits
    write(buffer, start, stop)
                         bytes to the host; how many the link took (0: none now). Never waits
    begin(), end()       a stream starts, stops (power up and down the analogue part)
    start_scan()         begin to measure all cells; the board does it beside everything else, if it can
    scanned()            True when they are measured
    scan(counts)         them, into geometry.FRAME_BYTES bytes, two counts of 12 bits in three
    position_um()        of the stroke, signed
    displacement_um()    of the probe into the tissue, signed
    the names of tables.FRAME_MORE()
                         what a frame tells besides, each a whole number below 2**30
    settings_record      where the settings are kept (safe_record.Record), or None

`read`, `write`, `start_scan`, `scanned`, `scan`, `position_um`, `displacement_um` and `ticks_us` run in the
frame path and allocate nothing.
"""
