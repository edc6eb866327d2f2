// Rays of laser and proximity sensors in a 3D scene: a fan for each scan, with an outline if the sensor is an actual
// robot's own, and points where rays hit something.
import { COLORS } from "/static/floor_colors.js";
import { areaRanges, hasAreas, rayEnds } from "/static/sensor_views.js";
import { THREE } from "nicegui-scene";

// Colours of fans and hits by the sensor's name; others have the third one. Those of the light page are seen on both.
const { laser, proximity, lost: other, unmapped } = COLORS.light;
const KINDS = { laser, proximity, other };
// Half the angle of a beam that stands for a single ray [rad].
const BEAM_RAD = 0.06;
// Rays drawn at most; those of other scans are left out.
const MOST_RAYS = 6000;

export class RayFans {
  constructor(view, shape) {
    this.view = view;
    // Heights of the sensors above the floor, as in the robot's model.
    const height = (name) => heightOf(shape.model, name);
    this.heights = { laser: height("laser"), proximity: height("proximity_1"), other: height("laser") };
    const glass = { vertexColors: true, transparent: true, opacity: 0.2, side: THREE.DoubleSide, depthWrite: false };
    this.fans = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial(glass));
    const points = new THREE.PointsMaterial({ vertexColors: true, size: 0.06 });
    this.hits = new THREE.Points(new THREE.BufferGeometry(), points);
    const lines = new THREE.LineBasicMaterial({ vertexColors: true });
    this.outlines = new THREE.LineSegments(new THREE.BufferGeometry(), lines);
    for (const mesh of [this.fans, this.hits, this.outlines]) {
      mesh.frustumCulled = false;
      view.scene.add(mesh);
    }
  }

  // scans: as live.scansOn() has them, each with the height `z` of its floor. selected: a robot, or empty.
  set(scans, selected) {
    // Most robots rest: nothing is drawn again then.
    const drawn = scans.map(({ key, pose, ranges, hits, z }) => [key, pose, ranges, hits, z]);
    const seen = JSON.stringify([selected, drawn]);
    if (seen === this.seen) return;
    this.seen = seen;
    const [fan, hit, outline] = [0, 1, 2].map(() => ({ positions: [], colors: [] }));
    const hasArea = hasAreas(scans, selected);
    let rays = 0;
    for (const scan of scans) {
      rays += scan.ranges.length;
      if (rays > MOST_RAYS) break;
      this.add(scan, hasArea(scan), fan, hit, outline);
    }
    for (const [mesh, { positions, colors }] of [[this.fans, fan], [this.hits, hit], [this.outlines, outline]]) {
      mesh.geometry.dispose();
      mesh.geometry = new THREE.BufferGeometry();
      mesh.geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
      mesh.geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
    }
    this.view.redraw();
  }

  add(scan, hasArea, fan, hit, outline) {
    const kind = scan.sensor in KINDS ? scan.sensor : "other";
    const color = new THREE.Color(KINDS[kind]).toArray(), strange = new THREE.Color(unmapped).toArray();
    const z = scan.z + this.heights[kind];
    const { angles, ranges, rim } = scan, at = rayEnds(scan);
    const end = (k, range) => [...at(k, range), z];
    // Rays far apart, such as those of eight proximity sensors, are narrow beams of their own.
    const isWide = Math.abs(angles.step) < 0.2;
    ranges.forEach((range, k) => {
      if (!scan.hits[k]) return;
      hit.positions.push(...end(k, range));
      hit.colors.push(...(scan.hits[k] === 2 ? strange : color));
    });
    const area = hasArea ? areaRanges(scan) : [];
    area.forEach((range, k) => {
      const next = k + 1;
      if (isWide && next < area.length) {
        fan.positions.push(...end(k, rim), ...end(k, range), ...end(next, area[next]));
        if (!scan.virtual) outline.positions.push(...end(k, range), ...end(next, area[next]));
      } else if (!isWide) {
        const half = BEAM_RAD / angles.step;
        fan.positions.push(...end(k, rim), ...end(k - half, range), ...end(k + half, range));
      }
      const isSide = !isWide || k === 0 || next === area.length;
      if (!scan.virtual && isSide) outline.positions.push(...end(k, rim), ...end(k, range));
    });
    while (outline.colors.length < outline.positions.length) outline.colors.push(...color);
    while (fan.colors.length < fan.positions.length) fan.colors.push(...color);
  }

  close() {
    for (const mesh of [this.fans, this.hits, this.outlines]) {
      mesh.geometry.dispose();
      mesh.removeFromParent();
    }
  }
}

function heightOf(model, mountName) {
  const links = new Map(model.links.map((link) => [link.name, link]));
  const mount = model.mounts.find((each) => each.name === mountName);
  let height = mount.at[2];
  for (let link = links.get(mount.link); link; link = links.get(link.parent)) height += link.at[2];
  return height;
}
