"""`palpate view`: a page on localhost that shows what the probe feels, live or from a recording.

    source  -->  session  -->  mailbox (one for each page, bounded, newest wins)  -->  web socket  -->  page
    (probe or    (strokes, visits,                                                     <-- acknowledgements,
     recording)   recording)                                                               commands

A source runs in a thread of its own and tells `events`. The session keeps what a page that opens now must
know. A page is never waited for: what it cannot take is left out, except strokes and estimates.
"""
