// MicroPython's prompt on file descriptors 0 and 1, as a board has it on USB: node prompt.mjs DIRECTORY
// What is installed into /flash is copied to DIRECTORY when the input ends.
import fs from 'node:fs';
import path from 'node:path';
import { loadMicroPython } from '../../sim/probe/wasm/node_modules/@micropython/micropython-webassembly-pyscript/micropython.mjs';

const RAW_PASTE = Buffer.from('\x05A\x01');
const say = (data) => {
  for (let at = 0; at < data.length; )
    try {
      at += fs.writeSync(1, data, at);
    } catch (error) {
      if (error.code !== 'EAGAIN') throw error;
    }
};
const mp = await loadMicroPython({ heapsize: 1 << 20, stdout: say, stderr: say, linebuffer: false });
mp.FS.mkdirTree('/flash/lib');
mp.runPython(`
import builtins
import os
import sys

sys.path[:] = ['', '/flash', '/flash/lib']
os.chdir('/flash')

# as on a board: 2 and not 44 is "no such file", and an empty path is the current directory
class Os: pass

def as_on_a_board(function):
    def call(path, *more):
        try:
            return function(path or '.', *more)
        except OSError as error:
            raise OSError(2 if error.errno == 44 else error.errno)
    return call

for name in dir(os):
    setattr(Os, name, getattr(os, name))
Os.stat = as_on_a_board(os.stat)
builtins.open = as_on_a_board(open)
sys.modules['os'] = Os
del Os, as_on_a_board, builtins, name, os
`);
mp.replInit();

function keep(from, to) {
  fs.mkdirSync(to, { recursive: true });
  for (const name of mp.FS.readdir(from)) {
    if (name === '.' || name === '..') continue;
    const place = `${from}/${name}`, copy = path.join(to, name);
    if (mp.FS.isDir(mp.FS.stat(place).mode)) keep(place, copy);
    else fs.writeFileSync(copy, mp.FS.readFile(place));
  }
}

const buffer = Buffer.alloc(4096);
for (;;) {
  let n;
  try {
    n = fs.readSync(0, buffer, 0, buffer.length, null);
  } catch (error) {
    if (error.code === 'EAGAIN') continue;
    if (error.code === 'EIO') n = 0;
    else throw error;
  }
  if (n === 0) break;
  for (let i = 0; i < n; i++) {
    // This port cannot wait for input in the middle of a program, as raw-paste mode does: say that it is not there.
    if (buffer.subarray(i, i + 3).equals(RAW_PASTE)) {
      say(Buffer.from('R\x00'));
      i += 2;
    } else mp.replProcessChar(buffer[i]);
  }
}
keep('/flash', process.argv[2]);
process.exit(0);
