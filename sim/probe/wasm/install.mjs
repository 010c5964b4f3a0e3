// Copies the firmware's Python files, and the array's description, into MicroPython's file system.
import fs from 'node:fs';
import path from 'node:path';

export function installFirmware(mp, config) {
  install(mp, config.firmware, '/flash/firmware_py');
  mp.FS.writeFile('/flash/firmware_py/sensor_array.py', fs.readFileSync(config.array));
}

export function install(mp, from, to) {
  mp.FS.mkdirTree(to);
  for (const entry of fs.readdirSync(from, { withFileTypes: true })) {
    const name = path.join(from, entry.name);
    if (entry.isDirectory() && entry.name !== '__pycache__') install(mp, name, `${to}/${entry.name}`);
    else if (entry.name.endsWith('.py')) mp.FS.writeFile(`${to}/${entry.name}`, fs.readFileSync(name));
  }
}
