// Runs one script in MicroPython/WASM: node micropython.mjs CONFIG.json; its output goes to stdout.
// CONFIG: firmware (directory), files (path in the interpreter -> path on the host), script (path), heap (bytes),
// turns: how often the script's function turn() is called after it. Only between calls is the heap cleared here.
import fs from 'node:fs';
import path from 'node:path';
import { loadMicroPython } from '../sim/probe/wasm/node_modules/@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { installFirmware } from '../sim/probe/wasm/install.mjs';

const config = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const say = (fd) => (data) => {
  for (let at = 0; at < data.length; )
    try {
      at += fs.writeSync(fd, data, at);
    } catch (error) {
      if (error.code !== 'EAGAIN') throw error;
    }
};
const mp = await loadMicroPython({ heapsize: config.heap, stdout: say(1), stderr: say(2), linebuffer: false });
installFirmware(mp, config);
for (const [name, from] of Object.entries(config.files)) {
  mp.FS.mkdirTree(path.posix.dirname(path.posix.join('/flash', name)));
  mp.FS.writeFile(path.posix.join('/flash', name), fs.readFileSync(from));
}
// An error that leaves a script with the heap still locked is told here: the interpreter itself would hang for ever.
const guarded = `
def _run(source):
    def locked():
        try:
            bytearray(1)
        except MemoryError:
            return True
        return False
    from micropython import heap_unlock
    code = compile(source, 'script.py', 'exec')
    told = 'memory was asked for while the heap was locked, if only to tell of an error'
    try:
        exec(code, globals())
    except BaseException as error:
        if not locked():
            raise
        depth = 0
        while depth < 9 and locked():
            heap_unlock()
            depth += 1
        raise MemoryError(told) if isinstance(error, MemoryError) else error
`;
try {
  mp.runPython(`import sys\nsys.path.insert(0, '/flash')\nimport os\nos.chdir('/flash')\n`);
  mp.runPython(guarded);
  mp.globals.get('_run')(fs.readFileSync(config.script, 'utf8'));
  for (let k = 0; k < config.turns; k++) {
    mp.runPython('import gc\ngc.collect()');
    mp.runPython('turn()');
  }
} catch (error) {
  say(2)(Buffer.from(`${error.message ?? error}\n`.slice(0, 8000)));
  process.exit(1);
}
process.exit(0);
