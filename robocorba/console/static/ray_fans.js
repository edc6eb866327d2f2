// Rays of laser and proximity sensors in a 3D scene: a fan for each scan, and points where rays hit something.
import { THREE } from "nicegui-scene";

// Red, green and blue of fans and hits, by the sensor's name; others have the last one.
const COLORS = { laser: [0.0, 0.45, 0.7], proximity: [0.85, 0.45, 0.0], other: [0.35, 0.35, 0.4] };
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
    for (const mesh of [this.fans, this.hits]) {
      mesh.frustumCulled = false;
      view.scene.add(mesh);
    }
  }

  // scans: as live.scansOn() has them, each with the height `z` of its floor.
  set(scans) {
    const fan = { positions: [], colors: [] }, hit = { positions: [], colors: [] };
    let rays = 0;
    for (const scan of scans) {
      rays += scan.ranges.length;
      if (rays > MOST_RAYS) break;
      this.add(scan, fan, hit);
    }
    for (const [mesh, { positions, colors }] of [[this.fans, fan], [this.hits, hit]]) {
      mesh.geometry.dispose();
      mesh.geometry = new THREE.BufferGeometry();
      mesh.geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
      mesh.geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
    }
    this.view.redraw();
  }

  add(scan, fan, hit) {
    const kind = scan.sensor in COLORS ? scan.sensor : "other";
    const color = new THREE.Color().setRGB(...COLORS[kind], THREE.SRGBColorSpace).toArray();
    const z = scan.z + this.heights[kind];
    const { pose, mount, angles, ranges, rim } = scan;
    const [cos, sin] = [Math.cos(pose.heading), Math.sin(pose.heading)];
    const x = pose.x + cos * mount.ahead - sin * mount.left, y = pose.y + sin * mount.ahead + cos * mount.left;
    const end = (k, range) => {
      const bearing = pose.heading + mount.heading + angles.first + k * angles.step;
      return [x + range * Math.cos(bearing), y + range * Math.sin(bearing), z];
    };
    // Rays far apart, such as those of eight proximity sensors, are narrow beams of their own.
    const isWide = Math.abs(angles.step) < 0.2;
    for (let k = 0; k < ranges.length; k++) {
      if (isWide && k + 1 < ranges.length) {
        fan.positions.push(...end(k, rim), ...end(k, ranges[k]), ...end(k + 1, ranges[k + 1]));
      } else if (!isWide) {
        const half = BEAM_RAD / angles.step;
        fan.positions.push(...end(k, rim), ...end(k - half, ranges[k]), ...end(k + half, ranges[k]));
      }
      if (scan.hits[k]) {
        hit.positions.push(...end(k, ranges[k]));
        hit.colors.push(...color);
      }
    }
    while (fan.colors.length < fan.positions.length) fan.colors.push(...color);
  }

  close() {
    for (const mesh of [this.fans, this.hits]) {
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
