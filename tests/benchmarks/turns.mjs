// Times functions of a script in MicroPython/WASM: node turns.mjs CONFIG.json (as tests/micropython.mjs, and `turns`).
// The script defines NAMES and turn(name). This port collects garbage only between two calls from outside, so every
// turn is such a call, with the collection of what it left behind in its time. Prints name -> microseconds of CPU of
// the best turn; names take turns, so that what else the machine does meets all of them.
import fs from 'node:fs';
import { loadMicroPython } from '../../sim/probe/wasm/node_modules/@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { install } from '../../sim/probe/wasm/install.mjs';

const config = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const mp = await loadMicroPython({ heapsize: config.heap, stdout: console.log, stderr: console.error });
install(mp, config.firmware, '/flash/firmware_py');
for (const [name, from] of Object.entries(config.files)) mp.FS.writeFile(`/flash/${name}`, fs.readFileSync(from));
try {
  mp.runPython(`import sys\nsys.path.insert(0, '/flash')\nimport os\nos.chdir('/flash')\n`);
  mp.runPython(fs.readFileSync(config.script, 'utf8'));
  const names = mp.globals.get('NAMES').split(' ');
  const best = {};
  for (let k = 0; k < config.turns; k++)
    for (const name of names) {
      const before = process.cpuUsage();
      mp.runPython(`turn('${name}')`);
      const spent = process.cpuUsage(before);
      best[name] = Math.min(best[name] ?? Infinity, spent.user + spent.system);
    }
  console.log(JSON.stringify(best));
} catch (error) {
  console.error(`${error.message ?? error}`);
  process.exit(1);
}
process.exit(0);
