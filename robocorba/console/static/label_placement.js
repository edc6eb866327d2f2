// Places labels on a canvas so that they cover neither each other nor the bodies that they name.

const MAX_WIDTHS = 2000;

export class LabelPlacer {
  constructor() {
    this.widths = new Map();
    // Place that each label had in the last picture, so that labels do not hop while there is room.
    this.before = new Map();
  }

  // A new picture of this size, with boxes [x0, y0, x1, y1] that are covered [px].
  begin(width, height, covered = []) {
    [this.pictureWidth, this.pictureHeight] = [width, height];
    this.taken = [...covered];
    this.now = new Map();
  }

  end() {
    this.before = this.now;
  }

  // Width of a text [px] in the font that the context has.
  width(context, text) {
    const key = `${context.font}\n${text}`;
    if (!this.widths.has(key)) {
      if (this.widths.size > MAX_WIDTHS) this.widths.clear();
      this.widths.set(key, context.measureText(text).width);
    }
    return this.widths.get(key);
  }

  // Keep a box free of labels: its middle and its size [px].
  block(px, py, width, height) {
    this.taken.push([px - width / 2, py - height / 2, px + width / 2, py + height / 2]);
  }

  // Middle [px] for a label of this size at one of the offered middles; undefined if all are taken, unless it must be
  // shown.
  place(key, offers, width, height, mustShow = false) {
    const first = this.before.get(key) ?? 0;
    const order = [...new Set([first, ...offers.keys()])].filter((index) => index < offers.length);
    const free = order.find((index) => this.isFree(...offers[index], width, height));
    if (free === undefined && !mustShow) return undefined;
    const chosen = free ?? 0;
    this.now.set(key, chosen);
    this.block(...offers[chosen], width, height);
    return offers[chosen];
  }

  isFree(px, py, width, height) {
    const x0 = px - width / 2, y0 = py - height / 2, x1 = px + width / 2, y1 = py + height / 2;
    if (x0 < 0 || y0 < 0 || x1 > this.pictureWidth || y1 > this.pictureHeight) return false;
    return !this.taken.some((box) => x0 < box[2] && x1 > box[0] && y0 < box[3] && y1 > box[1]);
  }
}

// Middles for a label around a disc: above, below, right, left, and beside these.
export function around(px, py, radius, width, height) {
  const gap = 3;
  const up = radius + gap + height / 2, side = radius + gap + width / 2;
  return [
    [px, py - up], [px, py + up], [px + side, py], [px - side, py],
    [px + width / 2, py - up], [px - width / 2, py - up], [px + width / 2, py + up], [px - width / 2, py + up],
    [px, py - up - height], [px, py + up + height],
  ];
}
