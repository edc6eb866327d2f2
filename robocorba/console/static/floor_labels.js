// The names on a floor: of robots, objects, elevators and areas, where there is room for them.
import { FloorView } from "/static/floor_view.js";
import { LabelPlacer, around } from "/static/label_placement.js";
import { middleOf } from "/static/segments.js";
import { shortened } from "/static/texts.js";

const LABEL_FONT = "12px system-ui, sans-serif";
const LABEL_PX = 14;
// Pictures of labels that are kept.
const MAX_SPRITES = 600;

export class LabelledView extends FloorView {
  constructor(canvas, handlers) {
    super(canvas, handlers);
    this.context = canvas.getContext("2d");
    this.labels = new LabelPlacer();
    this.sprites = new Map();
    // Of a robot: {color, note, noteColor}, a colour other than its usual one, and words to its name. All may be missing.
    this.describe = () => ({});
    this.selected = "";
  }

  // Robots always have their names; objects and areas where there is room.
  drawNames() {
    const isVisible = (body) => this.isVisible(...this.pixel(body.x, body.y));
    const bodies = [...(this.floor?.bodies.values() ?? [])].filter(isVisible);
    const robots = bodies.filter((body) => body.kind !== "object");
    for (const body of robots) {
      const size = 2 * body.radius * this.scale;
      this.labels.block(...this.pixel(body.x, body.y), size, size);
    }
    robots.sort((a, b) => (b.name === this.selected) - (a.name === this.selected));
    for (const body of robots) {
      const { note, noteColor } = this.describe(body);
      const isBold = body.name === this.selected;
      this.drawLabel(body.number, shortened(body.name, 20), body, { note, noteColor, isBold, mustShow: true });
    }
    for (const body of bodies) if (body.kind === "object") this.drawLabel(body.number, shortened(body.name, 20), body);
  }

  // What is large has its name where the others have left room.
  drawAreaNames() {
    for (const elevator of this.plan.elevators) this.drawAreaName(this.elevatorText(elevator), elevator.at);
    for (const area of this.plan.areas) this.drawAreaName(shortened(area.name, 24), middleOf(area.polygon));
  }

  // An elevator's name, where its cabin is and how many wait; or that it does not stop on this floor.
  elevatorText({ name, floors }) {
    if (!floors.includes(this.plan.name)) return `${shortened(name, 16)}, no stop here`;
    const state = this.floor?.elevators[name];
    const text = shortened(name, 16);
    if (!state) return text;
    const where = state.cabin === this.plan.name ? "" : state.cabin ? ` at ${shortened(state.cabin, 8)}` : " moving";
    return `${text}${where}${state.queue.length ? `, ${state.queue.length} waiting` : ""}`;
  }

  // A name beside a disc {x, y, radius} of the floor.
  drawLabel(key, text, disc, { note = "", noteColor, color, isBold = false, mustShow = false, isWithin = false } = {}) {
    const { context, colors } = this;
    context.font = isBold ? `bold ${LABEL_FONT}` : LABEL_FONT;
    const lines = note ? [text, note] : [text];
    const width = Math.max(...lines.map((line) => this.labels.width(context, line))) + 4;
    const height = LABEL_PX * lines.length;
    const [px, py] = this.pixel(disc.x, disc.y);
    const offers = [...isWithin ? [[px, py]] : [], ...around(px, py, disc.radius * this.scale, width, height)];
    const place = this.labels.place(key, offers, width, height, mustShow);
    if (!place) return;
    lines.forEach((line, index) => {
      const y = place[1] - height / 2 + LABEL_PX * (index + 0.5);
      this.drawText(line, place[0], y, index ? noteColor ?? colors.collision : color ?? colors.text);
    });
  }

  drawAreaName(text, at) {
    const { context, colors } = this;
    context.font = LABEL_FONT;
    const [px, py] = this.pixel(...at);
    if (!this.isVisible(px, py)) return;
    const offers = [0, 1, -1, 2, -2].map((lines) => [px, py + lines * LABEL_PX]);
    const place = this.labels.place(`area ${text}`, offers, this.labels.width(context, text) + 4, LABEL_PX);
    if (place) this.drawText(text, ...place, colors.area);
  }

  // A line of text in the context's font, with a halo. Letters with a halo are slow to draw, so pictures of them are kept.
  drawText(text, px, py, color) {
    const { context, colors, sprites } = this;
    const ratio = this.canvas.width / this.width;
    const key = `${context.font}\n${color}\n${colors.ground}\n${ratio}\n${text}`;
    let sprite = sprites.get(key);
    if (!sprite) {
      if (sprites.size >= MAX_SPRITES) sprites.clear();
      sprite = textSprite(text, context.font, this.labels.width(context, text), color, colors.ground, ratio);
      sprites.set(key, sprite);
    }
    const [width, height] = [sprite.width / ratio, sprite.height / ratio];
    const sharp = (pixels) => Math.round(pixels * ratio) / ratio;
    context.drawImage(sprite, sharp(px - width / 2), sharp(py - height / 2), width, height);
  }
}

function textSprite(text, font, width, color, halo, ratio) {
  const sprite = document.createElement("canvas");
  sprite.width = Math.ceil((width + 6) * ratio);
  sprite.height = Math.ceil((LABEL_PX + 8) * ratio);
  const context = sprite.getContext("2d");
  context.scale(ratio, ratio);
  Object.assign(context, { font, textAlign: "center", textBaseline: "middle", lineJoin: "round", lineWidth: 3 });
  context.strokeStyle = halo;
  context.fillStyle = color;
  context.strokeText(text, sprite.width / ratio / 2, sprite.height / ratio / 2);
  context.fillText(text, sprite.width / ratio / 2, sprite.height / ratio / 2);
  return sprite;
}
