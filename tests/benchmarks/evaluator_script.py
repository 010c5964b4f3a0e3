"""What runs on MicroPython in the evaluator's benchmark: the contenders (SETUP), a check of them (CHECK)."""

SETUP = """
import gc, json, micropython, sys
from array import array
from firmware_py import calib, evaluator, features, signature, model_image, pipeline
import plain, palpate_model, palpate_values
try:
    import generated
except ImportError:
    generated = None

data = open('model.palp', 'rb').read()
read = lambda at, n: data[at:at + n]
key = open('public.key', 'rb').read()
body = len(data) - signature.size(key)
code, model = model_image.load(read, body, features.FEATURES_VERSION, features.COUNT)
assert code == 0
rows = json.loads(open('vectors.json').read())
full = []
for row in rows:
    x = array('i', [0] * features.COUNT)
    for i, v in zip(model.tables.ids, row):
        x[i] = v
    full.append(x)
short = [array('i', row) for row in rows]
out = array('i', [0] * evaluator.OUT_SIZE)
probe = pipeline.Pipeline(calib.Calibration())

def nothing():
    pass

def ours():
    for x in full:
        model.evaluate(x, out)

def ours_values():
    t = model.tables
    h = t.head
    for x in full:
        evaluator.standardise(x, t.ids, t.feats, h, t.u, t.part, t.high)
        evaluator.predict(t.c, t.d, t.own, t.steps, t.rows, t.outs, h, t.u, t.part, t.high, t.work, out)

def emitted():
    for x in short:
        palpate_model.estimate(x, out)

def emitted_values():
    for x in short:
        palpate_values.values(x, out)

def plain_whole():
    for x in short:
        plain.whole(x)

def m2cgen_values():
    for x in short:
        generated.values(x)

def m2cgen_whole():
    for x in short:
        generated.estimate(x)

def verify():
    assert signature.verify(key, read, len(data)) == 0

runs = {'ours': ours, 'values': ours_values, 'emitted': emitted, 'emitted values': emitted_values}
runs['float'] = plain_whole
runs['nothing'] = nothing
runs['verify'] = verify
if generated:
    runs['m2cgen'] = m2cgen_whole
    runs['m2cgen values'] = m2cgen_values
NAMES = ' '.join(name.replace(' ', '_') for name in runs)
left = 0

def turn(name):
    global left
    before = gc.mem_alloc()
    runs[name.replace('_', ' ')]()
    left += gc.mem_alloc() - before
    if left > 65536:
        left = 0
        gc.collect()
"""

CHECK = (
    SETUP
    + """
allocated = {}
for name in runs:
    runs[name]()
    before = gc.mem_alloc()
    runs[name]()
    allocated[name] = (gc.mem_alloc() - before) // len(rows)
for x in full:
    micropython.heap_lock()
    model.evaluate(x, out)
    micropython.heap_unlock()
apart = 0.0
if generated:
    for x, y in zip(short, full):
        code = model.evaluate(y, out)
        for j, v in enumerate(generated.estimate(x)[: 0 if code else evaluator.FLAGS]):  # no lump: zeros
            apart = max(apart, abs(out[j] / 1e6 - v) / max(abs(v), .1))
print(json.dumps([allocated, apart]))
"""
)
