// Draws what of a floor stands still: rooms, walls, doors, objects and roads, with grid and scale.
import { addLine, addPolygon, disc, line } from "/static/canvas_shapes.js";

export function drawPlan(context, canvas) {
  const { colors, paths, plan } = canvas;
  context.lineJoin = "round";
  context.lineCap = "round";
  context.fillStyle = colors.ground;
  context.fill(paths.ground);
  drawUnderlay(context, canvas);
  drawGrid(context, canvas);
  context.globalAlpha = 0.08;
  context.fillStyle = colors.area;
  context.fill(paths.areas);
  context.globalAlpha = 0.6;
  context.strokeStyle = colors.area;
  context.setLineDash([canvas.px(5), canvas.px(4)]);
  context.lineWidth = canvas.px(1);
  context.stroke(paths.areas);
  context.setLineDash([]);
  context.globalAlpha = 1;
  context.fillStyle = colors.shaft;
  context.fill(paths.shafts);
  context.fillStyle = context.strokeStyle = colors.object;
  context.lineWidth = canvas.px(2);
  context.fill(paths.fixed, "evenodd");
  context.stroke(paths.fixed);
  if (!canvas.floor) {
    context.fillStyle = context.strokeStyle = colors.movable;
    context.fill(paths.movable);
    context.stroke(paths.movable);
  }
  if (canvas.isShownRoadmap) {
    context.strokeStyle = colors.edge;
    context.lineWidth = canvas.px(1.5);
    context.stroke(paths.edges);
    context.fillStyle = colors.node;
    for (const node of plan.nodes) disc(context, node.at[0], node.at[1], canvas.px(3.5));
  }
  context.strokeStyle = colors.wall;
  context.lineWidth = Math.max(canvas.px(2), 0.06);
  context.stroke(paths.walls);
  for (const door of plan.doors) {
    context.strokeStyle = door.locked ? colors.locked : colors.door;
    context.lineWidth = canvas.px(door.kind === "opening" ? 1 : 3);
    if (door.kind === "opening") context.setLineDash([canvas.px(4), canvas.px(4)]);
    line(context, door.a, door.b);
    context.setLineDash([]);
  }
}

function drawUnderlay(context, { underlay }) {
  if (!underlay?.image) return;
  const { image, x, y, resolution } = underlay;
  context.save();
  context.globalAlpha = 0.45;
  context.translate(x, y + image.height * resolution);
  context.scale(resolution, -resolution);
  context.drawImage(image, 0, 0);
  context.restore();
}

function drawGrid(context, canvas) {
  const { colors } = canvas;
  const step = gridStep(canvas.scale);
  const [x0, y1] = canvas.world(0, 0);
  const [x1, y0] = canvas.world(canvas.width, canvas.height);
  context.beginPath();
  for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) {
    context.moveTo(x, y0);
    context.lineTo(x, y1);
  }
  for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) {
    context.moveTo(x0, y);
    context.lineTo(x1, y);
  }
  context.strokeStyle = colors.grid;
  context.lineWidth = canvas.px(1);
  context.stroke();
}

export function drawScaleBar(context, canvas) {
  const { colors } = canvas;
  const step = gridStep(canvas.scale);
  const length = step * canvas.scale;
  context.strokeStyle = context.fillStyle = colors.text;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(12, canvas.height - 12);
  context.lineTo(12 + length, canvas.height - 12);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(step < 1 ? `${Math.round(step * 100)} cm` : `${step} m`, 12, canvas.height - 15);
}

// The shapes of a plan, made once.
export function planPaths(plan) {
  const paths = {
    ground: new Path2D(), areas: new Path2D(), shafts: new Path2D(), fixed: new Path2D(), movable: new Path2D(),
    edges: new Path2D(), walls: new Path2D(),
  };
  const [x0, y0, x1, y1] = plan.bounds;
  addPolygon(paths.ground, plan.outline.length ? plan.outline : [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]);
  for (const area of plan.areas) addPolygon(paths.areas, area.polygon);
  for (const elevator of plan.elevators) addPolygon(paths.shafts, elevator.polygon);
  for (const object of plan.objects) addPolygon(object.movable ? paths.movable : paths.fixed, object.polygon);
  for (const edge of plan.edges) addLine(paths.edges, edge.a, edge.b);
  const pieces = plan.walls.flatMap((wall) => wall.pieces);
  for (const piece of pieces) addLine(paths.walls, piece[0], piece[piece.length - 1]);
  if (plan.outline.length) addPolygon(paths.walls, plan.outline);
  for (const elevator of plan.elevators) addPolygon(paths.walls, elevator.polygon);
  return paths;
}

// Distance of grid lines [m]: 1, 2 or 5 times a power of ten, at least 40 pixels.
function gridStep(scale) {
  const least = 40 / scale;
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= least);
}
