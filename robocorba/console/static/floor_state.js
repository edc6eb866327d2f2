// The bodies and elevators of a floor, from binary frames.
const WORDS = ["number", "x", "y", "heading", "vx", "vy", "turn"];

// A floor as the last frames left it.
// Bodies by number: {number, kind, name, radius, outline, x, y, heading, vx, vy, turn}.
export class Floor {
  constructor(name) {
    this.name = name;
    this.clear();
  }

  clear() {
    this.bodies = new Map();
    this.elevators = {};
    this.time = 0;
    this.map = 0;
    this.receivedAt = 0;
  }

  apply(header, buffer, offset) {
    if (header.whole) this.clear();
    for (const number of header.went) this.bodies.delete(number);
    for (const body of header.came) {
      this.bodies.set(body.number, { ...body, x: 0, y: 0, heading: 0, vx: 0, vy: 0, turn: 0 });
    }
    Object.assign(this.elevators, header.elevators);
    const floats = new Float32Array(buffer, offset);
    const numbers = new Uint32Array(buffer, offset);
    for (let at = 0; at < floats.length; at += WORDS.length) {
      const body = this.bodies.get(numbers[at]);
      if (!body) continue;
      for (let word = 1; word < WORDS.length; word++) body[WORDS[word]] = floats[at + word];
    }
    this.time = header.time;
    this.map = header.map;
    this.receivedAt = performance.now();
  }

  body(name) {
    for (const body of this.bodies.values()) if (body.name === name) return body;
    return undefined;
  }
}

export function readFrame(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { header, offset: 4 + length };
}
