"""Other people's tactile arrays, read live: a source turns their bytes into images, the rest is Palpate.

Each source is an `ArrayLine`, found by its scheme (`palpate.link.schemes`). Behind it the firmware runs here
(`bridge`): stream, recording, page and `palpate doctor` see a probe without model, place and depth.
"""
