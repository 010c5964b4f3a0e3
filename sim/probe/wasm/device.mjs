// The hardware of the emulated probe for MicroPython/WASM: node device.mjs CONFIG.json
//
// Link: file descriptors 0 (from the host) and 1 (to the host), both non-blocking. Errors: 2. Orders of the emulator
// (sim/probe/emulated.py): the one that the configuration names, a line each; its end means that the emulator is gone.
// Into a pipe that it names goes a byte when the firmware first listens.
// sim/probe/device/hostport.py is the same hardware for CPython.
import fs from 'node:fs';
import path from 'node:path';
import { loadMicroPython } from '@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { installFirmware } from './install.mjs';

const LINK_IN = 0, LINK_OUT = 1, ERRORS = 2;
const MASK = 2 ** 30 - 1;
const config = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const RECORD = config.record, COUNTS = RECORD - 8; // of the source: position_um, displacement_um (i32), packed counts

// The port does not export its memory; it is needed to move whole buffers at a time.
let memory = null;
for (const name of ['instantiate', 'instantiateStreaming']) {
  const original = WebAssembly[name];
  WebAssembly[name] = async (...args) => {
    const made = await original.apply(WebAssembly, args);
    memory = Object.values((made.instance ?? made).exports).find((e) => e instanceof WebAssembly.Memory) ?? memory;
    return made;
  };
}

const complain = (data) => fs.writeSync(ERRORS, data);
const mp = await loadMicroPython({ heapsize: config.heap, stdout: complain, stderr: complain, linebuffer: false });
const view = (address, n) => new Uint8Array(memory.buffer, address, n);
const bed = new Int32Array(new SharedArrayBuffer(4));
const nap = (ms) => Atomics.wait(bed, 0, 0, ms);

/** fs.readSync that gives 0 where nothing is there yet. */
function take(fd, buffer) {
  try {
    const n = fs.readSync(fd, buffer, 0, buffer.length, null);
    if (n === 0) process.exit(0);
    return n;
  } catch (error) {
    if (error.code === 'EAGAIN' || error.code === 'EIO') return 0;
    throw error;
  }
}

// ---- the source of sensor readings

let source = Buffer.alloc(0), cursor = 0, current = 0;
function load(file) {
  source = fs.readFileSync(file);
  cursor = 0;
}
if (config.source) load(config.source);

// ---- the store: files in a directory, cut off after a given number of bytes to simulate a loss of power

let powerLeft = config.power_bytes ?? Infinity;
const cut = () => process.kill(process.pid, 'SIGKILL');
const where = (name) => path.join(config.store, name);

function storeWrite(name, offset, address, n) {
  applyOrders(); // a cut that was ordered before this write must find it
  const data = Buffer.from(view(address, n)); // a copy: memory may move
  const whole = Math.min(n, powerLeft);
  try {
    const fd = fs.openSync(where(name), fs.constants.O_RDWR | fs.constants.O_CREAT, 0o644);
    try {
      fs.writeSync(fd, data, 0, whole, offset);
    } finally {
      fs.closeSync(fd);
    }
  } catch {
    return config.store_error;
  }
  powerLeft -= n;
  if (powerLeft <= 0) cut();
  return 0;
}

function storeRead(name, offset, address, n) {
  let fd;
  try {
    fd = fs.openSync(where(name), 'r');
  } catch {
    return 0;
  }
  const data = Buffer.alloc(n);
  const got = fs.readSync(fd, data, 0, n, offset);
  fs.closeSync(fd);
  view(address, got).set(data.subarray(0, got));
  return got;
}

// ---- the emulator's orders

const orderBytes = Buffer.alloc(4096);
let orderText = '', nextLook = 0;
function applyOrders() {
  orderText += orderBytes.toString('utf8', 0, take(config.orders, orderBytes));
  for (let end = orderText.indexOf('\n'); end >= 0; end = orderText.indexOf('\n')) {
    const [order, ...rest] = orderText.slice(0, end).split(' ');
    orderText = orderText.slice(end + 1);
    if (order === 'source') load(rest.join(' '));
    else if (order === 'power') powerLeft = Number(rest[0]);
  }
}

// ---- the link

function sayThatItListens() {
  if (config.listens === undefined) return;
  fs.writeSync(config.listens, '!');
  fs.closeSync(config.listens);
  delete config.listens;
}

const received = Buffer.alloc(4096);
let have = 0, at = 0;
function fill() {
  if (at < have) return true;
  at = 0;
  have = take(LINK_IN, received);
  return have > 0;
}

mp.registerJsModule('hostport', {
  read(address, n) {
    sayThatItListens();
    if (!fill()) return 0;
    const k = Math.min(n, have - at);
    view(address, k).set(received.subarray(at, at + k));
    at += k;
    return k;
  },
  write(address, start, stop) {
    try {
      return fs.writeSync(LINK_OUT, view(address + start, stop - start));
    } catch (error) {
      if (error.code === 'EAGAIN') return 0;
      if (error.code === 'EPIPE' || error.code === 'EIO') return 0;
      throw error;
    }
  },
  ticks_us: () => Math.floor(performance.now() * 1000) & MASK,
  idle(us) {
    const now = performance.now();
    if (now >= nextLook) {
      nextLook = now + 20;
      applyOrders();
    }
    const end = now + us / 1000;
    while (!fill() && performance.now() < end) nap(Math.min(1, Math.max(0.05, end - performance.now())));
  },
  begin() {
    applyOrders();
    cursor = 0;
  },
  end() {},
  scan(address) {
    view(address, COUNTS).set(source.subarray(current + 8, current + RECORD));
    cursor += RECORD;
    if (cursor >= source.length) cursor = config.repeat ? 0 : source.length - RECORD;
  },
  position_um() {
    current = cursor;
    return source.readInt32LE(current);
  },
  displacement_um: () => source.readInt32LE(current + 4),
  serial_byte: (i) => config.serial[i],
  boots: () => config.boots,
  key_byte: (i) => config.public_key?.[i] ?? -1,
  store_size(name) {
    try {
      return fs.statSync(where(name)).size;
    } catch {
      return -1;
    }
  },
  store_read: storeRead,
  store_write: storeWrite,
  store_sync: () => 0,
  store_remove(name) {
    fs.rmSync(where(name), { force: true });
    return 0;
  },
});

// ---- the program

installFirmware(mp, config);
for (const name of config.programs) mp.FS.writeFile(`/flash/${path.basename(name)}`, fs.readFileSync(name));

try {
  mp.runPython(`import sys\nsys.path.insert(0, '/flash')\nimport ${config.main}\n${config.main}.main()`);
} catch (error) {
  complain(Buffer.from(`${error.message ?? error}\n`.slice(0, 4000)));
  process.exit(1);
}
process.exit(0);
